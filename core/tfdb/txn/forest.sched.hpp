// A small store as a program for the walker: real commits, names and lookups, judged by the naive
// model.
#pragma once

#include <cmath>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "tfdb/graph/names.hpp"
#include "tfdb/lookup/lookup.hpp"
#include "tfdb/store/naive_model.hpp"
#include "tfdb/sync/commit_lock.hpp"
#include "tfdb/testing/sched/memory.hpp"
#include "tfdb/testing/sched/walk.hpp"
#include "tfdb/txn/commit.hpp"
#include "tfdb/txn/snapshot_view.hpp"

namespace tfdb {

namespace txn::forest {

struct ForestMemory : sched::BasicMemory<7> {
    using BasicMemory::BasicMemory;
};

}  // namespace txn::forest

template <>
struct history::Tuning<txn::forest::ForestMemory> {
    static constexpr unsigned kFirstLog2Capacity = 1;
    static constexpr unsigned kMaxRuns = 2;
    static constexpr std::uint64_t kSlackLimit = 1;
    static constexpr unsigned kFirstNamesLog2 = 2;
};

namespace txn::forest {

using clock::StampNs;
using geometry::Pose;

inline constexpr std::size_t kRegionBytes = 8192;
inline constexpr std::uint32_t kFrames = 6;

using ForestLock = sync::BasicCommitLock<sched::Word, 0>;

/// One commit of a script. A set that closes a cycle is undone, as the store does.
struct Step {
    enum Kind { kSet, kSetStatic, kSetCycle, kRemove, kClear };
    struct Edge {
        std::string parent;
        std::string child;
        StampNs stamp = 0;
    };
    Kind kind = kSet;
    std::vector<Edge> edges;
    std::string name;
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

/// A pose of its own for each edge of each step, far from the identity.
inline Pose pose_of(std::size_t step, std::size_t edge) {
    const auto number = static_cast<double>(step * 10 + edge + 1);
    const double half = 0.05 * number;
    return {{number, -2.0 * number, 0.5}, {0.0, 0.0, std::sin(half), std::cos(half)}};
}

// The store of a walk: what store::Buffer does, on words of the walker.
// Writers take turns in one thread; readers are other threads.
class Forest {
public:
    explicit Forest(const Script& script)
        : memory(kRegionBytes),
          frames(memory, memory.allocate(graph::kStoreBytes),
                 memory.allocate(kFrames * history::kHeaderBytes), kFrames),
          names(frames),
          history(script.history.value_or(history::kForever)) {
        scratch.touched.reserve(8);
    }

    [[nodiscard]] sched::Word& word(graph::StoreWord w) const { return frames.store_word(w); }
    [[nodiscard]] SnapshotView<ForestMemory> view(CommitNumber commit) const {
        return {frames, commit, history};
    }

    [[nodiscard]] ForestLock lock() const { return ForestLock(word(graph::kCommitLock)); }

    void apply(const Step& step, std::size_t number) {
        ForestLock held = lock();
        held.lock();
        apply_locked(step, number);
        held.unlock();
    }

    ForestMemory memory;
    graph::Frames<ForestMemory> frames;
    graph::Names<ForestMemory> names;
    StampNs history;
    CommitScratch scratch;

private:
    void apply_locked(const Step& step, std::size_t number) {
        ForestMemory::fence_full();
        const bool may_evict = word(graph::kPins).load_relaxed() == 0;
        Commit<ForestMemory> commit(frames, scratch, history, may_evict);
        if (step.kind == Step::kRemove) {
            commit.remove(names.find(step.name, commit.number()));
        } else if (step.kind == Step::kClear) {
            clear(commit);
        } else {
            Cycle cycle;
            set(commit, step, number);
            const bool refused = commit.find_cycle(cycle);
            SCHED_REQUIRE(refused == (step.kind == Step::kSetCycle));
            if (refused) {
                return;
            }
        }
        commit.publish();
    }

    void set(Commit<ForestMemory>& commit, const Step& step, std::size_t number) {
        std::vector<std::pair<FrameId, FrameId>> ids;
        for (const Step::Edge& edge : step.edges) {
            const FrameId parent = commit.frame(edge.parent);
            ids.emplace_back(parent, commit.frame(edge.child));
            (void)commit.touch(ids.back().second);
        }
        for (std::size_t i = 0; i < ids.size(); ++i) {
            history::NewSample<ForestMemory> sample;
            sample.stamp =
                step.kind == Step::kSetStatic ? history::kStaticStamp : step.edges[i].stamp;
            sample.parent = ids[i].first;
            sample.payload = std::bit_cast<std::array<std::uint64_t, 7>>(pose_of(number, i));
            commit.append(ids[i].second, sample, i);
        }
    }
    void clear(Commit<ForestMemory>& commit) {
        const CommitNumber committed = word(graph::kCommit).load_acquire();
        for (FrameId id = 0; id < frames.count(); ++id) {
            const history::EdgeWriter<ForestMemory> edge(memory, frames.header(id));
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
        } else if (step.kind != Step::kSetCycle) {
            model.set(batch, step.kind == Step::kSetStatic);
        }
    }
    return model;
}

inline void require(bool holds, const char* text) {
    sched::Run::require(holds, text, "snapshot", 0);
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

/// Asks one question of one state, as a Snapshot does. False: overtaken, nothing was judged.
[[nodiscard]] inline bool ask(const Forest& forest, const naive::Model& model, CommitNumber commit,
                              const Question& question) {
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
        ForestMemory::fence_acquire();
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
    require(answer.edges.size() == expected.used.size(), "the path");
    return true;
}

inline void name_words(const Forest& forest) {
    static constexpr const char* kNames[] = {
        "ring",       "head",      "begin",        "topology",    "head_commit",   "newest",
        "rate",       "born",      "order",        "sorted_end",  "sorted_commit", "cleared",
        "evict_safe", "died",      "name",         "lock",        "children",      "authority",
        "late",       "next_free", "ordered_from", "parent_from", "touched"};
    for (FrameId id = 0; id < kFrames; ++id) {
        for (unsigned at = 0; at < std::size(kNames); ++at) {
            forest.frames.word(id, static_cast<history::HeaderWord>(at)).rename(kNames[at], id);
        }
    }
    forest.word(graph::kCommit).rename("commit", 0);
    forest.word(graph::kCommitLock).rename("lock_of_commits", 0);
    forest.word(graph::kPins).rename("pins", 0);
    forest.word(graph::kNames).rename("names", 0);
    forest.word(graph::kFrameCount).rename("frame_count", 0);
    forest.word(graph::kRecycleFloor).rename("recycle_floor", 0);
}

/// What the reader's thread does.
using Reader = std::function<void(const Forest&, const naive::Model&, const Script&)>;

/// Makes the interceptor that seeds a bug, once per execution; none by default.
using MakeFlaw = std::function<std::unique_ptr<sched::Interceptor>(const Forest&)>;

/// One writer (thread 0) runs the script beside one reader.
inline sched::Program program(const Script& script, const Reader& reader,
                              const MakeFlaw& make_flaw = {}) {
    const auto model = std::make_shared<const naive::Model>(model_of(script));
    return [=](sched::Run& run) {
        Forest forest(script);
        name_words(forest);
        for (std::size_t step = 0; step < script.before.size(); ++step) {
            forest.apply(script.before[step], step);
        }
        const std::unique_ptr<sched::Interceptor> flaw = make_flaw ? make_flaw(forest) : nullptr;
        forest.memory.intercept(flaw.get());
        run.thread("writer", [&] {
            for (std::size_t step = 0; step < script.during.size(); ++step) {
                forest.apply(script.during[step], script.before.size() + step);
            }
        });
        run.thread("reader", [&] { reader(forest, *model, script); });
        run.join();
        if (flaw != nullptr) {
            return;
        }
        const CommitNumber last = forest.word(graph::kCommit).peek();
        SCHED_REQUIRE(last == model->commit());
        for (const Question& question : script.questions) {
            SCHED_REQUIRE(ask(forest, *model, last, question));
        }
    };
}

/// As the store reads: again when overtaken, in the end with the commit lock, where nothing can.
template <class Commit>
void ask_until_answered(const Forest& forest, const naive::Model& model, const Question& question,
                        Commit commit) {
    constexpr int kTriesBeforeLock = 2;  // the store's sixteen would only make the walk longer
    for (int tries = 0; tries < kTriesBeforeLock; ++tries) {
        if (ask(forest, model, commit(), question)) {
            return;
        }
    }
    ForestLock lock = forest.lock();
    lock.lock();
    require(ask(forest, model, commit(), question), "no reader that holds the lock is overtaken");
    lock.unlock();
}

/// Each question from a fresh state.
inline void ask_fresh(const Forest& forest, const naive::Model& model, const Script& script) {
    for (const Question& question : script.questions) {
        ask_until_answered(forest, model, question,
                           [&] { return forest.word(graph::kCommit).load_acquire(); });
    }
}

/// All questions from one held snapshot.
inline void ask_held(const Forest& forest, const naive::Model& model, const Script& script) {
    forest.word(graph::kPins).fetch_add(1);
    ForestMemory::fence_full();
    const CommitNumber commit = forest.word(graph::kCommit).load_acquire();
    for (const Question& question : script.questions) {
        ask_until_answered(forest, model, question, [commit] { return commit; });
    }
    forest.word(graph::kPins).fetch_add(~std::uint64_t{0});
}

}  // namespace txn::forest

}  // namespace tfdb
