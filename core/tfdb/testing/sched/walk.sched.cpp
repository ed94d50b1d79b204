#include "tfdb/testing/sched/walk.hpp"

#include <cstdint>
#include <stdexcept>
#include <string>

namespace tfdb::sched {

namespace {

constexpr char kExact[] = "count.peek() == 2";

Options every_interleaving() {
    Options options;
    options.reduce = false;
    return options;
}

/// `threads` threads with `accesses` accesses each, all to one word or each to its own.
Program writers(std::size_t threads, std::size_t accesses, bool one_word) {
    return [=](Run& run) {
        Word words[kMaxThreads];
        for (std::size_t thread = 0; thread < threads; ++thread) {
            Word& word = words[one_word ? 0 : thread];
            run.thread("writer" + std::to_string(thread), [&word, accesses, thread] {
                for (std::size_t access = 0; access < accesses; ++access) {
                    word.store_relaxed(thread);
                }
            });
        }
        run.join();
    };
}

void lock(Word& word) {
    while (word.exchange(1) != 0) {
        word.wait_while(1);
    }
}

void unlock(Word& word) {
    word.store_release(0);
}

/// Two threads that add one to a counter under a lock.
template <class Lock, class Unlock>
Program counted(Lock lock_it, Unlock unlock_it) {
    return [=](Run& run) {
        Word mutex(0, "mutex");
        Word count(0, "count");
        const auto add_one = [&] {
            lock_it(mutex);
            count.store_relaxed(count.load_relaxed() + 1);
            unlock_it(mutex);
        };
        run.thread("first", add_one);
        run.thread("second", add_one);
        run.join();
        SCHED_REQUIRE(count.peek() == 2);
    };
}

Program two_locks(bool same_order) {
    return [same_order](Run& run) {
        Word left(0, "left");
        Word right(0, "right");
        const auto take = [](Word& first, Word& second) {
            lock(first);
            lock(second);
            unlock(second);
            unlock(first);
        };
        run.thread("one", [&] { take(left, right); });
        run.thread("other", [&] { same_order ? take(left, right) : take(right, left); });
        run.join();
    };
}

}  // namespace

TFDB_SCHED(counts_every_interleaving_when_not_reduced) {
    // Two threads of n steps: (2n choose n); three of n: (3n)! / (n!)^3.
    SCHED_EXPECT(explore(writers(2, 2, true), every_interleaving()).executions == 6);
    SCHED_EXPECT(explore(writers(2, 5, true), every_interleaving()).executions == 252);
    SCHED_EXPECT(explore(writers(3, 2, true), every_interleaving()).executions == 90);
    SCHED_EXPECT(explore(writers(3, 3, false), every_interleaving()).executions == 1680);
    SCHED_EXPECT(explore(writers(2, 2, true), every_interleaving()).exhaustive());
}

TFDB_SCHED(reduction_keeps_one_execution_per_order_of_conflicts) {
    // Stores to one word conflict, so nothing is saved; stores to different words never do.
    SCHED_EXPECT(explore(writers(2, 5, true)).executions == 252);
    SCHED_EXPECT(explore(writers(3, 2, true)).executions == 90);
    SCHED_EXPECT(explore(writers(3, 3, false)).executions == 1);
    SCHED_EXPECT(explore(writers(3, 3, false)).exhaustive());
}

TFDB_SCHED(preemption_bound_counts_and_says_so) {
    Options options;
    options.preemptions = 0;
    const Outcome none = explore(writers(2, 3, true), options);
    SCHED_EXPECT(none.executions == 2 && none.bounded && !none.exhaustive());
    options.preemptions = 1;
    // One thread runs j of its 3 steps, the other all, the first the rest: 2 * 2 more.
    SCHED_EXPECT(explore(writers(2, 3, true), options).executions == 6);
    options.preemptions = 9;
    const Outcome all = explore(writers(2, 3, true), options);
    SCHED_EXPECT(all.executions == 20 && all.exhaustive());
}

TFDB_SCHED(lost_update) {
    Walk walk;
    walk.must_fail("load, then store", kExact, [](Run& run) {
        Word count(0, "count");
        const auto add_one = [&] { count.store_relaxed(count.load_relaxed() + 1); };
        run.thread("first", add_one);
        run.thread("second", add_one);
        run.join();
        SCHED_REQUIRE(count.peek() == 2);
    });
    walk.must_hold("fetch_add", [](Run& run) {
        Word count(0, "count");
        run.thread("first", [&] { count.fetch_add(1); });
        run.thread("second", [&] { count.fetch_add(1); });
        run.join();
        SCHED_REQUIRE(count.peek() == 2);
    });
    walk.must_hold("compare_exchange", [](Run& run) {
        Word count(0, "count");
        const auto add_one = [&] {
            std::uint64_t seen = count.load_relaxed();
            while (!count.compare_exchange(seen, seen + 1)) {
            }
        };
        run.thread("first", add_one);
        run.thread("second", add_one);
        run.thread("third", add_one);
        run.join();
        SCHED_REQUIRE(count.peek() == 3);
    });
}

TFDB_SCHED(locks) {
    Walk walk;
    walk.must_hold("exchange lock", counted(lock, unlock));
    walk.must_fail("lock that looks, then takes", kExact,
                   counted(
                       [](Word& word) {
                           word.wait_while(1);
                           word.store_relaxed(1);
                       },
                       unlock));
    walk.must_fail("lock that is never given back", "deadlock", counted(lock, [](Word&) {}));
    walk.must_hold("two locks, one order", two_locks(true));
    walk.must_fail("two locks, opposite orders", "deadlock", two_locks(false));
}

TFDB_SCHED(endless_loops_are_violations) {
    Walk walk;
    walk.must_fail("a loop without a wait", "endless", [](Run& run) {
        Word flag(0, "flag");
        run.thread("spins", [&] {
            while (flag.load_acquire() == 0) {
            }
        });
        run.thread("sets", [&] { flag.store_release(1); });
        run.join();
    });
}

TFDB_SCHED(killed_threads_stop_for_ever) {
    // The writer sets both words or dies in between: both halves must be seen over its deaths.
    std::string seen;
    for (std::size_t death = 0; death <= 2; ++death) {
        const Outcome outcome = explore([&](Run& run) {
            Word first(0, "first");
            Word second(0, "second");
            run.thread(
                "writer",
                [&] {
                    first.store_relaxed(1);
                    second.store_relaxed(1);
                },
                death);
            run.join();
            SCHED_REQUIRE(run.died(0));
            seen += std::to_string(first.peek()) + std::to_string(second.peek()) + " ";
        });
        SCHED_EXPECT(outcome.exhaustive() && outcome.violation.empty());
    }
    SCHED_EXPECT(seen == "00 10 11 ");
    Walk walk;
    walk.must_fail("lock holder killed", "deadlock", [](Run& run) {
        Word mutex(0, "mutex");
        const auto body = [&] {
            lock(mutex);
            unlock(mutex);
        };
        run.thread("mortal", body, 1);
        run.thread("other", body);
        run.join();
    });
}

TFDB_SCHED(limits_and_mistakes_do_not_pass_silently) {
    Options options = every_interleaving();
    options.max_executions = 5;
    const Outcome cut = explore(writers(2, 2, true), options);
    SCHED_EXPECT(!cut.complete && !cut.exhaustive() && cut.executions == 5);

    int executions = 0;
    const Outcome strange = explore([&](Run& run) {
        Word one(0, "one");
        Word two(0, "two");
        executions += 1;
        run.thread("first", [&] { one.store_relaxed(1); });
        run.thread("second", [&] { (executions > 1 ? two : one).store_relaxed(1); });
        run.join();
    });
    SCHED_EXPECT(strange.violation.find("not deterministic") != std::string::npos);

    const Outcome thrown = explore([](Run& run) {
        Word word;
        run.thread("first", [&] {
            word.store_relaxed(1);
            throw std::string("neither").length() == 7 ? std::runtime_error("oops")
                                                       : std::runtime_error("");
        });
        run.join();
    });
    SCHED_EXPECT(thrown.violation == "first ended with an exception: oops");
}

TFDB_SCHED(schedules_are_readable) {
    const Outcome outcome = explore([](Run& run) {
        Word flag(0, "flag");
        Word done(0, "done");
        run.thread("setter", [&] { flag.store_release(7); });
        run.thread("waiter", [&] {
            SCHED_REQUIRE(flag.wait_while(0) == 7);
            std::uint64_t expected = 3;
            done.compare_exchange(expected, 4);
            done.wait_while(0);
        });
        run.join();
    });
    SCHED_EXPECT(outcome.violation == "deadlock: no thread can go on");
    for (const char* part :
         {"setter     store.release", "flag               <- 7",
          "waiter     wait              flag               -> 7",
          "compare_exchange  done               unchanged 0", "waiter stands before wait done"}) {
        SCHED_EXPECT(outcome.schedule.find(part) != std::string::npos);
    }
}

}  // namespace tfdb::sched
