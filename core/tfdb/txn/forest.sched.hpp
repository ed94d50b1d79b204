// A small store as a program for the walker: real commits, names and lookups, checked by the naive
// model.
#pragma once

#include <functional>
#include <iterator>
#include <memory>

#include "tfdb/sync/commit_lock.hpp"
#include "tfdb/testing/sched/memory.hpp"
#include "tfdb/testing/sched/walk.hpp"
#include "tfdb/txn/script.sched.hpp"

namespace tfdb {

namespace txn::forest {

inline constexpr std::size_t kRegionBytes = 16384;
inline constexpr std::size_t kLargestBlock = 2048;  // no segment of 32 samples

/// Segments of one sample, then of two; a table of names that starts with four.
struct ForestMemory : sched::BasicMemory<7> {
    ForestMemory() : BasicMemory(kRegionBytes) {}

    Offset allocate(std::size_t bytes) {
        if (bytes > kLargestBlock)
            throw CapacityExceeded("the walked region has no block that large");
        return BasicMemory::allocate(bytes);
    }
};

}  // namespace txn::forest

template <>
struct history::Tuning<txn::forest::ForestMemory> {
    static constexpr unsigned kFirstLog2 = 0;
    static constexpr unsigned kFullLog2 = 1;
    static constexpr unsigned kFanLog2 = 1;
    static constexpr unsigned kSmallLog2 = 1;
    static constexpr unsigned kLargestLog2 = 7;
    static constexpr std::size_t kKept = 0;
    static constexpr unsigned kFirstNamesLog2 = 2;
};

namespace txn::forest {

using WalkedForest = Forest<ForestMemory>;
using ForestLock = sync::BasicCommitLock<sched::Word, 0>;

inline void require(bool holds, const char* text) {
    sched::Run::require(holds, text, "snapshot", 0);
}

template <class AnyForest>
void name_words(const AnyForest& forest) {
    static constexpr const char* kNames[] = {
        "tail",      "directory", "topology", "since",       "born",   "rate", "changed",
        "forgotten", "older",     "reshaped", "parent_from", "late",   "died", "name",
        "children",  "authority", "lock",     "next_free",   "touched"};
    for (FrameId id = 0; id < kFrames; ++id) {
        for (unsigned at = 0; at < std::size(kNames); ++at) {
            forest.frames.word(id, static_cast<history::HeaderWord>(at)).rename(kNames[at], id);
        }
    }
    forest.word(graph::kCommit).rename("commit", 0);
    forest.word(graph::kCommitLock).rename("lock_of_commits", 0);
    forest.word(graph::kHeldPins).rename("pins", 0);
    forest.word(graph::kNames).rename("names", 0);
    forest.word(graph::kFrameCount).rename("frame_count", 0);
    forest.word(graph::kRecycleFloor).rename("recycle_floor", 0);
}

/// The reader thread's work.
using Reader = std::function<void(const WalkedForest&, const naive::Model&, const Script&)>;

/// Makes the interceptor that seeds a bug, once per execution; none by default.
using MakeFlaw = std::function<std::unique_ptr<sched::Interceptor>(const WalkedForest&)>;

/// One writer (thread 0) runs the script beside one reader.
inline sched::Program program(const Script& script, const Reader& reader,
                              const MakeFlaw& make_flaw = {}) {
    const auto model = std::make_shared<const naive::Model>(model_of(script));
    return [=](sched::Run& run) {
        WalkedForest forest(script);
        name_words(forest);
        for (std::size_t step = 0; step < script.before.size(); ++step) {
            SCHED_REQUIRE(forest.apply(script.before[step], step) ==
                          (script.before[step].kind != Step::kSetCycle));
        }
        const std::unique_ptr<sched::Interceptor> flaw = make_flaw ? make_flaw(forest) : nullptr;
        forest.memory.intercept(flaw.get());
        run.thread("writer", [&] {
            for (std::size_t step = 0; step < script.during.size(); ++step) {
                ForestLock lock(forest.word(graph::kCommitLock));
                lock.lock();
                const bool stored = forest.apply(script.during[step], script.before.size() + step);
                SCHED_REQUIRE(stored == (script.during[step].kind != Step::kSetCycle));
                lock.unlock();
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
            SCHED_REQUIRE(ask(forest, *model, last, question, require));
        }
    };
}

/// Reads as the store does after it was overtaken: without being overtaken again. `commit` selects
/// the state.
template <class Commit>
void ask_once_pinned(const WalkedForest& forest, const naive::Model& model,
                     const Question& question, Commit commit) {
    const graph::Pins<ForestMemory> states(forest.frames, graph::kHeldPins);
    const graph::Pins<ForestMemory> reads(forest.frames, graph::kReadPins);
    const unsigned state = states.take();
    const unsigned epoch = reads.take();
    require(ask(forest, model, commit(), question, require), "a pinned read is not overtaken");
    reads.drop(epoch);
    states.drop(state);
}

/// Reads as the store does: again if overtaken, then pinned.
template <class Commit>
void ask_until_answered(const WalkedForest& forest, const naive::Model& model,
                        const Question& question, Commit commit) {
    constexpr int kTriesBeforePin = 2;
    for (int tries = 0; tries < kTriesBeforePin; ++tries) {
        if (ask(forest, model, commit(), question, require))
            return;
    }
    ask_once_pinned(forest, model, question, commit);
}

/// Asks all questions of one held snapshot.
inline void ask_held(const WalkedForest& forest, const naive::Model& model, const Script& script) {
    const graph::Pins<ForestMemory> pins(forest.frames, graph::kHeldPins);
    const unsigned pin = pins.take(forest.word(graph::kCommit).load_acquire());
    const CommitNumber held = forest.word(graph::kCommit).load_acquire();
    for (const Question& question : script.questions)
        ask_until_answered(forest, model, question, [held] { return held; });
    pins.drop(pin);
}

/// Asks each question of a fresh state.
inline void ask_fresh(const WalkedForest& forest, const naive::Model& model, const Script& script) {
    for (const Question& question : script.questions) {
        ask_until_answered(forest, model, question,
                           [&] { return forest.word(graph::kCommit).load_acquire(); });
    }
}

}  // namespace txn::forest

}  // namespace tfdb
