// The commit lock and its lanes in the C++ memory model: what the lock guards is a plain variable,
// and who is never woken shows as a livelock.
#include "tfdb/sync/priority_lock.hpp"

// After all others: it redefines `assert` and more.
#include "tfdb/testing/relacy/simulate.hpp"

namespace tfdb::sync {

namespace {

/// Three threads, each in a lane of its own, twice.
template <unsigned First, unsigned Second, unsigned Third>
struct Lanes : rl::test_suite<Lanes<First, Second, Third>, 3> {
    relacy::Word word;
    relacy::Word lanes;
    rl::var<int> guarded;

    void before() { guarded($) = 0; }
    void thread(unsigned index) {
        constexpr unsigned kLanes[] = {First, Second, Third};
        BasicPriorityLock<relacy::Word, 0> lock(word, lanes);
        for (int turn = 0; turn < 2; ++turn) {
            lock.lock(kLanes[index]);
            guarded($) = guarded($) + 1;
            lock.unlock();
        }
    }
    void after() {
        RL_ASSERT(guarded($) == 6);
        RL_ASSERT(word.load_relaxed() == 0);
    }
};

}  // namespace

TFDB_TEST(priority_lock_holds_in_the_memory_model) {
    relacy::holds<Lanes<0, 0, 0>>("three in lane 0");
    relacy::holds<Lanes<0, 1, 7>>("lanes 0, 1 and 7");
    relacy::holds<Lanes<0, 0, 7>>("lane 0 twice, lane 7");
    relacy::holds<Lanes<4, 4, 4>>("three in lane 4");
}

TFDB_TEST(priority_lock_needs_its_orders) {
    relacy::needs<Lanes<0, 0, 0>>("acquire and release of updates", {.relaxed_updates = true});
}

}  // namespace tfdb::sync
