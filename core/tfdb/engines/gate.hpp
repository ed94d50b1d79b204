// Admits many sessions at once, until one closes it to be alone.
#pragma once

#include <array>

#include "tfdb/sync/word.hpp"

namespace tfdb::sync {

/// The statistics that a slot counts.
enum class SlotCount : std::uint8_t { kRetries, kLockWaits };

/// Slots that threads enter and leave, and a word that closes them all. A thread must leave its
/// slot before it closes the gate, or waits for a thread that may close it.
/// Threads: any. Only the thread in the slot calls `leave`, `add` and stores to `age`. One thread
/// closes at a time, and only that thread calls `open`.
/// Guarantee: `enter` and `leave` cost one exchange each on the thread's own cache line, and do not
/// wait while the gate is open and a slot is free. `close` waits for the threads inside; `enter`
/// waits while it is closed. A thread that was turned away enters before the next `close`.
template <class Word, unsigned Slots = 62, int Spins = 100>
class BasicGate {
public:
    static constexpr unsigned kSlots = Slots;

    /// Returns the caller's slot: `preferred`, or the next free one.
    [[nodiscard]] unsigned enter(unsigned preferred) noexcept {
        const unsigned slot = claim(preferred);
        if ((gate().load_ordered() & kClosed) == 0) [[likely]]
            return slot;
        leave(slot);
        return enter_after_closure(preferred);
    }

    void leave(unsigned slot) noexcept {
        if (claimed(slot).exchange(kFree) == kAwaited) [[unlikely]]
            claimed(slot).notify_all();
    }

    /// Blocks new threads, then waits until the last thread inside has left.
    void close() noexcept {
        std::uint64_t found = 0;
        for (int spin = 0; !gate().compare_exchange_ordered(found, kClosed); found = 0, ++spin) {
            if (spin < Spins)
                spin_pause();
            else
                gate().wait(found);
        }
        for (unsigned slot = 0; slot < Slots; ++slot)
            await_free(slot);
    }

    void open() noexcept {
        gate().fetch_add(~kClosed + 1);
        gate().notify_all();
    }

    /// Whether a thread is inside, has closed the gate, or waits for it to open.
    [[nodiscard]] bool in_use() const noexcept {
        bool used = gate_line_.words[0].load_relaxed() != 0;
        for (const Line& line : lines_)
            used |= line.words[kClaimed].load_relaxed() != kFree;
        return used;
    }

    /// Seniority of the session in a slot: the lower number is senior.
    [[nodiscard]] Word& age(unsigned slot) noexcept { return lines_[slot].words[kAge]; }
    /// Whether others have wounded that session: see txn::TwoPhaseSession.
    [[nodiscard]] Word& state(unsigned slot) noexcept { return lines_[slot].words[kState]; }

    void add(unsigned slot, SlotCount which, std::uint64_t count = 1) noexcept {
        Word& word = lines_[slot].words[kCounts + static_cast<unsigned>(which)];
        word.store_relaxed(word.load_relaxed() + count);
    }
    /// Sum over all slots; threads inside may be adding meanwhile.
    [[nodiscard]] std::uint64_t total(SlotCount which) const noexcept {
        std::uint64_t sum = 0;
        for (const Line& line : lines_)
            sum += line.words[kCounts + static_cast<unsigned>(which)].load_relaxed();
        return sum;
    }

    /// The gate's words, for tests.
    [[nodiscard]] Word& gate() noexcept { return gate_line_.words[0]; }
    [[nodiscard]] Word& claimed(unsigned slot) noexcept { return lines_[slot].words[kClaimed]; }

private:
    // The gate's word: whether it is closed, and the number of turned-away threads not yet
    // admitted.
    static constexpr std::uint64_t kClosed = 1;
    static constexpr std::uint64_t kTurnedAway = 2;
    // A slot's first word.
    static constexpr std::uint64_t kFree = 0;
    static constexpr std::uint64_t kTaken = 1;
    static constexpr std::uint64_t kAwaited = 2;  // taken, and a thread sleeps until it is free

    enum LineWord : unsigned { kClaimed, kAge, kState, kCounts, kLineWords = 8 };
    struct alignas(64) Line {
        std::array<Word, kLineWords> words;
    };

    bool try_claim(unsigned slot) noexcept {
        std::uint64_t found = kFree;
        return claimed(slot).compare_exchange_ordered(found, kTaken);
    }

    unsigned claim(unsigned preferred) noexcept {
        for (;;) {
            for (unsigned i = 0; i < Slots; ++i) {
                const unsigned slot = (preferred + i) % Slots;
                if (try_claim(slot)) [[likely]]
                    return slot;
            }
            await_change(preferred % Slots);
        }
    }

    /// If the gate is open after this thread has counted itself, it stays open.
    unsigned enter_after_closure(unsigned preferred) noexcept {
        std::uint64_t now = gate().fetch_add(kTurnedAway) + kTurnedAway;
        for (int spin = 0; (now & kClosed) != 0; now = gate().load_relaxed(), ++spin) {
            if (spin < Spins)
                spin_pause();
            else
                gate().wait(now);
        }
        const unsigned slot = claim(preferred);
        if (gate().fetch_add(~kTurnedAway + 1) == kTurnedAway)
            gate().notify_all();
        return slot;
    }

    void await_free(unsigned slot) noexcept {
        for (int spin = 0; claimed(slot).load_ordered() != kFree; ++spin) {
            if (spin < Spins)
                spin_pause();
            else
                await_change(slot);
        }
    }

    /// Sleeps while the same thread keeps the slot.
    void await_change(unsigned slot) noexcept {
        std::uint64_t found = kTaken;
        if (claimed(slot).compare_exchange(found, kAwaited) || found == kAwaited)
            claimed(slot).wait(kAwaited);
    }

    Line gate_line_;
    std::array<Line, Slots> lines_;
};

using Gate = BasicGate<Word>;

/// This thread's preferred slot: different for each thread while slots suffice.
inline unsigned preferred_slot() noexcept {
    static Word next{};
    thread_local const unsigned mine = static_cast<unsigned>(next.fetch_add(1) % Gate::kSlots);
    return mine;
}

}  // namespace tfdb::sync
