// Every interleaving of waiting threads and of writers that fulfil their conditions.
#include "tfdb/sync/wait_group.hpp"

#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "tfdb/sync/flaws.sched.hpp"
#include "tfdb/testing/sched/flaws.hpp"

namespace tfdb::sync {

namespace {

using sched::Program;
using sched::Run;
using sched::Walk;
using namespace flaws;

/// Unlimited, or with that many short sleeps.
struct Deadline {
    std::optional<int> sleeps{};

    std::int64_t left() {
        if (!sleeps)
            return std::numeric_limits<std::int64_t>::max();
        return (*sleeps)-- > 0 ? 1 : 0;
    }
    static bool heeds_signals() { return false; }
    static void signalled() {}
};

/// The condition of several threads: a counter reaches a number, different for each thread.
template <class W>
struct Room {
    using WaitGroup = BasicWaitGroup<W, 0, 0>;
    struct Wait {
        typename WaitGroup::Waiter waiter{};
        std::uint64_t least;
    };

    explicit Room(Run& run) : group(event_word) {
        event_word.rename("event", 0);
        run.touch(event_word);
    }

    W event_word;
    sched::Word counter{0, "counter"};
    WaitGroup group;
    std::vector<Wait*> waits;
    bool closed = false;

    /// Whether the number was reached.
    bool wait_for(std::uint64_t least, Deadline deadline = {}) {
        Wait wait{.least = least};
        const typename WaitGroup::Locked locked(group);
        if (closed || counter.load_acquire() >= least)
            return !closed;
        waits.push_back(&wait);
        group.wait(
            wait.waiter, [this] { look(); }, deadline);
        std::erase(waits, &wait);
        return wait.waiter.ended();
    }
    void look() {
        const std::uint64_t now = counter.load_acquire();
        std::erase_if(waits, [&](Wait* wait) {
            if (wait->least > now)
                return false;
            group.end(wait->waiter);
            return true;
        });
    }
    void close() {
        const typename WaitGroup::Locked locked(group);
        closed = true;
        for (Wait* const wait : waits)
            group.end(wait->waiter);
        waits.clear();
        group.notify();
    }
    void commit() {
        counter.fetch_add(1);
        BasicEventCount<W>(event_word).notify();
    }
};

/// The commits awaited by each thread, and the number of commits, each in its own thread or not.
template <class W = Sound>
Program waiting(const std::vector<std::uint64_t>& waits, int writers, int commits_each) {
    return [=](Run& run) {
        Room<W> room(run);
        for (const std::uint64_t least : waits) {
            run.thread("waits for " + std::to_string(least),
                       [&room, least] { SCHED_REQUIRE(room.wait_for(least)); });
        }
        for (int writer = 0; writer < writers; ++writer) {
            run.thread("writer", [&room, commits_each] {
                for (int i = 0; i < commits_each; ++i)
                    room.commit();
            });
        }
        run.join();
        SCHED_REQUIRE(room.waits.empty());
    };
}

/// One thread's deadline passes, perhaps while it leads; the other must still be woken.
Program with_deadline(int sleeps) {
    return [=](Run& run) {
        Room<Sound> room(run);
        run.thread("with_deadline",
                   [&room, sleeps] { (void)room.wait_for(2, {.sleeps = sleeps}); });
        run.thread("patient", [&room] { SCHED_REQUIRE(room.wait_for(1)); });
        run.thread("writer", [&room] { room.commit(); });
        run.join();
    };
}

/// Two threads wait for an event that never comes; closing ends both.
Program closing() {
    return [](Run& run) {
        Room<Sound> room(run);
        for (int i = 0; i < 2; ++i)
            run.thread("waits", [&room] { (void)room.wait_for(9); });
        run.thread("closes", [&room] { room.close(); });
        run.join();
    };
}

/// A listener in another process is killed at some step; the writer and the other listeners
/// continue.
Program with_death(std::size_t accesses) {
    return [=](Run& run) {
        sched::Word event_word(0, "event");
        sched::Word counter(0, "counter");
        const auto listen = [&] {
            BasicEventCount<sched::Word> event(event_word);
            for (;;) {
                const std::uint64_t armed = event.arm();
                if (counter.load_acquire() >= 2)
                    return;
                (void)event.sleep(armed, 0);
            }
        };
        run.thread("dies", listen, accesses);
        run.thread("listens", listen);
        run.thread("writer", [&] {
            for (int i = 0; i < 2; ++i) {
                counter.fetch_add(1);
                BasicEventCount<sched::Word>(event_word).notify();
            }
        });
        run.join();
    };
}

/// A listener that checks first and arms afterwards.
Program looks_too_early() {
    return [](Run& run) {
        sched::Word event_word(0, "event");
        sched::Word done(0, "done");
        run.thread("listens", [&] {
            BasicEventCount<sched::Word> event(event_word);
            if (done.load_acquire() == 0)
                (void)event.sleep(event.arm(), 0);
        });
        run.thread("writer", [&] {
            done.store_release(1);
            BasicEventCount<sched::Word>(event_word).notify();
        });
        run.join();
    };
}

/// Clears the event's bit only after all were woken: a thread that arms in between is not woken.
struct WakesThenClears : sched::Word {
    bool compare_exchange(std::uint64_t& expected, std::uint64_t desired) {
        const bool rings = (expected & 1) != 0 && (desired & 1) == 0;
        if (!rings)
            return sched::Word::compare_exchange(expected, desired);
        sched::Word::notify_all();
        return sched::Word::compare_exchange(expected, desired);
    }
    void wake_all() {}
};

struct SilentWake : sched::Word {
    void wake_all() {}
};

/// Sleeps regardless of the word's value.
struct BlindSleep : sched::Word {
    Woken sleep(std::uint64_t, std::int64_t) const { return sched::Word::sleep(load_acquire(), 0); }
};

}  // namespace

TFDB_SCHED(wait_group_loses_no_wake_up) {
    Walk walk;
    walk.must_hold("one waits, one commit", waiting({1}, 1, 1));
    walk.must_hold("one waits for the second of two commits", waiting({2}, 1, 2));
    walk.must_hold("one waits, two writers", waiting({2}, 2, 1));
    sched::Options options;
    options.preemptions = 2;
    Walk bounded(options);
    bounded.must_hold("two wait for the same commit", waiting({1, 1}, 1, 1));
    bounded.must_hold("two wait, for one commit each", waiting({1, 2}, 1, 2));
    bounded.must_hold("one deadline passes at once", with_deadline(2));
    bounded.must_hold("one deadline passes later", with_deadline(4));
    bounded.must_hold("closing ends all waits", closing());
}

TFDB_SCHED(event_count_survives_the_deaths_of_listeners) {
    Walk walk;
    for (std::size_t accesses = 0; accesses < 6; ++accesses)
        walk.must_hold("a death after " + std::to_string(accesses), with_death(accesses));
}

TFDB_SCHED(wait_group_flaws_are_found) {
    Walk walk;
    walk.must_fail("a event that wakes no thread", kDeadlock, waiting<SilentWake>({1}, 1, 1));
    walk.must_fail("a event that wakes, then clears", kDeadlock,
                   waiting<WakesThenClears>({2}, 1, 2));
    walk.must_fail("sleeping without looking again", kDeadlock, waiting<BlindSleep>({1}, 1, 1));
    walk.must_fail("looking before arming", kDeadlock, looks_too_early());
}

}  // namespace tfdb::sync
