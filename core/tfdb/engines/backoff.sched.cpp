// Sessions that back off from each other: the length of their pauses, and that they lose step.
#include "tfdb/engines/backoff.hpp"

#include <string>

#include "tfdb/sync/flaws.sched.hpp"

namespace tfdb::sync {

namespace {

using sched::Program;
using sched::Run;
using sched::Walk;

/// The parts of the current thread's pauses; a walk runs one thread at a time.
struct Spent {
    std::uint64_t spins = 0;
    std::uint64_t yields = 0;
    std::uint64_t slept = 0;  // ns
};
Spent g_spent;

struct RecordingPause {
    static void spin() { g_spent.spins += 1; }
    static void yield() { g_spent.yields += 1; }
    static void sleep(std::uint32_t nanoseconds) { g_spent.slept += nanoseconds; }
};

/// A pause that grows without a bound.
struct UnboundedPause : RecordingPause {
    static void sleep(std::uint32_t nanoseconds) { g_spent.slept += g_spent.slept + nanoseconds; }
};

template <class Pause>
Spent pause_once(BasicBackoff<Pause>& backoff) {
    g_spent.spins = g_spent.yields = 0;
    const std::uint64_t before = g_spent.slept;
    backoff.pause();
    return {g_spent.spins, g_spent.yields, g_spent.slept - before};
}

/// Two threads that need both locks, in opposite order, and never wait for one: each releases its
/// locks, pauses and retries, at most so often that the walk ends.
template <class Pause>
Program crossed(std::uint64_t tries) {
    return [tries](Run& run) {
        g_spent = {};
        sched::Word locks[2];
        locks[0].rename("lock", 1);
        locks[1].rename("lock", 2);
        const auto take = [](sched::Word& lock) {
            std::uint64_t free = 0;
            return lock.compare_exchange(free, 1);
        };
        for (unsigned first = 0; first < 2; ++first) {
            run.thread("session" + std::to_string(first), [&, first] {
                BasicBackoff<Pause> backoff(first);
                for (int step = 0; step < 8; ++step)
                    backoff.pause();  // it has failed a few times already: no more spins
                for (std::uint64_t i = 0; i < tries; ++i) {
                    if (take(locks[first])) {
                        const bool both = take(locks[1 - first]);
                        if (both)
                            locks[1 - first].store_release(0);
                        locks[first].store_release(0);
                        if (both)
                            return;
                    }
                    const Spent spent = pause_once(backoff);
                    const bool is_bounded = spent.slept <= BasicBackoff<Pause>::kLongestSleep &&
                                            spent.yields <= BasicBackoff<Pause>::kMostYields;
                    SCHED_REQUIRE(is_bounded);
                }
            });
        }
        run.join();
        SCHED_REQUIRE(locks[0].peek() == 0 && locks[1].peek() == 0);
    };
}

/// The number of rounds until two threads that collide after equal pauses have diverged.
int rounds_in_step(std::uint64_t one_seed, std::uint64_t other_seed) {
    BasicBackoff<RecordingPause> one(one_seed);
    BasicBackoff<RecordingPause> other(other_seed);
    for (int round = 0; round < 100; ++round) {
        const Spent mine = pause_once(one);
        const Spent theirs = pause_once(other);
        if (mine.spins != theirs.spins || mine.slept != theirs.slept)
            return round;
    }
    return 100;
}

}  // namespace

TFDB_SCHED(backoff_keeps_its_bounds) {
    Walk walk;
    walk.must_hold("two that lock crosswise", crossed<RecordingPause>(3));
    walk.must_fail("a pause without a bound", "is_bounded", crossed<UnboundedPause>(5));
}

TFDB_SCHED(backoff_brings_sessions_apart) {
    constexpr std::uint64_t kSeeds = 50;
    int longest = 0;
    for (std::uint64_t one = 0; one < kSeeds; ++one) {
        for (std::uint64_t other = one + 1; other < kSeeds; ++other)
            longest = std::max(longest, rounds_in_step(one, other));
    }
    std::printf("  %llu seeds, each against each: apart after at most %d rounds\n",
                static_cast<unsigned long long>(kSeeds), longest);
    SCHED_EXPECT(longest <= 10);
    SCHED_EXPECT(rounds_in_step(7, 7) == 100);  // the same seed: no jitter
}

}  // namespace tfdb::sync
