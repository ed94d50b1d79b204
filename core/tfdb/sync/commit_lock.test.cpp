#include "tfdb/sync/commit_lock.hpp"

#include <mutex>
#include <thread>
#include <vector>

#include "tfdb/testing/check.hpp"

namespace tfdb::sync {
namespace {

/// Threads that count with plain numbers: a race or a lost number would show.
template <class Lock>
void count_in_turns(int threads, long rounds) {
    Word word{};
    long first = 0;
    long second = 0;
    std::vector<std::thread> running;
    for (int i = 0; i < threads; ++i) {
        running.emplace_back([&] {
            Lock lock(word);
            for (long round = 0; round < rounds; ++round) {
                const std::lock_guard guard(lock);
                ++first;
                second += first;
            }
        });
    }
    for (std::thread& thread : running)
        thread.join();
    const long all = threads * rounds;
    CHECK_EQ(first, all);
    CHECK_EQ(second, all * (all + 1) / 2);
    CHECK_EQ(word.load_relaxed(), 0U);
}

}  // namespace

TFDB_TEST(commit_lock_lets_one_in_at_a_time) {
    count_in_turns<CommitLock>(4, 20'000);
}

TFDB_TEST(commit_lock_that_sleeps_at_once_loses_no_wakeup) {
    count_in_turns<BasicCommitLock<Word, 0>>(4, 5'000);
}

TFDB_TEST(commit_lock_try_lock_fails_while_it_is_held) {
    Word word{};
    CommitLock mine(word);
    CommitLock other(word);
    CHECK(mine.try_lock());
    CHECK(!other.try_lock());
    mine.unlock();
    CHECK(other.try_lock());
    other.unlock();
}

TFDB_TEST(commit_lock_tries_beside_sleepers) {
    Word word{};
    long counted = 0;
    long tried = 0;
    std::thread sleeper([&] {
        CommitLock lock(word);
        for (int i = 0; i < 10'000; ++i) {
            const std::lock_guard guard(lock);
            ++counted;
        }
    });
    CommitLock lock(word);
    for (int i = 0; i < 10'000; ++i) {
        const std::unique_lock guard(lock, std::try_to_lock);
        if (guard.owns_lock()) {
            ++counted;
            ++tried;
        }
    }
    sleeper.join();
    CHECK_EQ(counted, 10'000 + tried);
}

}  // namespace tfdb::sync
