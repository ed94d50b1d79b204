// Programs on a commit lock: the same for the walker, for Relacy and for threads.
#pragma once

#include <cstdint>
#include <vector>

#include "tfdb/sync/commit_lock.hpp"

namespace tfdb::sync {

enum class Lane : std::uint8_t { kOrdinary, kUrgent };

/// Threads that increment a number in two steps, which is correct only under mutual exclusion.
/// `Number` has `add_one`, in a form for each of the three.
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
    /// Sleeps at most once, for that long. True if it got the lock.
    bool thread_that_leaves(Lane lane, std::int64_t longest_ns) {
        auto mine = lock();
        if (!mine.lock_within(longest_ns, lane == Lane::kUrgent))
            return false;
        count.add_one();
        mine.unlock();
        return true;
    }
    /// True if it got the lock.
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
