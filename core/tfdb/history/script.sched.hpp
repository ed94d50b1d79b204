// A script of commits, the expected state of each snapshot, and its execution on the real protocol.
#pragma once

#include <algorithm>
#include <cstdint>
#include <map>
#include <vector>

#include "tfdb/history/edge_view.hpp"
#include "tfdb/history/edge_writer.hpp"

namespace tfdb::history::script {

/// Instead of a stamp: the edge is cleared.
inline constexpr StampNs kClearMarker = -3;

/// One sample of a script: its edge, stamp and parent.
struct Put {
    unsigned edge = 0;
    StampNs stamp = 0;
    FrameId parent = 5;
};

/// A batch. An aborted one is written, then undone, and takes no number. The samples of one that is
/// `together` belong to the first edge, in stamp order, and are appended in one call.
struct Batch {
    std::vector<Put> puts;
    bool aborted = false;
    bool together = false;
};

/// The steps before the threads start, and the writer's steps beside the readers.
struct Script {
    StampNs history = kForever;
    unsigned edges = 1;
    std::vector<Batch> before;
    std::vector<Batch> during;
    bool may_evict = true;
    bool held_before = false;  // until the threads start, a reader holds the first state
};

/// A sample as a reader must find it. All payload words follow from the tag.
struct Sample {
    StampNs stamp = kNoStamp;
    FrameId parent = kNoFrame;
    CommitNumber commit = 0;
    std::uint64_t tag = 0;

    bool operator==(const Sample&) const = default;
};

constexpr std::uint64_t payload_word(std::uint64_t tag, unsigned index) {
    return tag * 1000 + index + 1;
}

/// Every sample has a unique tag, including aborted ones: edge, batch, place in the batch.
constexpr std::uint64_t tag_of(unsigned edge, std::size_t batch, std::size_t place) {
    return (batch + 1) * 100 + place * 10 + edge;
}

// The specification, executed naively: the samples visible in each snapshot, for each edge. Plain
// data, computed before the threads start. Independent of the code under test.
class Model {
public:
    explicit Model(const Script& script) : history_(script.history) {
        std::vector<Batch> all = script.before;
        all.insert(all.end(), script.during.begin(), script.during.end());
        std::vector<std::vector<Sample>> logs(script.edges);
        states_.push_back(see(logs));
        CommitNumber commit = 0;
        for (std::size_t batch = 0; batch < all.size(); ++batch) {
            if (all[batch].aborted) {
                continue;
            }
            ++commit;
            for (std::size_t place = 0; place < all[batch].puts.size(); ++place) {
                const Put& put = all[batch].puts[place];
                logs[put.edge].push_back(
                    {put.stamp, put.parent, commit, tag_of(put.edge, batch, place)});
            }
            states_.push_back(see(logs));
        }
    }

    /// The samples of an edge in stamp order; a static edge has one.
    [[nodiscard]] const std::vector<Sample>& visible(CommitNumber commit, unsigned edge) const {
        return states_.at(commit).at(edge);
    }
    [[nodiscard]] CommitNumber last() const { return states_.size() - 1; }

private:
    using State = std::vector<std::vector<Sample>>;

    [[nodiscard]] State see(const std::vector<std::vector<Sample>>& logs) const {
        State state;
        for (const std::vector<Sample>& log : logs) {
            std::map<StampNs, Sample> by_stamp;
            for (const Sample& sample : log) {
                if (sample.stamp == kClearMarker) {
                    by_stamp.clear();
                } else {
                    by_stamp[sample.stamp] = sample;
                }
            }
            std::vector<Sample> seen;
            for (const auto& [stamp, sample] : by_stamp) {
                if (stamp < 0 || stamp >= by_stamp.rbegin()->first - history_) {
                    seen.push_back(sample);
                }
            }
            state.push_back(seen);
        }
        return state;
    }

    StampNs history_;
    std::vector<State> states_;
};

/// The layout of the region: the words of commit and epoch, then a header per edge.
struct Places {
    Offset commit = 0;
    [[nodiscard]] Offset epoch() const { return commit + 16; }
    Offset headers = 0;
    [[nodiscard]] Offset header(unsigned edge) const { return headers + edge * kHeaderBytes; }
};

template <class Memory>
Places place(Memory& memory, const Script& script) {
    Places places;
    places.commit = memory.allocate(memory::kLineBytes);
    places.headers = memory.allocate(script.edges * kHeaderBytes);
    for (unsigned edge = 0; edge < script.edges; ++edge) {
        const Offset header = places.header(edge);
        memory.word(header + 8 * kTopology).store_relaxed(Topology::kRoot);
    }
    return places;
}

/// The script's readers: the oldest readable state is given, and `oldest_epoch(epoch)` is the epoch
/// in which the oldest read in progress began.
template <class Word, class OldestEpoch>
class ScriptReaders : public Readers {
public:
    ScriptReaders(Word& epoch, CommitNumber oldest, OldestEpoch oldest_epoch)
        : epoch_(epoch), oldest_(oldest), oldest_epoch_(oldest_epoch) {}
    [[nodiscard]] CommitNumber oldest_read() override { return oldest_; }
    [[nodiscard]] std::uint64_t next_epoch() override { return epoch_.load_relaxed() + 1; }
    [[nodiscard]] std::uint64_t begin_epoch() override {
        return oldest_epoch_(epoch_.fetch_add(1) + 1);
    }
    void held(std::uint64_t) override {}

private:
    Word& epoch_;
    CommitNumber oldest_;
    OldestEpoch oldest_epoch_;
};

/// Writes one batch as the store does: appends all, then publishes, or rolls everything back.
template <class Memory, class OldestEpoch>
void write_beside(Memory& memory, const Places& places, const Script& script, std::size_t number,
                  CommitNumber oldest, OldestEpoch oldest_epoch) {
    const std::size_t already = script.before.size();
    const Batch& batch = number < already ? script.before[number] : script.during[number - already];
    const CommitNumber committed = memory.word(places.commit).load_relaxed();
    ScriptReaders readers(memory.word(places.epoch()), oldest, oldest_epoch);
    const WriteContext context(committed, script.history, readers);
    std::vector<unsigned> cleared;
    std::vector<NewSample<Memory>> together;
    for (std::size_t at = 0; at < batch.puts.size(); ++at) {
        const Put& put = batch.puts[at];
        EdgeWriter<Memory> edge(memory, places.header(put.edge));
        if (put.stamp == kClearMarker) {
            edge.clear(context);
            cleared.push_back(put.edge);
            continue;
        }
        NewSample<Memory> sample;
        sample.stamp = put.stamp;
        sample.parent = put.parent;
        for (unsigned i = 0; i < Memory::kPayloadWords; ++i) {
            sample.payload[i] = payload_word(tag_of(put.edge, number, at), i);
        }
        if (batch.together) {
            together.push_back(sample);
        } else {
            edge.append(context, sample);
        }
    }
    if (batch.together)
        EdgeWriter<Memory>(memory, places.header(0))
            .append(context, std::span<const NewSample<Memory>>(together));
    if (batch.aborted) {
        for (unsigned edge = 0; edge < script.edges; ++edge)
            EdgeWriter<Memory>(memory, places.header(edge)).trim(context);
        return;
    }
    memory.word(places.commit).store_release(context.number());
    for (const unsigned edge : cleared)
        EdgeWriter<Memory>(memory, places.header(edge)).retire_older(context);
}

template <class Memory>
void write(Memory& memory, const Places& places, const Script& script, std::size_t number,
           bool may_evict) {
    write_beside(memory, places, script, number, may_evict ? kMaxCommit : 0,
                 [=](std::uint64_t epoch) { return may_evict ? epoch : 0; });
}
template <class Memory>
void write(Memory& memory, const Places& places, const Script& script, std::size_t number) {
    const bool held = script.held_before && number < script.before.size();
    write(memory, places, script, number, script.may_evict && !held);
}

/// The result of one lookup on an edge.
template <class Memory>
struct Taken {
    bool is_static = false;
    Bracket around;
    SlotData<Memory> before;
    SlotData<Memory> after;
    SampleAt newest;
};

/// Reads one edge as a lookup does. False: overtaken.
template <class Memory>
[[nodiscard]] bool take(Memory& memory, Offset header, CommitNumber snapshot, std::uint64_t epoch,
                        StampNs history, StampNs stamp, Taken<Memory>& taken) {
    EdgeView<Memory> view;
    if (!view.open(memory, header, snapshot, history, {epoch, snapshot})) {
        return false;
    }
    taken.around = Bracket{};
    taken.is_static = view.is_static();
    taken.newest = view.newest();
    if (taken.is_static) {
        taken.around.before = view.newest();
    } else if (!view.empty() && !view.bracket(stamp, taken.around)) {
        return false;
    }
    if (taken.around.before)
        taken.before = view.read(taken.around.before);
    if (taken.around.after)
        taken.after = view.read(taken.around.after);
    return view.confirm();
}

/// Reads all samples of an edge in order. False: overtaken.
template <class Memory>
[[nodiscard]] bool take_all(Memory& memory, Offset header, CommitNumber snapshot,
                            std::uint64_t epoch, StampNs history,
                            std::vector<std::pair<StampNs, SlotData<Memory>>>& taken) {
    taken.clear();
    EdgeView<Memory> view;
    if (!view.open(memory, header, snapshot, history, {epoch, snapshot}))
        return false;
    if (view.is_static() || view.empty()) {
        if (!view.empty())
            taken.emplace_back(kStaticStamp, view.read(view.newest()));
        return view.confirm();
    }
    return view.visit(0, kForever, 0, [&](const SampleAt& sample) {
        taken.emplace_back(sample.stamp, view.read(sample));
        return taken.size() < 64;
    }) && view.confirm();
}

/// True if the slot holds exactly the sample: every payload word, the parent, the commit.
template <class Memory>
[[nodiscard]] bool same(const SlotData<Memory>& slot, const Sample& sample) {
    bool whole = slot.parent == sample.parent && slot.commit == sample.commit;
    for (unsigned i = 0; i < Memory::kPayloadWords; ++i) {
        whole = whole && slot.payload[i] == payload_word(sample.tag, i);
    }
    return whole;
}

/// Compares with the model; calls `require(holds, text)` for each promise.
template <class Memory, class Require>
void judge(const Taken<Memory>& taken, const std::vector<Sample>& visible, StampNs stamp,
           const Require& require) {
    const bool expect_static = visible.size() == 1 && visible[0].stamp == kStaticStamp;
    require(taken.is_static == expect_static, "static or moving as the snapshot has it");
    if (expect_static) {
        require(same(taken.before, visible[0]), "the static pose is the snapshot's");
        return;
    }
    const auto after = std::find_if(visible.begin(), visible.end(),
                                    [&](const Sample& sample) { return sample.stamp > stamp; });
    const bool has_before = after != visible.begin();
    const bool has_after = after != visible.end();
    require(static_cast<bool>(taken.around.before) == has_before, "a sample before, or none");
    require(static_cast<bool>(taken.around.after) == has_after, "a sample after, or none");
    if (has_before) {
        require(taken.around.before.stamp == (after - 1)->stamp, "the nearest stamp before");
        require(same(taken.before, *(after - 1)), "the sample before is the snapshot's, whole");
    }
    if (has_after) {
        require(taken.around.after.stamp == after->stamp, "the nearest stamp after");
        require(same(taken.after, *after), "the sample after is the snapshot's, whole");
    }
    if (!visible.empty()) {
        require(taken.newest.stamp == visible.back().stamp, "the newest stamp");
    }
}

/// One lookup over all edges from one snapshot. False: overtaken, and nothing was checked.
template <class Memory, class Require>
[[nodiscard]] bool read_at(Memory& memory, const Places& places, const Script& script,
                           const Model& model, CommitNumber snapshot, StampNs stamp,
                           const Require& require) {
    const std::uint64_t epoch = memory.word(places.epoch()).load_acquire();
    std::vector<Taken<Memory>> taken(script.edges);
    for (unsigned edge = 0; edge < script.edges; ++edge) {
        if (!take(memory, places.header(edge), snapshot, epoch, script.history, stamp,
                  taken[edge])) {
            return false;
        }
    }
    for (unsigned edge = 0; edge < script.edges; ++edge) {
        judge(taken[edge], model.visible(snapshot, edge), stamp, require);
    }
    return true;
}

/// All samples of the first edge, from a fresh snapshot.
template <class Memory, class Require>
[[nodiscard]] bool read_all(Memory& memory, const Places& places, const Script& script,
                            const Model& model, const Require& require) {
    const CommitNumber snapshot = memory.word(places.commit).load_acquire();
    const std::uint64_t epoch = memory.word(places.epoch()).load_acquire();
    std::vector<std::pair<StampNs, SlotData<Memory>>> taken;
    if (!take_all(memory, places.header(0), snapshot, epoch, script.history, taken))
        return false;
    const std::vector<Sample>& visible = model.visible(snapshot, 0);
    require(taken.size() == visible.size(), "each sample once");
    for (std::size_t i = 0; i < std::min(taken.size(), visible.size()); ++i) {
        require(taken[i].first == visible[i].stamp, "in the order of their stamps");
        require(same(taken[i].second, visible[i]), "the snapshot's, whole");
    }
    return true;
}

/// The extent of the first edge, from a fresh snapshot.
template <class Memory, class Require>
[[nodiscard]] bool read_extent(Memory& memory, const Places& places, const Script& script,
                               const Model& model, const Require& require) {
    const CommitNumber snapshot = memory.word(places.commit).load_acquire();
    const std::uint64_t epoch = memory.word(places.epoch()).load_acquire();
    EdgeView<Memory> view;
    Extent found;
    if (!view.open(memory, places.header(0), snapshot, script.history, {epoch, snapshot}) ||
        !view.extent(found) || !view.confirm()) {
        return false;
    }
    Extent wanted;
    for (const Sample& sample : model.visible(snapshot, 0))
        wanted.add({1, sample.stamp, sample.stamp, 0});
    require(found == wanted, "the snapshot's samples in figures");
    return true;
}

/// One lookup over all edges from a fresh snapshot.
template <class Memory, class Require>
[[nodiscard]] bool read(Memory& memory, const Places& places, const Script& script,
                        const Model& model, StampNs stamp, const Require& require) {
    const CommitNumber snapshot = memory.word(places.commit).load_acquire();
    return read_at(memory, places, script, model, snapshot, stamp, require);
}

}  // namespace tfdb::history::script
