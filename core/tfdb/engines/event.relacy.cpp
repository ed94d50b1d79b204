// The engines' event in the C++ memory model: a lost wake-up shows as a livelock.
#include "tfdb/engines/event.hpp"

// After all others: it redefines `assert` and more.
#include "tfdb/testing/relacy/simulate.hpp"

namespace tfdb::sync {

namespace {

/// Two threads wait until a third has done its part; `Waiters` and the rest work.
template <unsigned Waiters, unsigned Workers>
struct Events : rl::test_suite<Events<Waiters, Workers>, Waiters + Workers> {
    relacy::Word word;
    relacy::Word parts[Workers];
    rl::var<int> data[Workers];

    void thread(unsigned index) {
        BasicEvent<relacy::Word, 0> event(word);
        if (index >= Waiters) {
            const unsigned worker = index - Waiters;
            data[worker]($) = 1;
            parts[worker].store_release(1);
            event.notify_all();
            return;
        }
        event.await([&] {
            bool all = true;
            for (const relacy::Word& part : parts)
                all = all && part.load_acquire() == 1;
            return all;
        });
        for (rl::var<int>& part : data)
            RL_ASSERT(part($) == 1);
    }

    void after() { RL_ASSERT((word.load_relaxed() & 0xFFFF) == 0); }
};

}  // namespace

TFDB_TEST(event_holds_in_the_memory_model) {
    relacy::holds<Events<1, 1>>("one waiter, one worker");
    relacy::holds<Events<2, 1>>("two waiters, one worker");
    relacy::holds<Events<1, 2>>("one waiter, two workers");
}

TFDB_TEST(event_needs_its_fences) {
    relacy::needs<Events<1, 1>>("the full fences", {.no_full_fence = true});
}

}  // namespace tfdb::sync
