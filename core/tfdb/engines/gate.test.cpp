#include "tfdb/engines/gate.hpp"

#include <thread>
#include <vector>

#include "tfdb/testing/check.hpp"

namespace tfdb::sync {
namespace {

/// Guests count in words of their slots; closers access plain data, which ThreadSanitizer checks.
template <class G>
void crowd(unsigned guests, unsigned closers, std::uint64_t rounds) {
    G gate;
    long alone = 0;
    std::vector<std::uint64_t> visits(G::kSlots);
    std::vector<std::thread> running;
    for (unsigned guest = 0; guest < guests; ++guest) {
        running.emplace_back([&, guest] {
            for (std::uint64_t i = 0; i < rounds; ++i) {
                const unsigned slot = gate.enter(guest);
                CHECK(slot < G::kSlots);
                visits[slot] += alone % 2 == 0 ? 1 : 1'000'000;
                gate.add(slot, SlotCount::kRetries);
                gate.leave(slot);
            }
        });
    }
    for (unsigned closer = 0; closer < closers; ++closer) {
        running.emplace_back([&] {
            for (std::uint64_t i = 0; i < rounds / 10; ++i) {
                gate.close();
                ++alone;
                std::uint64_t seen = 0;
                for (const std::uint64_t count : visits)
                    seen += count;
                CHECK_EQ(seen, gate.total(SlotCount::kRetries));
                ++alone;
                gate.open();
            }
        });
    }
    for (std::thread& thread : running)
        thread.join();
    CHECK_EQ(gate.total(SlotCount::kRetries), guests * rounds);
    CHECK_EQ(alone, static_cast<long>(2 * closers * (rounds / 10)));
    CHECK_EQ(gate.gate().load_relaxed(), 0U);
}

}  // namespace

TFDB_TEST(gate_gives_each_its_own_slot) {
    Gate gate;
    std::vector<unsigned> taken;
    for (unsigned i = 0; i < Gate::kSlots; ++i) {
        taken.push_back(gate.enter(5));
        CHECK_EQ(taken.back(), (5 + i) % Gate::kSlots);
    }
    for (const unsigned slot : taken)
        gate.leave(slot);
    CHECK_EQ(gate.enter(5), 5U);
    gate.leave(5);
}

TFDB_TEST(gate_counts_for_its_slots) {
    Gate gate;
    const unsigned one = gate.enter(1);
    const unsigned other = gate.enter(2);
    gate.add(one, SlotCount::kRetries);
    gate.add(other, SlotCount::kRetries, 3);
    gate.age(one).store_relaxed(7);
    gate.state(other).store_relaxed(1);
    gate.leave(one);
    gate.leave(other);
    CHECK_EQ(gate.total(SlotCount::kRetries), 4U);
    CHECK_EQ(gate.total(SlotCount::kLockWaits), 0U);
    CHECK_EQ(gate.age(one).load_relaxed(), 7U);
    CHECK_EQ(gate.state(other).load_relaxed(), 1U);
}

TFDB_TEST(gate_keeps_guests_and_closers_apart) {
    crowd<Gate>(4, 1, 20'000);
}

TFDB_TEST(gate_of_few_slots_without_spinning_loses_no_wakeup) {
    crowd<BasicGate<Word, 2, 0>>(4, 2, 5'000);
}

TFDB_TEST(gate_prefers_different_slots_for_different_threads) {
    const unsigned mine = preferred_slot();
    CHECK_EQ(preferred_slot(), mine);
    unsigned other = mine;
    std::thread([&] { other = preferred_slot(); }).join();
    CHECK(other != mine);
    CHECK(other < Gate::kSlots);
}

}  // namespace tfdb::sync
