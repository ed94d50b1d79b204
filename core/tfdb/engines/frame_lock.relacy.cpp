// The frame lock and its event in the C++ memory model: the guarded data are a plain variable, and
// a lost wake-up shows as a livelock.
#include "tfdb/engines/frame_lock.hpp"

#include "tfdb/engines/event.hpp"
// After all others: it redefines `assert` and more.
#include "tfdb/testing/relacy/simulate.hpp"

namespace tfdb::sync {

namespace {

using Lock = BasicFrameLock<relacy::Word>;

/// A frame, the event of its store, and one thread for each slot.
struct Frame {
    relacy::Word word;
    relacy::Word epochs;
    rl::var<int> guarded;

    void lock(unsigned slot, bool exclusive) {
        Lock lock(word);
        BasicEvent<relacy::Word, 0> event(epochs);
        for (;;) {
            const auto attempt = exclusive ? lock.try_exclusive(slot) : lock.try_shared(slot);
            if (attempt)
                return;
            lock.wait_for(attempt, event, [] { return false; });
        }
    }
    void unlock(unsigned slot) {
        if (Lock(word).release(slot))
            BasicEvent<relacy::Word, 0>(epochs).notify_all();
    }
    void write(unsigned slot) {
        lock(slot, true);
        guarded($) = guarded($) + 1;
        unlock(slot);
    }
    void read(unsigned slot) {
        lock(slot, false);
        RL_ASSERT(guarded($) >= 0);
        unlock(slot);
    }
};

template <unsigned Writers, unsigned Readers>
struct Frames : rl::test_suite<Frames<Writers, Readers>, Writers + Readers>, Frame {
    void before() { guarded($) = 0; }
    void thread(unsigned index) {
        for (int turn = 0; turn < 2; ++turn) {
            if (index < Writers)
                write(index);
            else
                read(index);
        }
    }
    void after() {
        RL_ASSERT(guarded($) == static_cast<int>(2 * Writers));
        RL_ASSERT(word.load_relaxed() == 0);
    }
};

/// One thread reads first and then writes; the others only read.
struct Upgrades : rl::test_suite<Upgrades, 3>, Frame {
    void before() { guarded($) = 0; }
    void thread(unsigned index) {
        if (index != 0)
            return read(index);
        lock(0, false);
        const int before = guarded($);
        lock(0, true);
        guarded($) = before + 1;
        unlock(0);
    }
    void after() { RL_ASSERT(guarded($) == 1); }
};

/// A sleeper must give up while the lock stays held.
struct Wounds : rl::test_suite<Wounds, 2>, Frame {
    relacy::Word wounded;

    void before() { RL_ASSERT(Lock(word).try_shared(5).granted); }
    void thread(unsigned index) {
        BasicEvent<relacy::Word, 0> event(epochs);
        if (index == 1) {
            wounded.store_release(1);
            return event.notify_all();
        }
        const auto is_wounded = [&] { return wounded.load_acquire() == 1; };
        while (!is_wounded()) {
            const auto attempt = Lock(word).try_exclusive(0);
            RL_ASSERT(!attempt.granted);
            Lock(word).wait_for(attempt, event, is_wounded);
        }
    }
};

}  // namespace

TFDB_TEST(frame_lock_holds_in_the_memory_model) {
    relacy::holds<Frames<2, 0>>("two writers");
    relacy::holds<Frames<1, 2>>("a writer and two readers");
    relacy::holds<Frames<2, 1>>("two writers and a reader");
    relacy::holds<Upgrades>("an upgrade beside two readers");
    relacy::holds<Wounds>("a sleeper that is told to give up");
}

TFDB_TEST(frame_lock_needs_its_orders) {
    relacy::needs<Frames<2, 0>>("acquire and release of updates", {.relaxed_updates = true});
    relacy::needs<Wounds>("the event's full fences", {.no_full_fence = true});
    // The release follows the mark in the lock's own word: no fence is needed.
    relacy::holds<Frames<2, 1>>("without the event's full fences", {.no_full_fence = true});
}

}  // namespace tfdb::sync
