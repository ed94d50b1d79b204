// Every interleaving of the event count, and of the event count with one atomic operation broken.
#include "tfdb/engines/event.hpp"

#include <string>

#include "tfdb/sync/flaws.sched.hpp"
#include "tfdb/testing/sched/flaws.hpp"

namespace tfdb::sync {

namespace {

using sched::Program;
using sched::Run;
using sched::Walk;
using namespace flaws;

/// Each waiter waits until as many workers have done their part.
template <class W, int Spins>
Program counted(int waiters, int workers) {
    return [=](Run& run) {
        W word;
        word.rename("event", 0);
        sched::Word parts(0, "parts");
        const auto all = static_cast<std::uint64_t>(workers);
        for (int waiter = 0; waiter < waiters; ++waiter) {
            run.thread("waiter" + std::to_string(waiter), [&] {
                BasicEvent<W, Spins> event(word);
                event.await([&] { return parts.load_acquire() == all; });
            });
        }
        for (int worker = 0; worker < workers; ++worker) {
            run.thread("worker" + std::to_string(worker), [&] {
                parts.fetch_add(1);
                BasicEvent<W, Spins>(word).notify_all();
            });
        }
        run.join();
        SCHED_REQUIRE((word.peek() & 0xFFFF) == 0);
    };
}

/// The change is still in the worker's store buffer when it checks for waiters.
Program buffered() {
    return [](Run& run) {
        sched::Word word(0, "event");
        sched::Word done(0, "done");
        sched::Delays buffer(
            1, [&](const sched::Word& asked) { return &asked == &done; }, word);
        done.intercept(&buffer);
        word.intercept(&buffer);
        run.thread("waiter", [&] {
            BasicEvent<sched::Word, 0> event(word);
            event.await([&] { return done.load_acquire() == 1; });
        });
        run.thread("worker", [&] {
            done.store_release(1);
            BasicEvent<sched::Word, 0>(word).notify_all();
            std::uint64_t any = 0;
            word.compare_exchange(any, any);  // drains the store buffer
        });
        run.join();
    };
}

/// A waiter that checks first and prepares afterwards.
Program looks_too_early() {
    return [](Run& run) {
        sched::Word word(0, "event");
        sched::Word done(0, "done");
        run.thread("waiter", [&] {
            BasicEvent<sched::Word, 0> event(word);
            if (done.load_acquire() == 0)
                event.wait(event.prepare());
        });
        run.thread("worker", [&] {
            done.store_release(1);
            BasicEvent<sched::Word, 0>(word).notify_all();
        });
        run.join();
    };
}

/// Counts waiters, but never advances the epoch: a notified thread sleeps again.
struct StuckEpoch : sched::Word {
    std::uint64_t fetch_add(std::uint64_t delta) {
        return sched::Word::fetch_add(delta == 0x1'0000 ? 0 : delta);
    }
};

}  // namespace

TFDB_SCHED(event_loses_no_wake_up) {
    Walk walk;
    walk.must_hold("one waiter, one worker", counted<Sound, 0>(1, 1));
    walk.must_hold("one waiter, one worker, one spin", counted<Sound, 1>(1, 1));
    walk.must_hold("one waiter, two workers", counted<Sound, 0>(1, 2));
    walk.must_hold("two waiters, one worker", counted<Sound, 0>(2, 1));
}

TFDB_SCHED(event_flaws_are_found) {
    Walk walk;
    walk.must_fail("notify without waking", kDeadlock, counted<SilentNotify, 0>(1, 1));
    walk.must_fail("notify that wakes one", kDeadlock, counted<NarrowNotify, 0>(2, 1));
    walk.must_fail("sleeping without looking again", kDeadlock, counted<BlindWait, 0>(1, 1));
    walk.must_fail("waiters counted in two steps", "peek() & 0xFFFF",
                   counted<SplitFetchAdd, 0>(2, 1));
    walk.must_fail("an epoch that stands still", kDeadlock, counted<StuckEpoch, 0>(1, 1));
    walk.must_fail("no fence between the change and the look", kDeadlock, buffered());
    walk.must_fail("looking before prepare", kDeadlock, looks_too_early());
}

}  // namespace tfdb::sync
