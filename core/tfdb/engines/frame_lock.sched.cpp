// Every interleaving of the frame lock with its event, and of the lock with one atomic operation
// broken.
#include "tfdb/engines/frame_lock.hpp"

#include <string>

#include "tfdb/engines/event.hpp"
#include "tfdb/sync/flaws.sched.hpp"

namespace tfdb::sync {

namespace {

using sched::Program;
using sched::Run;
using sched::Walk;
using namespace flaws;

using Lock = BasicFrameLock<sched::Word>;

bool never() {
    return false;
}

/// One frame, the event of its store, and two words that only change together. The event's word is
/// correct: event.sched.cpp walks it.
template <class W>
struct Scene {
    using Event = BasicEvent<sched::Word, 0>;

    W word;
    sched::Word epochs{0, "event"};
    sched::Word first{0, "first"};
    sched::Word second{0, "second"};

    Scene() { word.rename("lock", 0); }

    void lock(unsigned slot, bool exclusive) {
        BasicFrameLock<W> lock(word);
        Event event(epochs);
        for (;;) {
            const auto attempt = exclusive ? lock.try_exclusive(slot) : lock.try_shared(slot);
            if (attempt)
                return;
            lock.wait_for(attempt, event, never);
        }
    }
    void unlock(unsigned slot) {
        if (BasicFrameLock<W>(word).release(slot))
            Event(epochs).notify_all();
    }

    void write() {
        first.store_relaxed(first.load_relaxed() + 1);
        second.store_relaxed(second.load_relaxed() + 1);
    }
    void look() {
        const bool is_whole = first.load_relaxed() == second.load_relaxed();
        SCHED_REQUIRE(is_whole);
    }
};

struct Cast {
    unsigned writers;
    unsigned readers;
};

/// Writers write, readers read; all of them get the lock.
template <class W>
Program shared_and_exclusive(Cast cast) {
    return [cast](Run& run) {
        Scene<W> scene;
        unsigned slot = 0;
        for (unsigned writer = 0; writer < cast.writers; ++writer, ++slot) {
            run.thread("writer" + std::to_string(writer), [&, slot] {
                scene.lock(slot, true);
                scene.write();
                scene.unlock(slot);
            });
        }
        for (unsigned reader = 0; reader < cast.readers; ++reader, ++slot) {
            run.thread("reader" + std::to_string(reader), [&, slot] {
                scene.lock(slot, false);
                scene.look();
                scene.unlock(slot);
            });
        }
        run.join();
        const bool all_were_written = scene.second.peek() == cast.writers;
        SCHED_REQUIRE(all_were_written);
        SCHED_REQUIRE(scene.word.peek() == 0);
        SCHED_REQUIRE((scene.epochs.peek() & 0xFFFF) == 0);
    };
}

/// A refused thread withdraws.
template <class W>
Program tried(Cast cast) {
    return [cast](Run& run) {
        Scene<W> scene;
        std::uint64_t written = 0;
        for (unsigned slot = 0; slot < cast.writers + cast.readers; ++slot) {
            const bool writes = slot < cast.writers;
            run.thread((writes ? "writer" : "reader") + std::to_string(slot), [&, slot, writes] {
                BasicFrameLock<W> lock(scene.word);
                if (!(writes ? lock.try_exclusive(slot) : lock.try_shared(slot)))
                    return;
                if (writes) {
                    scene.write();
                    written += 1;
                } else {
                    scene.look();
                }
                scene.unlock(slot);
            });
        }
        run.join();
        const bool all_were_written = scene.second.peek() == written;
        SCHED_REQUIRE(all_were_written);
        SCHED_REQUIRE(scene.word.peek() == 0);
    };
}

/// One thread reads and then upgrades: it must wait for the other readers.
template <class W>
Program upgraded(unsigned readers) {
    return [readers](Run& run) {
        Scene<W> scene;
        run.thread("upgrades", [&] {
            scene.lock(0, false);
            scene.look();
            scene.lock(0, true);
            SCHED_REQUIRE(BasicFrameLock<W>(scene.word).held_exclusively_by(0));
            scene.write();
            scene.unlock(0);
        });
        for (unsigned reader = 1; reader <= readers; ++reader) {
            run.thread("reader" + std::to_string(reader), [&, reader] {
                scene.lock(reader, false);
                scene.look();
                scene.unlock(reader);
            });
        }
        run.join();
        SCHED_REQUIRE(scene.word.peek() == 0);
    };
}

/// Two readers that both upgrade: the refused one gives up, as an engine must.
template <class W>
Program both_upgrade() {
    return [](Run& run) {
        Scene<W> scene;
        std::uint64_t written = 0;
        for (unsigned slot = 0; slot < 2; ++slot) {
            run.thread("slot" + std::to_string(slot), [&, slot] {
                BasicFrameLock<W> lock(scene.word);
                scene.lock(slot, false);
                const auto attempt = lock.try_exclusive(slot);
                if (attempt) {
                    scene.write();
                    written += 1;
                } else {
                    SCHED_REQUIRE(attempt.others(slot) == lock.bit(1 - slot));
                }
                scene.unlock(slot);
            });
        }
        run.join();
        SCHED_REQUIRE(scene.second.peek() == written);
        SCHED_REQUIRE(scene.word.peek() == 0);
    };
}

/// A sleeper that must give up does so, although the lock stays held.
Program told_to_give_up(bool tells) {
    return [tells](Run& run) {
        Scene<sched::Word> scene;
        sched::Word wounded(0, "wounded");
        const bool granted = Lock(scene.word).try_shared(1).granted;
        SCHED_REQUIRE(granted);
        run.thread("victim", [&] {
            Lock lock(scene.word);
            BasicEvent<sched::Word, 0> event(scene.epochs);
            const auto is_wounded = [&] { return wounded.load_acquire() == 1; };
            while (!is_wounded()) {
                const auto attempt = lock.try_exclusive(0);
                SCHED_REQUIRE(!attempt.granted);
                lock.wait_for(attempt, event, is_wounded);
            }
        });
        run.thread("wounds", [&] {
            wounded.store_release(1);
            if (tells)
                BasicEvent<sched::Word, 0>(scene.epochs).notify_all();
        });
        run.join();
        SCHED_REQUIRE(Lock(scene.word).held_by(1));
    };
}

/// Grants in two steps; marks and releases in one.
struct SplitGrant : SplitCompareExchange {
    bool compare_exchange(std::uint64_t& expected, std::uint64_t desired) {
        const bool grants = desired > expected && (desired & Lock::kWaited) == 0;
        return grants ? SplitCompareExchange::compare_exchange(expected, desired)
                      : sched::Word::compare_exchange(expected, desired);
    }
};

/// Loses a waiter's mark: the lock looks as if no thread waited.
struct ForgetsWaiters : sched::Word {
    bool compare_exchange(std::uint64_t& expected, std::uint64_t desired) {
        const bool marks = (desired & Lock::kWaited) != 0;
        return sched::Word::compare_exchange(expected, desired & ~Lock::kWaited) || marks;
    }
};

/// A waiter that marks a lock that is already free.
struct MarksBlindly : sched::Word {
    bool compare_exchange(std::uint64_t& expected, std::uint64_t desired) {
        if ((desired & Lock::kWaited) != 0)
            expected = load_relaxed();
        const std::uint64_t mark = desired & Lock::kWaited;
        return sched::Word::compare_exchange(expected, mark != 0 ? expected | mark : desired);
    }
};

/// Grants an upgrade beside another reader, as if shared and exclusive were compatible.
struct BlindToReaders : sched::Word {
    [[nodiscard]] std::uint64_t load_relaxed() const {
        const std::uint64_t found = sched::Word::load_relaxed();
        return found == (Lock::bit(0) | Lock::bit(1)) ? Lock::bit(0) : found;
    }
    bool compare_exchange(std::uint64_t& expected, std::uint64_t desired) {
        if ((desired & ~expected & Lock::kExclusive) == 0)
            return sched::Word::compare_exchange(expected, desired);
        fetch_add(Lock::kExclusive);
        return true;
    }
};

}  // namespace

TFDB_SCHED(frame_lock_shares_excludes_and_wakes) {
    Walk walk;
    walk.must_hold("two writers", shared_and_exclusive<Sound>({2, 0}));
    walk.must_hold("a writer and a reader", shared_and_exclusive<Sound>({1, 1}));
    walk.must_hold("three writers that try", tried<Sound>({3, 0}));
    walk.must_hold("two writers and a reader that try", tried<Sound>({2, 1}));
    walk.must_hold("a writer and two readers that try", tried<Sound>({1, 2}));
    walk.must_hold("an upgrade beside a reader", upgraded<Sound>(1));
    walk.must_hold("two upgrades, one gives up", both_upgrade<Sound>());
    walk.must_hold("a sleeper that is told to give up", told_to_give_up(true));
}

TFDB_SCHED(frame_lock_of_three) {
    sched::Options options;
    options.preemptions = 3;
    Walk walk(options);
    walk.must_hold("three writers", shared_and_exclusive<Sound>({3, 0}));
    walk.must_hold("a writer and two readers", shared_and_exclusive<Sound>({1, 2}));
    walk.must_hold("two writers and a reader", shared_and_exclusive<Sound>({2, 1}));
    walk.must_hold("an upgrade beside two readers", upgraded<Sound>(2));
}

TFDB_SCHED(frame_lock_flaws_are_found) {
    Walk walk;
    walk.must_fail("requests in two steps", "all_were_written",
                   shared_and_exclusive<SplitGrant>({2, 0}));
    walk.must_fail("requests in two steps beside a reader", "is_whole",
                   shared_and_exclusive<SplitGrant>({1, 1}));
    walk.must_fail("readers that are overlooked", "held_exclusively_by",
                   upgraded<BlindToReaders>(1));
    walk.must_fail("a mark that is lost", kDeadlock, shared_and_exclusive<ForgetsWaiters>({2, 0}));
    walk.must_fail("a mark that is lost, upgrading", kDeadlock, upgraded<ForgetsWaiters>(1));
    walk.must_fail("a mark on a lock that is free", kDeadlock,
                   shared_and_exclusive<MarksBlindly>({2, 0}));
    walk.must_fail("a victim that is not told", kDeadlock, told_to_give_up(false));
}

}  // namespace tfdb::sync
