#include "tfdb/store/freeze.hpp"

#include <algorithm>
#include <bit>
#include <limits>
#include <unordered_map>
#include <utility>
#include <vector>

#include "tfdb/memory/frozen_file.hpp"
#include "tfdb/store/collect.hpp"
#include "tfdb/txn/depth_hints.hpp"

namespace tfdb::store {
namespace {

using history::SegmentWord;
using history::SlotWord;
using history::Topology;
using lookup::Outcome;
using Segment = history::Segment<StoreMemory>;
using Directory = history::Directory<StoreMemory>;

/// All segments of an edge but the last one have this many samples.
constexpr std::uint64_t kFull = std::uint64_t{1} << history::Tuning<StoreMemory>::kLargestLog2;

/// Size of a text in the region: its length, then its bytes.
std::size_t text_bytes(std::size_t size) {
    return 8 + memory::round_up(size, 8);
}

/// A segment as it will lie in the file.
/// Threads: one. Guarantee: none.
class SegmentImage {
public:
    /// Starts a segment of at most `capacity` samples; unused slots at its end are not written.
    void start(std::uint64_t capacity) {
        log2_ = static_cast<unsigned>(std::bit_width(capacity - 1));
        words_.assign((memory::kLineBytes + memory::round_up(std::size_t{8} << log2_, 64)) / 8, 0);
        count_ = 0;
        node_ = {};
    }
    void put(StampNs stamp, FrameId parent, const history::SlotData<StoreMemory>& sample) {
        const StampNs counted = std::max(stamp, history::kNoStamp);
        words_[memory::kLineBytes / 8 + count_++] = history::as_word(stamp);
        words_.push_back(SlotWord::pack(sample.commit, parent));
        words_.insert(words_.end(), sample.payload.begin(), sample.payload.end());
        node_.extent.add({1, counted, counted, 0});
        node_.least = std::min(node_.least, sample.commit);
        node_.changed = std::max(node_.changed, sample.commit);
        words_[history::kLeast] = node_.least;
        words_[history::kGreatest] = node_.changed;
    }
    [[nodiscard]] const Directory::Node& node() const { return node_; }
    [[nodiscard]] const std::vector<std::uint64_t>& words() const { return words_; }
    [[nodiscard]] std::uint64_t word(Offset block) const {
        return SegmentWord::pack(block, log2_, 0, count_);
    }
    /// Samples per ns; 0 if it is meaningless.
    [[nodiscard]] double rate() const {
        const StampNs span = node_.extent.last - node_.extent.first;
        return span > 0 ? static_cast<double>(count_ - 1) / static_cast<double>(span) : 0.0;
    }

private:
    unsigned log2_ = 0;
    std::uint64_t count_ = 0;
    std::vector<std::uint64_t> words_;
    Directory::Node node_;
};

/// A frame of the state.
struct Found {
    FrameId id = kNoFrame;
    CommitNumber born = 0;
    std::string name;
    std::uint64_t late = 0;
    std::string authority;
    std::uint64_t samples = 0;  // number of its edge's samples
    bool cleared = false;
};

/// Writes a state: first the words for lookups, built in a region in memory, then the samples, edge
/// by edge. The size of the first part is known before the first sample is read.
/// Threads: one. Guarantee: none.
class Freezer {
public:
    Freezer(const Store& store, CommitNumber held) : store_(store), held_(held) {}

    void run(const std::string& path, std::string_view origin, bool in_place) {
        memory::NewFrozenFile file(path, in_place);
        find_frames();
        const FrameId slots = static_cast<FrameId>(found_.size()) + 1;
        (void)front_.allocate(graph::kStoreBytes);
        const Offset table = front_.allocate(graph::Frames<StoreMemory>::bytes(slots));
        const graph::Frames<StoreMemory> frames(front_, StoreMemory::root(), table, slots);
        put_store(frames, table, origin);
        put_frames(frames);
        at_ = std::max<Offset>(memory::round_up(front_.end(), memory::kLineBytes),
                               memory::kFrozenHeaderBytes);
        const Offset front_end = front_.end();
        for (FrameId id = 0; id < found_.size(); ++id)
            put_edge(file, frames, id);
        if (!names_removed_)
            frames.store_word(graph::kFrameCount).store_relaxed(removed());
        txn::refresh_depths(frames, depths_, climb_);
        front_.extend(at_);
        std::vector<std::uint64_t> words;
        for (Offset at = 0; at < front_end; at += 8)
            words.push_back(front_.word(at).load_relaxed());
        file.publish(std::move(words), at_, Store::layout());
    }

private:
    /// Reads the state; throws SnapshotTooOld.
    template <class Attempt>
    void read(Attempt attempt) const {
        interruption_point();
        (void)store::read(store_, held_, attempt);
    }

    void find_frames() {
        read([&](const StoreView& view) {
            found_.clear();
            const Outcome outcome = for_each_frame(view, [&](FrameId id) {
                Found& frame = found_.emplace_back();
                frame.id = id;
                frame.born = view.frames().born(id);
                return read_name(store_, view, id, frame.name) ? Outcome::kOk : Outcome::kLapped;
            });
            return unless_reused(store_, view.commit(), outcome);
        });
        for (FrameId to = 0; to < found_.size(); ++to) {
            Found& frame = found_[to];
            places_.emplace(frame.id, to);
            read([&](const StoreView& view) {
                Outline outline;
                const Outcome outcome = store::outline(view, frame.id, outline);
                frame.samples = outline.is_static ? 1 : outline.extent.samples;
                frame.cleared = outline.cleared;
                frame.late = store_.frames.word(frame.id, history::kLate).load_relaxed();
                frame.authority = store_.author(frame.id);
                return view.alive(frame.id) ? outcome : Outcome::kLapped;
            });
        }
    }

    void put_store(const graph::Frames<StoreMemory>& frames, Offset table,
                   std::string_view origin) {
        const auto put = [&](graph::StoreWord w, std::uint64_t value) {
            frames.store_word(w).store_relaxed(value);
        };
        put(graph::kCommit, held_);
        put(graph::kFeedFloor, held_ + 1);
        for (const auto w : {graph::kLifeNumber, graph::kLifeHigh, graph::kLifeLow})
            put(w, store_.word(w).load_relaxed());
        put(graph::kNormalised, store_.word(graph::kNormalised).load_relaxed());
        put(graph::kFrameTable, table);
        put(graph::kMaxFrameCount, frames.max_frames());
        put(graph::kHistory, history::as_word(store_.history));
        put(graph::kSnapshotMemory, store_.snapshot_memory);
        if (origin.empty())
            return;
        const Offset text = front_.allocate(text_bytes(origin.size()));
        front_.word(text).store_relaxed(origin.size());
        graph::store_text(front_, text + 8, origin);
        put(graph::kOrigin, text);
    }

    void put_frames(const graph::Frames<StoreMemory>& frames) {
        const graph::Names<StoreMemory> names(frames);
        Authorities authorities(front_, frames.store_word(graph::kAuthorities));
        for (FrameId id = 0; id < found_.size(); ++id) {
            const Found& frame = found_[id];
            names.reserve();
            frames.make(id, frame.born, names.store_name(frame.name));
            names.insert(frame.name, id);
            frames.word(id, history::kLate).store_relaxed(frame.late);
            frames.word(id, history::kAuthority).store_relaxed(authorities.id(frame.authority));
            if (frame.samples > kFull)
                put_directory(frames, id, (frame.samples - 1) / kFull);
        }
        // The last slot has no frame: samples whose parent was removed name it.
        frames.make(removed(), 0, 0);
        frames.seal(removed());
    }
    void put_directory(const graph::Frames<StoreMemory>& frames, FrameId id,
                       std::uint64_t entries) {
        const Directory made(front_, front_.allocate(Directory::bytes(entries)));
        made.word(history::kDirCapacity).store_relaxed(entries);
        made.word(history::kDirBegin).store_relaxed(0);
        made.word(history::kDirLowest).store_relaxed(0);
        made.word(history::kDirEnd).store_relaxed(entries);
        frames.word(id, history::kDirectory).store_relaxed(made.block());
    }

    [[nodiscard]] FrameId removed() const { return static_cast<FrameId>(found_.size()); }
    /// The id in the file of the frame that a sample names.
    [[nodiscard]] FrameId place_of(FrameId parent, CommitNumber commit) {
        const auto place = places_.find(parent);
        if (place != places_.end() && found_[place->second].born <= commit)
            return place->second;
        names_removed_ = true;
        return removed();
    }

    void put_edge(memory::NewFrozenFile& file, const graph::Frames<StoreMemory>& frames,
                  FrameId id) {
        const auto word = [&](history::HeaderWord w) -> auto& {
            return frames.word(id, w);
        };
        const Directory directory(front_, word(history::kDirectory).load_relaxed());
        std::uint64_t left = found_[id].samples;
        StampNs after = std::numeric_limits<StampNs>::min() / 2;
        std::uint64_t entry = 0;
        FrameId parent = kNoFrame;
        std::uint64_t flags = 0;
        while (left > 0) {
            const std::uint64_t count = std::min(left, kFull);
            collect(found_[id].id, after, count);
            for (const Sample& sample : samples_) {
                const FrameId named = place_of(sample.data.parent, sample.data.commit);
                if (parent != kNoFrame && named != parent)
                    flags = Topology::kMixedParents;
                parent = named;
                image_.put(sample.stamp, named, sample.data);
            }
            after = samples_.back().stamp;
            file.write(at_, image_.words());
            left -= count;
            if (left == 0) {
                word(history::kTail).store_relaxed(image_.word(at_));
                word(history::kRate).store_relaxed(std::bit_cast<std::uint64_t>(image_.rate()));
            } else {
                directory.first_word(entry).store_relaxed(history::as_word(samples_.front().stamp));
                directory.entry(entry).store_relaxed(image_.word(at_));
                directory.store_node(entry++, image_.node());
            }
            at_ += memory::round_up(8 * image_.words().size(), memory::kLineBytes);
        }
        if (entry > 0) {
            directory.sum_up_all(0, entry);
            directory.update_rate();
        }
        if (parent == kNoFrame) {
            if (found_[id].cleared)
                word(history::kTopology).store_relaxed(Topology::kRoot | Topology::kCleared);
            return;
        }
        word(history::kTopology).store_relaxed(Topology::with_parent(flags, parent, 0));
        frames.refresh_hint(id);
    }

    struct Sample {
        StampNs stamp;
        history::SlotData<StoreMemory> data;
    };
    /// Collects the next samples of an edge.
    void collect(FrameId id, StampNs after, std::uint64_t count) {
        read([&](const StoreView& view) {
            samples_.clear();
            StoreEdge edge;
            if (!view.open(id, edge))
                return Outcome::kLapped;
            const auto take = [&](const history::SampleAt& at) {
                if (at.stamp > after || at.stamp == history::kStaticStamp)
                    samples_.push_back({at.stamp, edge.read(at)});
                return samples_.size() < count;
            };
            const bool whole = edge.is_static() ? take(edge.newest()) || true
                                                : edge.visit(after, history::kForever, 0, take);
            return whole && edge.confirm() ? Outcome::kOk : Outcome::kLapped;
        });
        if (samples_.size() != count)
            throw CorruptStore(
                "the store is damaged and cannot be frozen: a frame has fewer "
                "samples than its header states");
        image_.start(std::max<std::uint64_t>(count, 2));
    }

    const Store& store_;
    CommitNumber held_;
    StoreMemory front_;
    Offset at_ = 0;  // end of the written part
    std::vector<Found> found_;
    std::unordered_map<FrameId, FrameId> places_;  // new id of each frame of the state
    bool names_removed_ = false;                   // some sample names a removed frame
    std::vector<Sample> samples_;
    SegmentImage image_;
    std::vector<std::uint32_t> depths_;
    std::vector<FrameId> climb_;
};

}  // namespace

void freeze(const Store& store, CommitNumber held, const std::string& path, std::string_view origin,
            bool in_place) {
    Freezer(store, held).run(path, origin, in_place);
}

std::string origin(const Store& store) {
    const Offset text = store.word(graph::kOrigin).load_relaxed();
    const std::size_t end = store.memory.capacity();
    if (text == 0 || text % 8 != 0 || text > end - 8)
        return {};
    const std::uint64_t size = store.memory.word(text).load_relaxed();
    if (size > end || text + text_bytes(size) > end)
        return {};
    return graph::load_text(store.memory, text + 8, size);
}

}  // namespace tfdb::store
