// Every interleaving of the commit lock, and of the lock with one atomic operation broken.
#include "tfdb/sync/commit_lock.sched.hpp"

#include <string>
#include <vector>

#include "tfdb/sync/flaws.sched.hpp"

namespace tfdb::sync {

namespace {

using sched::Program;
using sched::Run;
using sched::Walk;
using namespace flaws;

struct Number {
    sched::Word word{0, "count"};
    void add_one() { word.store_relaxed(word.load_relaxed() + 1); }
};

template <class W, int Spins>
struct Scene : CountInTurns<W, Spins, Number> {
    Scene() { this->word.rename("lock", 0); }

    void require(std::uint64_t turns) const {
        const bool all_had_their_turn = this->count.word.peek() == turns;
        SCHED_REQUIRE(all_had_their_turn);
        SCHED_REQUIRE(this->word.peek() == 0);
    }
};

constexpr Lane kOrdinary = Lane::kOrdinary;
constexpr Lane kUrgent = Lane::kUrgent;

/// Each thread locks once, in its lane.
template <class W, int Spins>
Program counted(const std::vector<Lane>& lanes) {
    return [lanes](Run& run) {
        Scene<W, Spins> scene;
        for (std::size_t i = 0; i < lanes.size(); ++i)
            run.thread("writer" + std::to_string(i), [&, i] { scene.thread(lanes[i], 1); });
        run.join();
        scene.require(lanes.size());
    };
}

/// A writer that never waits, beside one that waits.
template <class W>
Program tried(Lane lane) {
    return [lane](Run& run) {
        Scene<W, 1> scene;
        bool had_a_turn = false;
        run.thread("tries", [&] { had_a_turn = scene.thread_that_tries(); });
        run.thread("waits", [&] { scene.thread(lane, 1); });
        run.join();
        scene.require(had_a_turn ? 2 : 1);
    };
}

/// Writers that wait without a limit, beside one that gives up after one sleep.
template <class W>
Program left(Lane leaves, std::int64_t longest_ns, const std::vector<Lane>& lanes) {
    return [=](Run& run) {
        Scene<W, 0> scene;
        bool had_a_turn = false;
        run.thread("leaves", [&] { had_a_turn = scene.thread_that_leaves(leaves, longest_ns); });
        for (std::size_t i = 0; i < lanes.size(); ++i)
            run.thread("writer" + std::to_string(i), [&, i] { scene.thread(lanes[i], 1); });
        run.join();
        scene.require(lanes.size() + (had_a_turn ? 1 : 0));
    };
}

/// Behind a holder: ordinary requests and attempts come after an urgent request that was counted
/// before them.
template <class W>
Program overtaken(bool tries) {
    return [tries](Run& run) {
        Scene<W, 0> scene;
        sched::Word served(0, "served");
        run.thread("holder", [&] { scene.thread(kOrdinary, 1); });
        run.thread("urgent", [&] {
            auto lock = scene.lock();
            lock.lock_urgently();
            served.store_relaxed(1);
            lock.unlock();
        });
        run.thread("ordinary", [&] {
            const bool one_asks = scene.word.sched::Word::load_relaxed() >= 4;
            auto lock = scene.lock();
            if (!tries)
                lock.lock();
            else if (!lock.try_lock())
                return;
            const bool was_first = !one_asks || served.load_relaxed() == 1;
            SCHED_REQUIRE(was_first);
            lock.unlock();
        });
        run.join();
        SCHED_REQUIRE(scene.word.peek() == 0);
    };
}

/// Acquires the lock in two steps.
struct TakesSlowly : SplitCompareExchange {
    bool compare_exchange(std::uint64_t& expected, std::uint64_t desired) {
        const bool takes = (expected & 1) == 0;
        return takes ? SplitCompareExchange::compare_exchange(expected, desired)
                     : sched::Word::compare_exchange(expected, desired);
    }
};

/// A thread that takes the free lock ignores urgent requests of others.
struct BlindToUrgent : sched::Word {
    [[nodiscard]] std::uint64_t load_relaxed() const {
        const std::uint64_t found = sched::Word::load_relaxed();
        return (found & 1) == 0 ? 0 : found;
    }
    bool compare_exchange(std::uint64_t& expected, std::uint64_t desired) {
        const std::uint64_t urgent = sched::Word::load_relaxed() & ~std::uint64_t{3};
        if (expected == 0) {
            expected = urgent;
            desired += urgent;
        }
        return sched::Word::compare_exchange(expected, desired);
    }
};

/// Wakes one thread instead of all.
struct WakesOne : sched::Word {
    void wake_all() { wake_one(); }
};

/// A waiter that gives up does not wake the threads that its request blocked.
struct LeavesInSilence : sched::Word {
    bool compare_exchange(std::uint64_t& expected, std::uint64_t desired) {
        const bool done = sched::Word::compare_exchange(expected, desired);
        silent = done && (expected & 1) == 0 && (desired & 1) == 0;
        return done;
    }
    void wake_all() {
        if (!silent)
            sched::Word::wake_all();
    }
    bool silent = false;
};

}  // namespace

TFDB_SCHED(commit_lock_excludes_and_wakes) {
    Walk walk;
    walk.must_hold("two writers, no spinning", counted<Sound, 0>({kOrdinary, kOrdinary}));
    walk.must_hold("two writers, one spin", counted<Sound, 1>({kOrdinary, kOrdinary}));
    walk.must_hold("two writers, two spins", counted<Sound, 2>({kOrdinary, kOrdinary}));
    walk.must_hold("one urgent", counted<Sound, 0>({kOrdinary, kUrgent}));
    walk.must_hold("one urgent, one spin", counted<Sound, 1>({kOrdinary, kUrgent}));
    walk.must_hold("two urgent", counted<Sound, 0>({kUrgent, kUrgent}));
    walk.must_hold("try_lock beside lock", tried<Sound>(kOrdinary));
    walk.must_hold("try_lock beside an urgent one", tried<Sound>(kUrgent));
}

TFDB_SCHED(commit_lock_of_three) {
    Walk all;
    all.must_hold("three writers, no spinning",
                  counted<Sound, 0>({kOrdinary, kOrdinary, kOrdinary}));
    sched::Options options;
    options.preemptions = 4;
    Walk walk(options);
    walk.must_hold("three writers, one spin", counted<Sound, 1>({kOrdinary, kOrdinary, kOrdinary}));
    walk.must_hold("one urgent", counted<Sound, 0>({kOrdinary, kOrdinary, kUrgent}));
    walk.must_hold("two urgent", counted<Sound, 0>({kOrdinary, kUrgent, kUrgent}));
    walk.must_hold("three urgent", counted<Sound, 0>({kUrgent, kUrgent, kUrgent}));
    walk.must_hold("urgent before ordinary", overtaken<Sound>(false));
    walk.must_hold("urgent before who tries", overtaken<Sound>(true));
}

TFDB_SCHED(commit_lock_may_be_left) {
    constexpr std::int64_t kShort = 1;  // ends at once
    constexpr std::int64_t kLong = 2;   // until a wake
    sched::Options options;
    options.preemptions = 4;
    for (const std::int64_t longest : {kShort, kLong}) {
        for (const Lane lane : {kOrdinary, kUrgent}) {
            Walk all;
            all.must_hold("beside one", left<Sound>(lane, longest, {kOrdinary}));
            all.must_hold("beside an urgent one", left<Sound>(lane, longest, {kUrgent}));
            Walk walk(options);
            walk.must_hold("beside two", left<Sound>(lane, longest, {kOrdinary, kOrdinary}));
            walk.must_hold("beside one of each", left<Sound>(lane, longest, {kOrdinary, kUrgent}));
            walk.must_hold("beside two urgent ones",
                           left<Sound>(lane, longest, {kUrgent, kUrgent}));
        }
    }
    Walk(options).must_fail("leaving in silence", kDeadlock,
                            left<LeavesInSilence>(kUrgent, kShort, {kOrdinary, kOrdinary}));
}

TFDB_SCHED(commit_lock_flaws_are_found) {
    Walk walk;
    walk.must_fail("locking in two steps", "all_had_their_turn", tried<TakesSlowly>(kOrdinary));
    walk.must_fail("locking in two steps, spinning", "all_had_their_turn",
                   counted<TakesSlowly, 1>({kOrdinary, kOrdinary}));
    walk.must_fail("unlocking in two steps", kDeadlock,
                   counted<SplitCompareExchange, 0>({kOrdinary, kOrdinary}));
    walk.must_fail("counting in two steps", kDeadlock,
                   counted<SplitFetchAdd, 0>({kUrgent, kUrgent, kUrgent}));
    walk.must_fail("a lost wake-up", kDeadlock, counted<SilentNotify, 0>({kOrdinary, kOrdinary}));
    walk.must_fail("sleeping without looking again", kDeadlock,
                   counted<BlindWait, 0>({kOrdinary, kOrdinary}));
    sched::Options options;
    options.preemptions = 4;
    Walk(options).must_fail("an urgent one that is overlooked", "was_first",
                            overtaken<BlindToUrgent>(false));
    Walk(options).must_fail("waking one who may not have it", kDeadlock,
                            counted<WakesOne, 0>({kOrdinary, kOrdinary, kUrgent}));
}

}  // namespace tfdb::sync
