// Every interleaving of the version lock, and of the lock with one atomic operation broken.
#include "tfdb/engines/version_lock.hpp"

#include <string>

#include "tfdb/engines/event.hpp"
#include "tfdb/sync/flaws.sched.hpp"

namespace tfdb::sync {

namespace {

using sched::Program;
using sched::Run;
using sched::Walk;
using namespace flaws;

struct Cast {
    unsigned writers;
    unsigned readers = 0;
    bool announces = true;  // a new version after each write
    bool confirms = true;   // checks the version again
};

template <class W, int Spins>
struct Scene {
    using Lock = BasicVersionLock<W, Spins>;

    W word;
    sched::Word epochs{0, "event"};
    sched::Word first{0, "first"};
    sched::Word second{0, "second"};

    Scene() { word.rename("version", 0); }

    void write(bool announces) {
        Lock lock(word);
        BasicEvent<sched::Word, 0> event(epochs);
        lock.lock(event);
        first.store_relaxed(first.load_relaxed() + 1);
        second.store_relaxed(second.load_relaxed() + 1);
        if (lock.unlock(announces))
            event.notify_all();
    }
    void read(bool confirms) {
        const Lock lock(word);
        const std::uint64_t version = lock.version();
        if (lock.locked(version))
            return;
        const std::uint64_t one = first.load_relaxed();
        const std::uint64_t other = second.load_relaxed();
        if (confirms && !lock.unchanged(version))
            return;
        const bool is_whole = one == other;
        SCHED_REQUIRE(is_whole);
    }
    /// Reads, then writes a dependent value, if no other thread was faster.
    bool add_one() {
        Lock lock(word);
        const std::uint64_t version = lock.version();
        const std::uint64_t before = first.load_relaxed();
        if (lock.locked(version) || !lock.try_lock())
            return false;
        const bool won = lock.unchanged_until_mine(version);
        if (won)
            first.store_relaxed(before + 1);
        if (lock.unlock(won))
            BasicEvent<sched::Word, 0>(epochs).notify_all();
        return won;
    }
};

template <class W, int Spins>
Program written(Cast cast) {
    return [cast](Run& run) {
        Scene<W, Spins> scene;
        for (unsigned writer = 0; writer < cast.writers; ++writer) {
            run.thread("writer" + std::to_string(writer), [&] { scene.write(cast.announces); });
        }
        for (unsigned reader = 0; reader < cast.readers; ++reader) {
            run.thread("reader" + std::to_string(reader), [&] { scene.read(cast.confirms); });
        }
        run.join();
        const bool all_were_written = scene.second.peek() == cast.writers;
        SCHED_REQUIRE(all_were_written);
        const bool is_unlocked = scene.word.peek() == (cast.announces ? 4 * cast.writers : 0);
        SCHED_REQUIRE(is_unlocked);
    };
}

template <class W>
Program added(unsigned threads) {
    return [threads](Run& run) {
        Scene<W, 0> scene;
        std::uint64_t won = 0;
        for (unsigned thread = 0; thread < threads; ++thread) {
            run.thread("adds" + std::to_string(thread), [&] { won += scene.add_one() ? 1 : 0; });
        }
        run.join();
        const bool none_is_lost = scene.first.peek() == won;
        SCHED_REQUIRE(none_is_lost);
    };
}

/// Each reads the other's frame and increases its own if that is low: at most one may.
Program skewed(bool confirms) {
    return [confirms](Run& run) {
        sched::Word versions[2];
        sched::Word values[2];
        for (unsigned i = 0; i < 2; ++i) {
            versions[i].rename("version", i + 1);
            values[i].rename("value", i + 1);
        }
        for (unsigned i = 0; i < 2; ++i) {
            run.thread("raises" + std::to_string(i + 1), [&, i] {
                BasicVersionLock<sched::Word, 0> mine(versions[i]);
                const BasicVersionLock<sched::Word, 0> theirs(versions[1 - i]);
                const std::uint64_t seen = theirs.version();
                const bool low = values[1 - i].load_relaxed() == 0;
                if (!low || theirs.locked(seen) || !mine.try_lock())
                    return;
                const bool wins = !confirms || theirs.unchanged(seen);
                if (wins)
                    values[i].store_relaxed(1);
                (void)mine.unlock(wins);
            });
        }
        run.join();
        const bool one_is_low = values[0].peek() + values[1].peek() <= 1;
        SCHED_REQUIRE(one_is_low);
    };
}

/// A version that does not change on unlock.
struct StuckVersion : sched::Word {
    std::uint64_t exchange(std::uint64_t) { return sched::Word::exchange(0); }
};

}  // namespace

TFDB_SCHED(version_lock_excludes_wakes_and_warns) {
    Walk walk;
    walk.must_hold("two writers, no spinning", written<Sound, 0>({2}));
    walk.must_hold("two writers, one spin", written<Sound, 1>({2}));
    walk.must_hold("a writer and a reader", written<Sound, 0>({1, 1}));
    walk.must_hold("a writer and two readers", written<Sound, 0>({1, 2}));
    walk.must_hold("two that read, then write", added<Sound>(2));
    walk.must_hold("three that read, then write", added<Sound>(3));
    walk.must_hold("two that read what the other writes", skewed(true));
}

TFDB_SCHED(version_lock_of_three) {
    sched::Options options;
    options.preemptions = 3;
    Walk walk(options);
    walk.must_hold("three writers", written<Sound, 0>({3}));
    walk.must_hold("two writers and a reader", written<Sound, 0>({2, 1}));
}

TFDB_SCHED(version_lock_flaws_are_found) {
    Walk walk;
    walk.must_fail("locking in two steps", "none_is_lost", added<SplitOrderedExchange>(2));
    walk.must_fail("marking in two steps", kDeadlock, written<SplitCompareExchange, 0>({2}));
    walk.must_fail("unlocking in two steps", kDeadlock, written<SplitExchange, 0>({2}));
    walk.must_fail("a write without a new version", "is_whole",
                   written<Sound, 0>({.writers = 1, .readers = 1, .announces = false}));
    walk.must_fail("two that do not look again", "one_is_low", skewed(false));
    walk.must_fail("a version that stands still", "none_is_lost", added<StuckVersion>(2));
    walk.must_fail("a reader that does not look again", "is_whole",
                   written<Sound, 0>({.writers = 1, .readers = 1, .confirms = false}));
}

}  // namespace tfdb::sync
