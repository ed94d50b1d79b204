#include "tfdb/engines/backoff.hpp"

#include <set>

#include "tfdb/testing/check.hpp"

namespace tfdb::sync {
namespace {

/// The parts of the last pause.
struct Spent {
    std::uint64_t spins = 0;
    std::uint64_t yields = 0;
    std::uint64_t slept = 0;
};
Spent g_spent;

struct RecordingPause {
    static void spin() { g_spent.spins += 1; }
    static void yield() { g_spent.yields += 1; }
    static void sleep(std::uint32_t nanoseconds) { g_spent.slept += nanoseconds; }
};
using Recorded = BasicBackoff<RecordingPause>;

Spent next(Recorded& backoff) {
    g_spent = {};
    backoff.pause();
    return g_spent;
}

}  // namespace

TFDB_TEST(backoff_waits_longer_each_time_within_its_bounds) {
    for (std::uint64_t seed = 0; seed < 100; ++seed) {
        Recorded backoff(seed);
        for (unsigned step = 0; step < 100; ++step) {
            const Spent spent = next(backoff);
            if (step < Recorded::kSpinSteps) {
                const std::uint64_t window = std::uint64_t{1} << step;
                CHECK(spent.spins >= window / 2 && spent.spins >= 1 && spent.spins <= window);
                CHECK_EQ(spent.yields + spent.slept, 0U);
            } else if (step < Recorded::kSpinSteps + Recorded::kYieldSteps) {
                CHECK(spent.yields >= 1 && spent.yields <= Recorded::kMostYields);
                CHECK_EQ(spent.spins + spent.slept, 0U);
            } else {
                CHECK(spent.slept >= Recorded::kFirstSleep / 2);
                CHECK(spent.slept <= Recorded::kLongestSleep);
                CHECK_EQ(spent.spins + spent.yields, 0U);
            }
        }
        backoff.reset();
        CHECK_EQ(next(backoff).spins, 1U);
    }
}

TFDB_TEST(backoff_of_two_sessions_is_not_in_step) {
    std::set<std::uint64_t> seen;
    for (std::uint64_t seed = 0; seed < 100; ++seed) {
        Recorded backoff(seed);
        for (int step = 0; step < 50; ++step)
            (void)next(backoff);
        seen.insert(next(backoff).slept);
    }
    CHECK(seen.size() > 90);
}

TFDB_TEST(backoff_really_waits_and_comes_back) {
    Backoff backoff(1);
    for (int step = 0; step < 20; ++step)
        backoff.pause();
    CHECK(true);
}

}  // namespace tfdb::sync
