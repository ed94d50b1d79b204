// The promises of words, walked; and words that break them, detected.
#include "tfdb/sync/word.hpp"

#include <concepts>
#include <memory>

#include "tfdb/sync/flaws.sched.hpp"
#include "tfdb/testing/sched/flaws.hpp"

namespace tfdb::sync {

namespace {

using sched::Program;
using sched::Run;
using sched::Walk;
using namespace flaws;

/// The walked word has the interface of the production word, so that templates work with both.
template <class W>
concept IsWord = requires(W word, const W& constant, std::uint64_t value, std::uint64_t& found) {
    { constant.load_relaxed() } -> std::same_as<std::uint64_t>;
    { constant.load_acquire() } -> std::same_as<std::uint64_t>;
    { constant.load_ordered() } -> std::same_as<std::uint64_t>;
    { word.compare_exchange(found, value) } -> std::same_as<bool>;
    { word.compare_exchange_ordered(found, value) } -> std::same_as<bool>;
    { word.exchange(value) } -> std::same_as<std::uint64_t>;
    { word.fetch_add(value) } -> std::same_as<std::uint64_t>;
    { word.store_relaxed(value) } -> std::same_as<void>;
    { word.store_release(value) } -> std::same_as<void>;
    { constant.wait(value) } -> std::same_as<void>;
    { word.notify_one() } -> std::same_as<void>;
    { word.notify_all() } -> std::same_as<void>;
    { W::fence_acquire() } -> std::same_as<void>;
    { W::fence_release() } -> std::same_as<void>;
    { W::fence_full() } -> std::same_as<void>;
};
static_assert(IsWord<Word> && IsWord<sched::Word>);

/// Three threads add to one word in three different ways: no addition is lost.
template <class W>
Program added() {
    return [](Run& run) {
        W word;
        word.rename("sum", 0);
        run.thread("adds", [&] { word.fetch_add(1); });
        run.thread("compares", [&] {
            std::uint64_t found = word.load_relaxed();
            while (!word.compare_exchange(found, found + 10)) {
            }
        });
        run.thread("exchanges", [&] {
            const std::uint64_t taken = word.exchange(0);
            word.fetch_add(taken + 100);
        });
        run.join();
        SCHED_REQUIRE(word.peek() == 111);
    };
}

/// Each thread announces itself, then checks for the other: at least one sees the other.
Program announced(bool buffered) {
    return [buffered](Run& run) {
        sched::Word mine(0, "mine");
        sched::Word theirs(0, "theirs");
        sched::Word end(0, "end");
        sched::Delays buffer(
            0, [&](const sched::Word& word) { return &word == &mine; }, end);
        mine.intercept(buffered ? &buffer : nullptr);
        end.intercept(buffered ? &buffer : nullptr);
        std::uint64_t seen = 0;
        run.thread("first", [&] {
            std::uint64_t found = 0;
            mine.compare_exchange_ordered(found, 1);
            seen += theirs.load_ordered();
            end.store_relaxed(1);
        });
        run.thread("second", [&] {
            std::uint64_t found = 0;
            theirs.compare_exchange_ordered(found, 1);
            seen += mine.load_ordered();
        });
        run.join();
        SCHED_REQUIRE(seen != 0);
    };
}

/// Two threads sleep until a third changes the word.
template <class W>
Program awaited() {
    return [](Run& run) {
        W word;
        word.rename("awaited", 0);
        for (const char* name : {"sleeps", "sleeps too"}) {
            run.thread(name, [&] {
                word.wait(0);
                SCHED_REQUIRE(word.load_relaxed() == 1);
            });
        }
        run.thread("wakes", [&] {
            word.store_relaxed(1);
            word.notify_all();
        });
        run.join();
    };
}

}  // namespace

TFDB_SCHED(word_keeps_its_promises) {
    Walk walk;
    walk.must_hold("three that add", added<Sound>());
    walk.must_hold("ordered announcements", announced(false));
    walk.must_hold("two that sleep", awaited<Sound>());
}

TFDB_SCHED(word_flaws_are_found) {
    Walk walk;
    walk.must_fail("fetch_add in two steps", "peek() == 111", added<SplitFetchAdd>());
    walk.must_fail("compare_exchange in two steps", "peek() == 111", added<SplitCompareExchange>());
    walk.must_fail("exchange in two steps", "peek() == 111", added<SplitExchange>());
    walk.must_fail("a store that comes after the load behind it", "seen != 0", announced(true));
    walk.must_fail("a change that wakes no thread", kDeadlock, awaited<SilentNotify>());
    walk.must_fail("a change that wakes one", kDeadlock, awaited<NarrowNotify>());
    walk.must_fail("sleeping without looking again", kDeadlock, awaited<BlindWait>());
}

}  // namespace tfdb::sync
