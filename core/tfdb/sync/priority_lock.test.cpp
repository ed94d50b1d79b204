#include "tfdb/sync/priority_lock.hpp"

#include <algorithm>
#include <mutex>
#include <thread>
#include <vector>

#include "tfdb/testing/check.hpp"

namespace tfdb::sync {
namespace {

struct Lock {
    Word word{};
    Word lanes{};
    PriorityLock lock{word, lanes};

    /// How many tickets of a lane have been drawn, modulo 16.
    [[nodiscard]] std::uint64_t drawn(unsigned lane) const {
        return lanes.load_relaxed() >> (8 * lane) & 15;
    }
    void await_drawn(unsigned lane, std::uint64_t tickets) const {
        while (drawn(lane) != tickets)
            std::this_thread::yield();
    }
};

/// Threads that count with plain numbers, thread i in the i-th of `lanes`.
template <class L>
void count_in_turns(const std::vector<unsigned>& lanes, long rounds) {
    Word word{};
    Word lane_word{};
    long first = 0;
    long second = 0;
    std::vector<std::thread> running;
    for (const unsigned lane : lanes) {
        running.emplace_back([&, lane] {
            L lock(word, lane_word);
            for (long round = 0; round < rounds; ++round) {
                lock.lock(lane);
                const std::lock_guard guard(lock, std::adopt_lock);
                ++first;
                second += first;
            }
        });
    }
    for (std::thread& thread : running)
        thread.join();
    const long all = static_cast<long>(lanes.size()) * rounds;
    CHECK_EQ(first, all);
    CHECK_EQ(second, all * (all + 1) / 2);
    CHECK_EQ(word.load_relaxed(), 0U);
    PriorityLock last(word, lane_word);
    CHECK(last.try_lock());  // no ticket is out
}

}  // namespace

TFDB_TEST(priority_lock_lets_one_in_at_a_time) {
    count_in_turns<PriorityLock>({0, 0, 1, 7}, 5'000);
}

TFDB_TEST(priority_lock_that_sleeps_at_once_loses_no_wakeup) {
    count_in_turns<BasicPriorityLock<Word, 0>>({0, 0, 3, 3}, 2'000);
}

TFDB_TEST(priority_lock_has_more_waiters_than_a_lane_has_tickets) {
    count_in_turns<PriorityLock>(std::vector<unsigned>(20, 2), 100);
}

TFDB_TEST(priority_lock_serves_lanes_in_order_then_arrivals) {
    Lock shared;
    std::vector<unsigned> served;
    std::vector<std::thread> running;
    shared.lock.lock();
    const auto ask = [&](unsigned lane, unsigned name) {
        running.emplace_back([&, lane, name] {
            shared.lock.lock(lane);
            served.push_back(name);
            shared.lock.unlock();
        });
    };
    ask(3, 30);
    shared.await_drawn(3, 1);
    ask(7, 70);
    shared.await_drawn(7, 1);
    ask(7, 71);
    shared.await_drawn(7, 2);
    ask(3, 31);
    shared.await_drawn(3, 2);
    CHECK(!shared.lock.try_lock());
    ask(0, 0);
    shared.lock.unlock();
    for (std::thread& thread : running)
        thread.join();
    const auto place = [&](unsigned name) { return std::ranges::find(served, name); };
    CHECK_EQ(served.size(), 5U);
    CHECK(place(70) < place(71));
    CHECK(place(30) < place(31));
    CHECK(place(71) < place(31));  // 30 stood at the lock already, perhaps
    CHECK(place(0) == served.end() - 1);
}

TFDB_TEST(priority_lock_of_lane_0_fails_to_try_while_a_lane_waits) {
    Lock shared;
    CHECK(shared.lock.try_lock());
    CHECK(!shared.lock.try_lock());
    std::thread high([&] {
        shared.lock.lock(1);
        shared.lock.unlock();
    });
    shared.await_drawn(1, 1);
    shared.lock.unlock();
    high.join();
    CHECK(shared.lock.try_lock());
    shared.lock.unlock();
}

/// The bound: beside threads that commit as fast as they can, a request of lane 7 is overtaken by
/// one commit in progress and one of each thread that had passed the lanes.
TFDB_TEST(priority_lock_keeps_its_bound_beside_busy_threads) {
    constexpr std::uint64_t kBusy = 4;
    Lock shared;
    Word stop{};
    std::uint64_t commits = 0;  // only under the lock
    std::vector<std::thread> running;
    for (std::uint64_t thread = 0; thread < kBusy; ++thread) {
        running.emplace_back([&] {
            while (stop.load_relaxed() == 0) {
                const std::lock_guard guard(shared.lock);
                ++commits;
            }
        });
    }
    for (int i = 0; i < 200; ++i) {
        // The ticket is drawn under the lock, so that the count at that moment is known.
        shared.lock.lock();
        const std::uint64_t before = commits;
        const std::uint64_t tickets = shared.drawn(7);
        std::uint64_t overtaken = 0;
        std::thread high([&] {
            shared.lock.lock(7);
            overtaken = commits - before;
            shared.lock.unlock();
        });
        shared.await_drawn(7, (tickets + 1) & 15);
        shared.lock.unlock();
        high.join();
        CHECK(overtaken <= kBusy);
    }
    stop.store_relaxed(1);
    for (std::thread& thread : running)
        thread.join();
}

}  // namespace tfdb::sync
