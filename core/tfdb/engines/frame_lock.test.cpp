#include "tfdb/engines/frame_lock.hpp"

#include <thread>
#include <vector>

#include "tfdb/engines/event.hpp"
#include "tfdb/testing/check.hpp"

namespace tfdb::sync {
namespace {

bool never() {
    return false;
}

}  // namespace

TFDB_TEST(frame_lock_keeps_the_table_of_compatibility) {
    for (const bool first : {false, true}) {
        for (const bool second : {false, true}) {
            Word word{};
            FrameLock lock(word);
            CHECK((first ? lock.try_exclusive(3) : lock.try_shared(3)).granted);
            const auto attempt = second ? lock.try_exclusive(61) : lock.try_shared(61);
            CHECK_EQ(attempt.granted, !first && !second);
            CHECK_EQ(attempt.others(61), FrameLock::bit(3));
            CHECK_EQ(lock.held_exclusively_by(3), first);
            CHECK(lock.held_by(3));
            CHECK_EQ(lock.held_by(61), attempt.granted);
        }
    }
}

TFDB_TEST(frame_lock_is_granted_again_and_upgraded) {
    Word word{};
    FrameLock lock(word);
    CHECK(lock.try_shared(0).granted);
    CHECK(lock.try_shared(0).granted);
    CHECK(lock.try_shared(9).granted);
    const auto refused = lock.try_exclusive(0);
    CHECK(!refused.granted);
    CHECK_EQ(refused.others(0), FrameLock::bit(9));
    CHECK(!lock.release(9));
    CHECK(lock.try_exclusive(0).granted);
    CHECK(lock.try_exclusive(0).granted);
    CHECK(lock.try_shared(0).granted);
    CHECK(lock.held_exclusively_by(0));
    CHECK(!lock.release(0));
    CHECK_EQ(lock.holders(), 0U);
    CHECK_EQ(word.load_relaxed(), 0U);
}

TFDB_TEST(frame_lock_tells_who_leaves_whether_somebody_waits) {
    Word word{};
    FrameLock lock(word);
    for (const unsigned slot : {1U, 2U, 3U})
        CHECK(lock.try_shared(slot).granted);
    const auto refused = lock.try_exclusive(4);
    CHECK(lock.mark_waited(refused));
    CHECK(!lock.mark_waited(refused));   // the lock has changed since
    CHECK(lock.try_shared(5).waited());  // granted nevertheless
    CHECK(!lock.release(5));
    CHECK(!lock.release(1));  // two holders are left
    CHECK(lock.release(2));   // slot 3 may be waiting for an upgrade
    CHECK(!lock.release(3));
    CHECK_EQ(word.load_relaxed(), 0U);
}

TFDB_TEST(frame_lock_guards_plain_data) {
    constexpr unsigned kThreads = 4;
    constexpr long kRounds = 5'000;
    Word word{};
    Word epochs{};
    long first = 0;
    long second = 0;
    std::vector<std::thread> running;
    for (unsigned slot = 0; slot < kThreads; ++slot) {
        running.emplace_back([&, slot] {
            FrameLock lock(word);
            BasicEvent<Word, 0> event(epochs);
            for (long round = 0; round < kRounds; ++round) {
                const bool writes = (round + slot) % 3 == 0;
                for (;;) {
                    const auto attempt = writes ? lock.try_exclusive(slot) : lock.try_shared(slot);
                    if (attempt)
                        break;
                    lock.wait_for(attempt, event, never);
                }
                CHECK_EQ(second, 2 * first);
                if (writes) {
                    first += 1;
                    second += 2;
                }
                if (lock.release(slot))
                    event.notify_all();
            }
        });
    }
    for (std::thread& thread : running)
        thread.join();
    CHECK(first > 0);
    CHECK_EQ(second, 2 * first);
    CHECK_EQ(word.load_relaxed(), 0U);
}

}  // namespace tfdb::sync
