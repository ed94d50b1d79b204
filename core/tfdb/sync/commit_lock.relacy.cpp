// The commit lock in the C++ memory model: the guarded data are a plain variable, and a lost
// wake-up shows as a livelock.
#include "tfdb/sync/commit_lock.sched.hpp"

// After all others: it redefines `assert` and more.
#include "tfdb/testing/relacy/simulate.hpp"

namespace tfdb::sync {

namespace {

struct Number {
    rl::var<int> value;
    void add_one() { value($) = value($) + 1; }
};

/// Three threads, each locking in its lane twice.
template <Lane First, Lane Second, Lane Third>
struct Lanes : rl::test_suite<Lanes<First, Second, Third>, 3> {
    CountInTurns<relacy::Word, 0, Number> turns;

    void before() { turns.count.value($) = 0; }
    void thread(unsigned index) {
        constexpr Lane kLanes[] = {First, Second, Third};
        turns.thread(kLanes[index], 2);
    }
    void after() {
        RL_ASSERT(turns.count.value($) == 6);
        RL_ASSERT(turns.word.load_relaxed() == 0);
    }
};

constexpr Lane kOrdinary = Lane::kOrdinary;
constexpr Lane kUrgent = Lane::kUrgent;

}  // namespace

TFDB_TEST(commit_lock_holds_in_the_memory_model) {
    relacy::holds<Lanes<kOrdinary, kOrdinary, kOrdinary>>("three ordinary ones");
    relacy::holds<Lanes<kOrdinary, kOrdinary, kUrgent>>("one is urgent");
    relacy::holds<Lanes<kOrdinary, kUrgent, kUrgent>>("two are urgent");
    relacy::holds<Lanes<kUrgent, kUrgent, kUrgent>>("three urgent ones");
}

TFDB_TEST(commit_lock_needs_its_orders) {
    relacy::needs<Lanes<kOrdinary, kOrdinary, kUrgent>>("acquire and release of updates",
                                                        {.relaxed_updates = true});
}

}  // namespace tfdb::sync
