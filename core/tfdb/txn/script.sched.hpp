// Scripts of commits for a whole forest, their execution on the real code, and the naive model's
// answers. For the walker and for Relacy.
#pragma once

#include <array>
#include <bit>
#include <cmath>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "tfdb/graph/names.hpp"
#include "tfdb/graph/pins.hpp"
#include "tfdb/lookup/lookup.hpp"
#include "tfdb/store/naive_model.hpp"
#include "tfdb/txn/commit.hpp"
#include "tfdb/txn/snapshot_view.hpp"

namespace tfdb::txn::forest {

using clock::StampNs;
using geometry::Pose;

inline constexpr std::uint32_t kFrames = 6;

/// One commit of a script, or a compaction. A set may change an edge's kind; one that closes a
/// cycle is undone, as in the store. kCompactLate has a seeded bug: see Forest::compact.
struct Step {
    enum Kind { kSet, kSetStatic, kSetCycle, kRemove, kClear, kCompact, kCompactLate };
    struct Edge {
        std::string parent;
        std::string child;
        StampNs stamp = 0;
    };
    Kind kind = kSet;
    std::vector<Edge> edges;
    std::string name;  // a frame to remove before the edges are set
};

struct Question {
    std::string target;
    std::string source;
    std::optional<StampNs> stamp;  // none: latest common time
};

struct Script {
    std::optional<StampNs> history;
    std::vector<Step> before;
    std::vector<Step> during;
    std::vector<Question> questions;
};

/// A unique pose for each edge of each step, far from the identity.
inline Pose pose_of(std::size_t step, std::size_t edge) {
    const auto number = static_cast<double>(step * 10 + edge + 1);
    const double half = 0.05 * number;
    return {{number, -2.0 * number, 0.5}, {0.0, 0.0, std::sin(half), std::cos(half)}};
}

// A store on a checker's words: the functions of store::Buffer, without argument checks.
// One writer at a time applies steps; readers are other threads.
template <class Memory>
class Forest : public history::Readers {
public:
    explicit Forest(const Script& script)
        : frames(memory, root, headers, kFrames),
          names(frames),
          history(script.history.value_or(history::kForever)) {
        scratch.touched.reserve(8);
    }

    [[nodiscard]] typename Memory::Word& word(graph::StoreWord w) const {
        return frames.store_word(w);
    }
    [[nodiscard]] SnapshotView<Memory> view(CommitNumber commit) const {
        return {frames, commit, history};
    }

    /// One commit. False: it closed a cycle and was undone.
    bool apply(const Step& step, std::size_t number) {
        if (step.kind == Step::kCompact || step.kind == Step::kCompactLate) {
            compact(step.kind == Step::kCompactLate);
            return true;
        }
        Commit<Memory> commit(frames, scratch, history, *this);
        if (!step.name.empty())
            commit.remove(names.find(step.name, commit.number()));
        if (step.kind == Step::kClear) {
            clear(commit);
        } else if (step.kind != Step::kRemove) {
            Cycle cycle;
            set(commit, step, number);
            if (commit.cycles().find(cycle)) {
                return false;
            }
        }
        commit.publish();
        return true;
    }

    Memory memory;
    Offset root = memory.allocate(graph::kStoreBytes);
    Offset headers = memory.allocate(graph::Frames<Memory>::bytes(kFrames));
    graph::Frames<Memory> frames;
    graph::Names<Memory> names;
    StampNs history;
    CommitScratch scratch;

    [[nodiscard]] CommitNumber oldest_read() override {
        return graph::Pins<Memory>(frames, graph::kHeldPins)
            .oldest(word(graph::kCommit).load_relaxed());
    }
    [[nodiscard]] std::uint64_t next_epoch() override {
        return word(graph::kEpoch).load_relaxed() + 1;
    }
    [[nodiscard]] std::uint64_t begin_epoch() override {
        return graph::Pins<Memory>(frames, graph::kReadPins)
            .oldest(word(graph::kEpoch).fetch_add(1) + 1);
    }
    void held(std::uint64_t) override {}

private:
    void set(Commit<Memory>& commit, const Step& step, std::size_t number) {
        std::vector<std::pair<FrameId, FrameId>> ids;
        for (const Step::Edge& edge : step.edges) {
            const FrameId parent = commit.frame(edge.parent);
            ids.emplace_back(parent, commit.frame(edge.child));
            (void)commit.touch(ids.back().second);
        }
        for (std::size_t i = 0; i < ids.size(); ++i) {
            history::NewSample<Memory> sample;
            sample.stamp =
                step.kind == Step::kSetStatic ? history::kStaticStamp : step.edges[i].stamp;
            sample.parent = ids[i].first;
            sample.payload = std::bit_cast<std::array<std::uint64_t, 7>>(pose_of(number, i));
            const history::EdgeSegments<Memory> edge(memory, frames.header(ids[i].second));
            if (edge.has_samples() && edge.is_static() != (step.kind == Step::kSetStatic))
                commit.clear(ids[i].second);
            commit.append(ids[i].second, sample, i);
        }
    }
    /// As Store::compact. All retired blocks are free at once, and the next step may take them.
    /// `late`: frees up to an epoch that begins after the pins were read.
    void compact(bool late) {
        const CommitNumber committed = word(graph::kCommit).load_relaxed();
        if (oldest_read() < committed)
            return;
        {
            Commit<Memory> commit(frames, scratch, history, *this);
            commit.empty_removed();
            commit.evict_all();
        }
        std::uint64_t epoch = word(graph::kEpoch).fetch_add(1) + 1;
        if (graph::Pins<Memory>(frames, graph::kReadPins).oldest(epoch) < epoch)
            return;
        if (late)
            epoch = word(graph::kEpoch).fetch_add(1) + 1;
        memory.reclaimed(memory::Line::kReplaced).store_relaxed(epoch);
        memory.reclaimed(memory::Line::kEnded).store_relaxed(committed);
        Memory::fence_release();
        for (const auto& [line, number] :
             {std::pair(memory::Line::kReplaced, epoch), {memory::Line::kEnded, committed}}) {
            while (memory.reclaim(line, number, 0)) {
            }
        }
    }
    void clear(Commit<Memory>& commit) {
        const CommitNumber committed = word(graph::kCommit).load_acquire();
        for (FrameId id = 0; id < frames.count(); ++id) {
            const history::EdgeSegments<Memory> edge(memory, frames.header(id));
            if (view(committed).alive(id) && edge.newest() >= 0 && !commit.touch(id)) {
                commit.clear(id);
            }
        }
    }
};

/// The same script for the naive model.
inline naive::Model model_of(const Script& script) {
    naive::Model model(script.history);
    std::vector<Step> all = script.before;
    all.insert(all.end(), script.during.begin(), script.during.end());
    for (std::size_t number = 0; number < all.size(); ++number) {
        const Step& step = all[number];
        std::vector<naive::Member> batch;
        for (std::size_t i = 0; i < step.edges.size(); ++i) {
            const Step::Edge& edge = step.edges[i];
            batch.push_back({edge.parent, edge.child, edge.stamp, pose_of(number, i)});
        }
        if (step.kind == Step::kRemove) {
            (void)model.remove(step.name, false);
        } else if (step.kind == Step::kClear) {
            model.clear();
        } else if (step.kind == Step::kSet || step.kind == Step::kSetStatic) {
            model.set(batch, step.kind == Step::kSetStatic);
        }
    }
    return model;
}

inline bool near(const Pose& a, const Pose& b) {
    const auto* left = &a.translation.x;
    const auto* right = &b.translation.x;
    bool same = true;
    for (int i = 0; i < 7; ++i) {
        same = same && std::abs(left[i] - right[i]) < 1e-9;
    }
    return same;
}

/// Asks one question of one state, as a Snapshot does. False: overtaken, and nothing was checked.
template <class Memory, class Require>
[[nodiscard]] bool ask(const Forest<Memory>& forest, const naive::Model& model, CommitNumber commit,
                       const Question& question, const Require& require) {
    const FrameId target = forest.names.find(question.target, commit);
    const FrameId source = forest.names.find(question.source, commit);
    lookup::Answer answer;
    lookup::Failure failure;
    const lookup::Outcome outcome =
        lookup::lookup(forest.view(commit), target, source, question.stamp, {}, answer, failure);
    if (outcome == lookup::Outcome::kLapped) {
        return false;
    }
    if (outcome == lookup::Outcome::kFailed) {
        Memory::fence_acquire();
        if (commit < forest.word(graph::kRecycleFloor).load_relaxed()) {
            return false;
        }
    }
    const naive::Reply expected =
        model.lookup(commit, question.target, question.source, question.stamp, {});
    require(expected.error.has_value() == (outcome == lookup::Outcome::kFailed),
            "an answer, or an error");
    if (expected.error) {
        require(failure.code == *expected.error, "the error");
        return true;
    }
    require(near(answer.pose, expected.pose), "the pose");
    require(answer.stamp == expected.stamp, "the stamp");
    require(answer.edges.size() == expected.edges.size(), "the path");
    return true;
}

}  // namespace tfdb::txn::forest
