// Every interleaving of the lanes of the commit lock, and of what they would be with one atom
// broken.
#include "tfdb/sync/priority_lock.hpp"

#include <string>
#include <vector>

#include "tfdb/sync/flaws.sched.hpp"

namespace tfdb::sync {

namespace {

using sched::Program;
using sched::Run;
using sched::Walk;
using namespace flaws;

template <class W, int Spins>
struct Scene {
    W word;
    W lanes;
    sched::Word count{0, "count"};

    Scene() {
        word.rename("lock", 0);
        lanes.rename("lanes", 0);
    }
    BasicPriorityLock<W, Spins> lock() { return {word, lanes}; }

    void add_one() { count.store_relaxed(count.load_relaxed() + 1); }
    void work(unsigned lane) {
        auto mine = lock();
        mine.lock(lane);
        add_one();
        mine.unlock();
    }
    void require_idle() const {
        SCHED_REQUIRE(word.peek() == 0);
        const bool no_ticket_is_out = (lanes.peek() ^ lanes.peek() >> 4) % 16 == 0;
        SCHED_REQUIRE(no_ticket_is_out);
    }
};

/// Each locks once, in its lane.
template <class W, int Spins>
Program counted(const std::vector<unsigned>& chosen) {
    return [chosen](Run& run) {
        Scene<W, Spins> scene;
        for (const unsigned lane : chosen) {
            run.thread("lane" + std::to_string(lane), [&, lane] { scene.work(lane); });
        }
        run.join();
        const bool all_had_their_turn = scene.count.peek() == chosen.size();
        SCHED_REQUIRE(all_had_their_turn);
        scene.require_idle();
    };
}

/// Who asks when a ticket of a higher lane, or an older one of the same lane, is out comes later.
template <class W>
Program ordered(unsigned first_lane, unsigned second_lane) {
    return [=](Run& run) {
        Scene<W, 0> scene;
        sched::Word served(0, "served");
        run.thread("first", [&] {
            auto lock = scene.lock();
            lock.lock(first_lane);
            served.store_relaxed(1);
            lock.unlock();
        });
        run.thread("second", [&] {
            const bool ticket_is_out = scene.lanes.sched::Word::load_relaxed() != 0;
            auto lock = scene.lock();
            lock.lock(second_lane);
            const bool was_first = !ticket_is_out || served.load_relaxed() == 1;
            SCHED_REQUIRE(was_first);
            lock.unlock();
        });
        run.join();
    };
}

/// Somebody in the way of both: lane 7 goes before lane 0, which asks only once lane 7 waits.
template <class W>
Program overtaken() {
    return [](Run& run) {
        Scene<W, 0> scene;
        sched::Word served(0, "served");
        run.thread("holder", [&] { scene.work(0); });
        run.thread("high", [&] {
            auto lock = scene.lock();
            lock.lock(7);
            served.store_relaxed(1);
            lock.unlock();
        });
        run.thread("low", [&] {
            const bool high_waits = scene.lanes.sched::Word::load_relaxed() != 0;
            auto lock = scene.lock();
            lock.lock(0);
            const bool was_first = !high_waits || served.load_relaxed() == 1;
            SCHED_REQUIRE(was_first);
            lock.unlock();
        });
        run.join();
        scene.require_idle();
    };
}

/// A writer that never waits also lets the lanes go first.
template <class W>
Program tried() {
    return [](Run& run) {
        Scene<W, 0> scene;
        std::uint64_t given_up = 0;
        run.thread("tries", [&] {
            auto lock = scene.lock();
            if (lock.try_lock()) {
                scene.add_one();
                lock.unlock();
            } else {
                given_up = 1;
            }
        });
        run.thread("lane1", [&] { scene.work(1); });
        run.join();
        const bool all_had_their_turn = scene.count.peek() + given_up == 2;
        SCHED_REQUIRE(all_had_their_turn);
        scene.require_idle();
    };
}

/// Nobody in lane 0 sees that a higher lane waits.
struct BlindToLanes : sched::Word {
    [[nodiscard]] std::uint64_t load_relaxed() const {
        return sched::Word::load_relaxed() & 0xF000F0;
    }
};

}  // namespace

TFDB_SCHED(priority_lock_excludes_and_wakes) {
    Walk walk;
    walk.must_hold("lane 0 twice", counted<Sound, 0>({0, 0}));
    walk.must_hold("lanes 0 and 1", counted<Sound, 0>({0, 1}));
    walk.must_hold("lanes 0 and 1, one spin", counted<Sound, 1>({0, 1}));
    walk.must_hold("lane 1 twice", counted<Sound, 0>({1, 1}));
    walk.must_hold("lanes 1 and 7", counted<Sound, 0>({1, 7}));
    walk.must_hold("try_lock beside a lane", tried<Sound>());
}

TFDB_SCHED(priority_lock_keeps_the_order) {
    Walk walk;
    walk.must_hold("lane 1 before lane 0", ordered<Sound>(1, 0));
    walk.must_hold("lane 7 before lane 3", ordered<Sound>(7, 3));
    walk.must_hold("lane 2 in order of arrival", ordered<Sound>(2, 2));
    sched::Options options;
    options.preemptions = 3;
    Walk(options).must_hold("lane 7 before lane 0, both behind one", overtaken<Sound>());
}

TFDB_SCHED(priority_lock_of_three) {
    sched::Options options;
    options.preemptions = 3;
    Walk walk(options);
    walk.must_hold("lanes 0, 1 and 7", counted<Sound, 0>({0, 1, 7}));
    walk.must_hold("lane 0 twice, lane 7", counted<Sound, 0>({0, 0, 7}));
    walk.must_hold("lane 4 three times", counted<Sound, 0>({4, 4, 4}));
}

TFDB_SCHED(priority_lock_flaws_are_found) {
    Walk walk;
    walk.must_fail("locking in two steps", "all_had_their_turn", tried<SplitCompareExchange>());
    walk.must_fail("tickets in two steps", kDeadlock, counted<SplitCompareExchange, 0>({1, 1}));
    walk.must_fail("unlocking in two steps", kDeadlock, counted<SplitExchange, 0>({1, 0}));
    walk.must_fail("waking nobody", kDeadlock, counted<SilentNotify, 0>({0, 1}));
    walk.must_fail("sleeping without looking again", kDeadlock, counted<BlindWait, 0>({0, 1}));
    walk.must_fail("a lane that is overlooked", "was_first", ordered<BlindToLanes>(1, 0));
}

}  // namespace tfdb::sync
