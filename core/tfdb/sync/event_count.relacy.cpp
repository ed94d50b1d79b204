// The event count in the C++ memory model: a lost wake-up shows as a livelock.
#include "tfdb/sync/event_count.hpp"

// After all others: it redefines `assert` and more.
#include "tfdb/testing/relacy/simulate.hpp"

namespace tfdb::sync {

namespace {

/// Some threads wait until the others have each done their part.
template <unsigned Listeners, unsigned Workers>
struct Bells : rl::test_suite<Bells<Listeners, Workers>, Listeners + Workers> {
    relacy::Word word;
    relacy::Word parts[Workers];
    rl::var<int> data[Workers];

    void thread(unsigned index) {
        BasicEventCount<relacy::Word> event(word);
        if (index >= Listeners) {
            const unsigned worker = index - Listeners;
            data[worker]($) = 1;
            parts[worker].store_release(1);
            event.notify();
            return;
        }
        const auto all_done = [&] {
            bool all = true;
            for (const relacy::Word& part : parts)
                all = all && part.load_acquire() == 1;
            return all;
        };
        for (;;) {
            const std::uint64_t armed = event.arm();
            if (all_done())
                break;
            (void)event.sleep(armed, 1);
        }
        for (rl::var<int>& part : data)
            RL_ASSERT(part($) == 1);
    }
};

}  // namespace

TFDB_TEST(event_count_holds_in_the_memory_model) {
    relacy::holds<Bells<1, 1>>("one listener, one worker");
    relacy::holds<Bells<2, 1>>("two listeners, one worker");
    relacy::holds<Bells<1, 2>>("one listener, two workers");
}

TFDB_TEST(event_count_needs_its_fences) {
    relacy::needs<Bells<1, 1>>("the full fences", {.no_full_fence = true});
}

}  // namespace tfdb::sync
