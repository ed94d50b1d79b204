// Every interleaving of the commit lock, and of what it would be with one of its atoms broken.
#include "tfdb/sync/commit_lock.hpp"

#include <string>

#include "tfdb/sync/flaws.sched.hpp"

namespace tfdb::sync {

namespace {

using sched::Program;
using sched::Run;
using sched::Walk;
using namespace flaws;

/// Two steps that are only right if nobody comes in between.
template <class Word, int Spins>
Program counted(int threads) {
    return [threads](Run& run) {
        Word word;
        word.rename("lock", 0);
        sched::Word count(0, "count");
        for (int thread = 0; thread < threads; ++thread) {
            run.thread("writer" + std::to_string(thread), [&] {
                BasicCommitLock<Word, Spins> lock(word);
                lock.lock();
                count.store_relaxed(count.load_relaxed() + 1);
                lock.unlock();
            });
        }
        run.join();
        SCHED_REQUIRE(count.peek() == static_cast<std::uint64_t>(threads));
        SCHED_REQUIRE(word.peek() == 0);
    };
}

/// A writer that never waits beside one that does.
template <class Word>
Program tried() {
    return [](Run& run) {
        Word word;
        word.rename("lock", 0);
        sched::Word count(0, "count");
        std::uint64_t given_up = 0;
        const auto add_one = [&] { count.store_relaxed(count.load_relaxed() + 1); };
        run.thread("tries", [&] {
            BasicCommitLock<Word, 1> lock(word);
            if (lock.try_lock()) {
                add_one();
                lock.unlock();
            } else {
                given_up = 1;
            }
        });
        run.thread("waits", [&] {
            BasicCommitLock<Word, 1> lock(word);
            lock.lock();
            add_one();
            lock.unlock();
        });
        run.join();
        SCHED_REQUIRE(count.peek() + given_up == 2);
        SCHED_REQUIRE(word.peek() == 0);
    };
}

constexpr char kExcludes[] = "count.peek() ==";
constexpr char kTriedExcludes[] = "count.peek() + given_up == 2";

}  // namespace

TFDB_SCHED(commit_lock_excludes_and_wakes) {
    Walk walk;
    walk.must_hold("two writers, no spinning", counted<Sound, 0>(2));
    walk.must_hold("two writers, one spin", counted<Sound, 1>(2));
    walk.must_hold("two writers, two spins", counted<Sound, 2>(2));
    walk.must_hold("three writers, no spinning", counted<Sound, 0>(3));
    walk.must_hold("three writers, one spin", counted<Sound, 1>(3));
    walk.must_hold("try_lock beside lock", tried<Sound>());
}

TFDB_SCHED(commit_lock_flaws_are_found) {
    Walk walk;
    walk.must_fail("compare_exchange in two steps", kTriedExcludes, tried<SplitCompareExchange>());
    walk.must_fail("compare_exchange in two steps, spinning", kExcludes,
                   counted<SplitCompareExchange, 1>(2));
    walk.must_fail("exchange in two steps", kDeadlock, counted<SplitExchange, 0>(2));
    walk.must_fail("unlock without notify", kDeadlock, counted<SilentNotify, 0>(2));
    walk.must_fail("sleeping without looking again", kDeadlock, counted<BlindWait, 0>(2));
}

}  // namespace tfdb::sync
