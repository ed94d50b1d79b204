#include "tfdb/engines/event.hpp"

#include <thread>
#include <vector>

#include "tfdb/testing/check.hpp"

namespace tfdb::sync {
namespace {

/// Threads that pass a number round: each waits for its turn.
template <class E>
void pass_round(std::uint64_t threads, std::uint64_t rounds) {
    Word word{};
    Word turn{};
    std::vector<std::thread> running;
    for (std::uint64_t thread = 0; thread < threads; ++thread) {
        running.emplace_back([&, thread] {
            E event(word);
            for (std::uint64_t round = 0; round < rounds; ++round) {
                const std::uint64_t mine = round * threads + thread;
                event.await([&] { return turn.load_acquire() == mine; });
                turn.store_release(mine + 1);
                event.notify_all();
            }
        });
    }
    for (std::thread& thread : running)
        thread.join();
    CHECK_EQ(turn.load_relaxed(), threads * rounds);
    CHECK_EQ(word.load_relaxed() & 0xFFFF, 0U);
}

}  // namespace

TFDB_TEST(event_hands_over_between_threads) {
    pass_round<Event>(3, 3'000);
}

TFDB_TEST(event_that_sleeps_at_once_loses_no_wakeup) {
    pass_round<BasicEvent<Word, 0>>(4, 1'000);
}

TFDB_TEST(event_that_nobody_waits_for_stays_as_it_is) {
    Word word{};
    Event event(word);
    event.notify_all();
    CHECK_EQ(word.load_relaxed(), 0U);
    const Event::Epoch epoch = event.prepare();
    event.notify_all();
    event.wait(epoch);  // already notified: does not sleep
    const Event::Epoch later = event.prepare();
    CHECK(later != epoch);
    event.cancel();
    event.notify_all();
    CHECK_EQ(event.prepare(), later);
    event.cancel();
}

}  // namespace tfdb::sync
