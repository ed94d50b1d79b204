// What threads do with a commit lock: one program for the walker, for Relacy and for threads.
#pragma once

#include <cstdint>
#include <vector>

#include "tfdb/sync/commit_lock.hpp"

namespace tfdb::sync {

enum class Lane : std::uint8_t { kOrdinary, kUrgent };

/// Threads that count together, in two steps that are right only without another thread in between.
/// `Number` is a number with `add_one`, as each of the three keeps it.
template <class W, int Spins, class Number>
struct CountInTurns {
    W word;
    Number count{};

    [[nodiscard]] BasicCommitLock<W, Spins> lock() { return BasicCommitLock<W, Spins>(word); }
    static void take(BasicCommitLock<W, Spins>& lock, Lane lane) {
        if (lane == Lane::kUrgent)
            lock.lock_urgently();
        else
            lock.lock();
    }
    void thread(Lane lane, long turns) {
        auto mine = lock();
        for (long turn = 0; turn < turns; ++turn) {
            take(mine, lane);
            count.add_one();
            mine.unlock();
        }
    }
    /// Sleeps at most once, so long. True if it had a turn.
    bool thread_that_leaves(Lane lane, std::int64_t longest_ns) {
        auto mine = lock();
        if (!mine.lock_within(longest_ns, lane == Lane::kUrgent))
            return false;
        count.add_one();
        mine.unlock();
        return true;
    }
    /// True if it had a turn.
    bool thread_that_tries() {
        auto mine = lock();
        if (!mine.try_lock())
            return false;
        count.add_one();
        mine.unlock();
        return true;
    }
};

}  // namespace tfdb::sync
