// The gate in the C++ memory model: guests and a closer access plain variables, so Relacy reports
// any missing order as a data race.
#include "tfdb/engines/gate.hpp"

// After all others: it redefines `assert` and more.
#include "tfdb/testing/relacy/simulate.hpp"

namespace tfdb::sync {

namespace {

/// Two guests with a slot each and a closer, each of them twice.
template <int Spins>
struct Gates : rl::test_suite<Gates<Spins>, 3> {
    static constexpr unsigned kGuests = 2;
    BasicGate<relacy::Word, kGuests, Spins> gate;
    rl::var<int> everything;
    rl::var<int> in_slot[kGuests];

    void before() {
        everything($) = 0;
        for (rl::var<int>& slot : in_slot)
            slot($) = 0;
    }

    void thread(unsigned index) {
        for (int turn = 0; turn < 2; ++turn) {
            if (index < kGuests)
                visit(index);
            else
                be_alone();
        }
    }

    void visit(unsigned preferred) {
        const unsigned slot = gate.enter(preferred);
        RL_ASSERT(everything($) % 2 == 0);
        in_slot[slot]($) = in_slot[slot]($) + 1;
        gate.add(slot, SlotCount::kRetries);
        gate.leave(slot);
    }

    void be_alone() {
        gate.close();
        everything($) = everything($) + 1;
        const int visits = in_slot[0]($) + in_slot[1]($);
        RL_ASSERT(gate.total(SlotCount::kRetries) == static_cast<std::uint64_t>(visits));
        everything($) = everything($) + 1;
        gate.open();
    }

    void after() {
        RL_ASSERT(in_slot[0]($) + in_slot[1]($) == 4);
        RL_ASSERT(gate.total(SlotCount::kRetries) == 4);
    }
};

/// Two guests and one slot.
struct Narrow : rl::test_suite<Narrow, 2> {
    BasicGate<relacy::Word, 1, 0> gate;
    rl::var<int> visits;

    void before() { visits($) = 0; }

    void thread(unsigned index) {
        const unsigned slot = gate.enter(index);
        visits($) = visits($) + 1;
        gate.leave(slot);
    }

    void after() { RL_ASSERT(visits($) == 2); }
};

}  // namespace

TFDB_TEST(gate_holds_in_the_memory_model) {
    relacy::holds<Gates<0>>("two guests and a closer");
    relacy::holds<Gates<1>>("two guests and a closer, one spin");
    relacy::holds<Narrow>("two guests, one slot");
}

TFDB_TEST(gate_needs_its_orders) {
    relacy::needs<Gates<1>>("the total order of claims and closings", {.no_total_order = true});
    relacy::needs<Gates<1>>("acquire and release of updates", {.relaxed_updates = true});
}

}  // namespace tfdb::sync
