#include "tfdb/engines/version_lock.hpp"

#include <thread>
#include <vector>

#include "tfdb/engines/event.hpp"
#include "tfdb/testing/check.hpp"

namespace tfdb::sync {

TFDB_TEST(version_lock_tells_of_changes_only) {
    Word word{};
    VersionLock lock(word);
    const std::uint64_t before = lock.version();
    CHECK(!VersionLock::locked(before));
    CHECK(lock.try_lock());
    CHECK(!lock.try_lock());
    CHECK(VersionLock::locked(lock.version()));
    CHECK(!lock.unchanged(before));
    CHECK(lock.unchanged_until_mine(before));
    CHECK(!lock.unlock(false));
    CHECK(lock.unchanged(before));
    CHECK(lock.try_lock());
    CHECK(!lock.unlock(true));
    CHECK(!lock.unchanged(before));
    CHECK(lock.unchanged(lock.version()));
    CHECK(lock.try_lock());
    CHECK(!lock.unchanged_until_mine(before));
    CHECK(!lock.unlock(true));
}

TFDB_TEST(version_lock_shows_readers_whole_pairs) {
    constexpr std::uint64_t kWriters = 3;
    constexpr std::uint64_t kRounds = 5'000;
    Word word{};
    Word epochs{};
    Word first{};
    Word second{};
    long of_writers = 0;
    std::vector<std::thread> running;
    for (std::uint64_t writer = 0; writer < kWriters; ++writer) {
        running.emplace_back([&] {
            BasicVersionLock<Word, 0> lock(word);
            BasicEvent<Word, 0> event(epochs);
            for (std::uint64_t round = 0; round < kRounds; ++round) {
                lock.lock(event);
                ++of_writers;
                first.store_relaxed(first.load_relaxed() + 1);
                second.store_relaxed(second.load_relaxed() + 2);
                if (lock.unlock(true))
                    event.notify_all();
            }
        });
    }
    running.emplace_back([&] {
        const VersionLock lock(word);
        while (lock.version() < 4 * kWriters * kRounds) {
            const std::uint64_t version = lock.version();
            const std::uint64_t one = first.load_relaxed();
            const std::uint64_t other = second.load_relaxed();
            if (!VersionLock::locked(version) && lock.unchanged(version))
                CHECK_EQ(other, 2 * one);
        }
    });
    for (std::thread& thread : running)
        thread.join();
    CHECK_EQ(first.load_relaxed(), kWriters * kRounds);
    CHECK_EQ(of_writers, static_cast<long>(kWriters * kRounds));
    CHECK_EQ(word.load_relaxed(), 4 * kWriters * kRounds);
}

}  // namespace tfdb::sync
