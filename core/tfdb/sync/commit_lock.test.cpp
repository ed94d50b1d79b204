#include <mutex>
#include <thread>
#include <vector>

#include "tfdb/sync/commit_lock.sched.hpp"
#include "tfdb/testing/check.hpp"

namespace tfdb::sync {
namespace {

/// Not atomic: a race or a lost update would show.
struct Number {
    long turns = 0;
    long sum = 0;
    void add_one() { sum += ++turns; }
};

constexpr Lane kOrdinary = Lane::kOrdinary;
constexpr Lane kUrgent = Lane::kUrgent;
constexpr std::uint64_t kOneUrgent = 4;

template <int Spins>
void count_in_turns(const std::vector<Lane>& lanes, long rounds) {
    CountInTurns<Word, Spins, Number> turns;
    std::vector<std::thread> running;
    for (const Lane lane : lanes)
        running.emplace_back([&, lane] { turns.thread(lane, rounds); });
    for (std::thread& thread : running)
        thread.join();
    const long all = static_cast<long>(lanes.size()) * rounds;
    CHECK_EQ(turns.count.turns, all);
    CHECK_EQ(turns.count.sum, all * (all + 1) / 2);
    CHECK_EQ(turns.word.load_relaxed(), 0U);
}

void await_urgent(const Word& word, std::uint64_t requests) {
    while (word.load_relaxed() / kOneUrgent != requests)
        std::this_thread::yield();
}

}  // namespace

TFDB_TEST(commit_lock_lets_one_in_at_a_time) {
    count_in_turns<100>({kOrdinary, kOrdinary, kOrdinary, kOrdinary}, 20'000);
    count_in_turns<100>({kOrdinary, kOrdinary, kUrgent, kUrgent}, 5'000);
}

TFDB_TEST(commit_lock_that_sleeps_at_once_loses_no_wakeup) {
    count_in_turns<0>({kOrdinary, kOrdinary, kOrdinary, kOrdinary}, 5'000);
    count_in_turns<0>({kOrdinary, kOrdinary, kUrgent, kUrgent}, 2'000);
    count_in_turns<0>(std::vector<Lane>(20, kUrgent), 100);
}

TFDB_TEST(commit_lock_tries_beside_sleepers) {
    CountInTurns<Word, 100, Number> turns;
    std::thread sleeper([&] { turns.thread(kOrdinary, 10'000); });
    long tried = 0;
    for (int i = 0; i < 10'000; ++i)
        tried += turns.thread_that_tries() ? 1 : 0;
    sleeper.join();
    CHECK_EQ(turns.count.turns, 10'000 + tried);
}

TFDB_TEST(commit_lock_try_lock_fails_while_it_is_held_or_asked_for_urgently) {
    Word word{};
    CommitLock mine(word);
    CommitLock other(word);
    CHECK(mine.try_lock());
    CHECK(!other.try_lock());
    std::thread urgent([&] {
        CommitLock lock(word);
        lock.lock_urgently();
        lock.unlock();
    });
    await_urgent(word, 1);
    mine.unlock();
    urgent.join();
    CHECK(other.try_lock());
    CHECK(other.in_use());
    other.unlock();
    CHECK(!other.in_use());
}

TFDB_TEST(commit_lock_may_be_left_by_who_waits) {
    Word word{};
    CommitLock holder(word);
    CommitLock other(word);
    constexpr std::int64_t kMillisecond = 1'000'000;
    for (const bool urgently : {false, true}) {
        CHECK(holder.try_lock());
        CHECK(!other.lock_within(kMillisecond, urgently));
        CHECK_EQ(word.load_relaxed() / kOneUrgent, 0U);
        holder.unlock();
        CHECK_EQ(word.load_relaxed(), 0U);
        CHECK(other.lock_within(kMillisecond, urgently));
        other.unlock();
    }
}

TFDB_TEST(commit_lock_that_some_leave_loses_no_wakeup) {
    CountInTurns<Word, 0, Number> turns;
    std::vector<std::thread> running;
    for (const Lane lane : {kOrdinary, kOrdinary, kUrgent})
        running.emplace_back([&, lane] { turns.thread(lane, 3'000); });
    std::vector<long> had(2);
    for (const Lane lane : {kOrdinary, kUrgent}) {
        running.emplace_back([&, lane] {
            for (int i = 0; i < 3'000; ++i)
                had[lane == kUrgent] += turns.thread_that_leaves(lane, 1'000) ? 1 : 0;
        });
    }
    for (std::thread& thread : running)
        thread.join();
    CHECK_EQ(turns.count.turns, 9'000 + had[0] + had[1]);
    CHECK_EQ(turns.word.load_relaxed(), 0U);
}

/// Beside threads that commit at full speed, an urgent request waits only for the holder.
TFDB_TEST(commit_lock_goes_to_an_urgent_request_next) {
    Word word{};
    CommitLock lock(word);
    Word stop{};
    std::uint64_t commits = 0;  // only under the lock
    std::vector<std::thread> running;
    for (int thread = 0; thread < 4; ++thread) {
        running.emplace_back([&] {
            while (stop.load_relaxed() == 0) {
                const std::lock_guard guard(lock);
                ++commits;
            }
        });
    }
    for (int i = 0; i < 200; ++i) {
        lock.lock();
        const std::uint64_t before = commits;
        std::uint64_t overtaken = 0;
        std::thread urgent([&] {
            lock.lock_urgently();
            overtaken = commits - before;
            lock.unlock();
        });
        await_urgent(word, 1);
        lock.unlock();
        urgent.join();
        CHECK_EQ(overtaken, 0U);
    }
    stop.store_relaxed(1);
    for (std::thread& thread : running)
        thread.join();
}

}  // namespace tfdb::sync
