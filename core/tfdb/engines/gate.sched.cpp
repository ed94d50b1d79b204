// Every interleaving of threads at the gate, and of the gate with one atomic operation broken.
#include "tfdb/engines/gate.hpp"

#include <string>
#include <utility>
#include <vector>

#include "tfdb/sync/flaws.sched.hpp"
#include "tfdb/testing/sched/flaws.hpp"

namespace tfdb::sync {

namespace {

using sched::Program;
using sched::Run;
using sched::Walk;
using namespace flaws;

template <class W, unsigned Slots, int Spins>
void name_words(BasicGate<W, Slots, Spins>& gate) {
    gate.gate().rename("gate", 0);
    for (unsigned slot = 0; slot < Slots; ++slot)
        gate.claimed(slot).rename("slot", slot + 1);
}

template <class W, unsigned Slots, int Spins>
void require_all_free(BasicGate<W, Slots, Spins>& gate) {
    SCHED_REQUIRE(gate.gate().peek() == 0);
    for (unsigned slot = 0; slot < Slots; ++slot)
        SCHED_REQUIRE(gate.claimed(slot).peek() == 0);
}

struct Cast {
    unsigned guests;
    unsigned closers;
};

/// The program of guests and closers, on a gate and on words that show their positions.
template <class W, unsigned Slots, int Spins>
struct Scene {
    BasicGate<W, Slots, Spins> gate;
    std::vector<sched::Word> in_slot = std::vector<sched::Word>(Slots);
    sched::Word alone{0, "alone"};

    Scene() {
        name_words(gate);
        for (unsigned slot = 0; slot < Slots; ++slot)
            in_slot[slot].rename("in slot", slot + 1);
    }

    void visit(unsigned preferred) {
        const unsigned slot = gate.enter(preferred);
        const bool slot_was_empty = in_slot[slot].exchange(1) == 0;
        SCHED_REQUIRE(slot_was_empty);
        in_slot[slot].store_relaxed(0);
        gate.leave(slot);
    }

    void be_alone() {
        for (sched::Word& word : in_slot) {
            const bool guests_are_out = word.load_relaxed() == 0;
            SCHED_REQUIRE(guests_are_out);
        }
        const bool only_closer = alone.exchange(1) == 0;
        SCHED_REQUIRE(only_closer);
        alone.store_relaxed(0);
        gate.open();
    }
};

template <class W, unsigned Slots, int Spins>
Program gathered(Cast cast) {
    return [cast](Run& run) {
        Scene<W, Slots, Spins> scene;
        for (unsigned guest = 0; guest < cast.guests; ++guest)
            run.thread("guest" + std::to_string(guest), [&, guest] { scene.visit(guest); });
        for (unsigned closer = 0; closer < cast.closers; ++closer) {
            run.thread("closer" + std::to_string(closer), [&] {
                scene.gate.close();
                scene.be_alone();
            });
        }
        run.join();
        require_all_free(scene.gate);
    };
}

/// A thread's claim of slot 0, or its closing of the gate, is still in its store buffer when it
/// reads the other word.
Program buffered(bool guest) {
    return [guest](Run& run) {
        Scene<sched::Word, 1, 1> scene;
        sched::Word& claim = guest ? scene.gate.claimed(0) : scene.gate.gate();
        sched::Word& until = guest ? scene.in_slot[0] : scene.alone;
        bool claims = true;
        sched::Delays buffer(
            guest ? 0 : 1,
            [&](const sched::Word& asked) {
                return &asked == &claim && std::exchange(claims, false);
            },
            until);
        claim.intercept(&buffer);
        until.intercept(&buffer);
        run.thread("guest", [&] { scene.visit(0); });
        run.thread("closer", [&] {
            scene.gate.close();
            scene.be_alone();
        });
        run.join();
    };
}

/// A thread that was turned away by a closing enters before the next one.
template <class W>
Program turned_away() {
    return [](Run& run) {
        BasicGate<W, 1, 0> gate;
        name_words(gate);
        sched::Word came(0, "came");
        run.thread("guest", [&] {
            const unsigned slot = gate.enter(0);
            came.store_relaxed(1);
            gate.leave(slot);
        });
        run.thread("closer", [&] {
            gate.close();
            const bool waits = gate.gate().load_relaxed() > 1;
            gate.open();
            gate.close();
            const bool was_let_in = !waits || came.load_relaxed() == 1;
            SCHED_REQUIRE(was_let_in);
            gate.open();
        });
        run.join();
        require_all_free(gate);
    };
}

/// Closes although a thread was turned away.
struct Barging : sched::Word {
    bool compare_exchange_ordered(std::uint64_t& expected, std::uint64_t desired) {
        expected = load_acquire() & ~std::uint64_t{1};
        return compare_exchange(expected, expected | desired);
    }
};

/// Checks a slot only once, before the gate is closed.
struct Careless : sched::Word {
    [[nodiscard]] std::uint64_t load_ordered() const { return 0; }
};

}  // namespace

TFDB_SCHED(gate_lets_many_in_or_one_alone) {
    Walk walk;
    walk.must_hold("a guest and a closer", gathered<Sound, 1, 0>({1, 1}));
    walk.must_hold("a guest and a closer, one spin", gathered<Sound, 1, 1>({1, 1}));
    walk.must_hold("two guests, two slots, a closer", gathered<Sound, 2, 0>({2, 1}));
    walk.must_hold("two guests, one slot", gathered<Sound, 1, 0>({2, 0}));
    walk.must_hold("three guests, two slots", gathered<Sound, 2, 0>({3, 0}));
    walk.must_hold("a guest and two closers", gathered<Sound, 1, 0>({1, 2}));
    walk.must_hold("who was turned away is in before the next closing", turned_away<Sound>());
}

TFDB_SCHED(gate_too_narrow_for_its_guests) {
    sched::Options options;
    options.preemptions = 3;
    Walk walk(options);
    walk.must_hold("two guests, one slot, a closer", gathered<Sound, 1, 0>({2, 1}));
    walk.must_hold("three guests, one slot", gathered<Sound, 1, 0>({3, 0}));
    options.preemptions = 2;
    Walk(options).must_hold("two guests, two slots, two closers", gathered<Sound, 2, 0>({2, 2}));
}

TFDB_SCHED(gate_flaws_are_found) {
    Walk walk;
    walk.must_fail("a guest that looks before it claims", "guests_are_out", buffered(true));
    walk.must_fail("a closer that looks before it closes", "guests_are_out", buffered(false));
    walk.must_fail("no look at the slots", "guests_are_out", gathered<Careless, 1, 0>({1, 1}));
    walk.must_fail("claims in two steps", "slot_was_empty",
                   gathered<SplitOrderedExchange, 1, 0>({2, 0}));
    walk.must_fail("closings in two steps", "gate().peek() == 0",
                   gathered<SplitOrderedExchange, 1, 0>({0, 2}));
    walk.must_fail("waiting for a slot in two steps", kDeadlock,
                   gathered<SplitCompareExchange, 1, 0>({2, 0}));
    walk.must_fail("leaving in two steps", kDeadlock, gathered<SplitExchange, 1, 0>({1, 1}));
    walk.must_fail("turned away in two steps", kDeadlock, gathered<SplitFetchAdd, 1, 0>({1, 1}));
    walk.must_fail("a lost wake-up", kDeadlock, gathered<SilentNotify, 1, 0>({1, 1}));
    walk.must_fail("waking one", kDeadlock, gathered<NarrowNotify, 2, 0>({2, 1}));
    walk.must_fail("sleeping without looking again", kDeadlock, gathered<BlindWait, 1, 0>({1, 1}));
    walk.must_fail("closing before those who were turned away", "was_let_in",
                   turned_away<Barging>());
}

}  // namespace tfdb::sync
