// The shared/exclusive lock of one frame, with its holders.
#pragma once

#include <bit>

#include "tfdb/sync/word.hpp"

namespace tfdb::sync {

/// One word: a bit per holder (a gate's slot), one for waiting threads, one for exclusive. Shared
/// is compatible with shared only. Engines decide which session waits, dies or wounds; `wait_for`
/// waits.
/// Threads: any; a slot is used by one thread at a time.
/// Guarantee: all but `wait_for` are lock-free and never wait. The event wakes waiting threads
/// when the last holder leaves, or the last but one (the waiting thread itself, for an upgrade).
template <class Word>
class BasicFrameLock {
public:
    static constexpr std::uint64_t kExclusive = std::uint64_t{1} << 63;
    static constexpr std::uint64_t kWaited = std::uint64_t{1} << 62;
    static constexpr std::uint64_t kHolders = kWaited - 1;

    static constexpr std::uint64_t bit(unsigned slot) { return std::uint64_t{1} << slot; }

    /// The result of a request, and the word that it found.
    struct Attempt {
        bool granted;
        std::uint64_t found;

        explicit operator bool() const { return granted; }
        /// The other holders of the lock: they block a refused request.
        [[nodiscard]] std::uint64_t others(unsigned slot) const {
            return found & kHolders & ~bit(slot);
        }
        /// Whether a thread sleeps on this lock. If the rule depends on ages, a thread that is
        /// granted such a lock must notify the event, so that the sleepers check again.
        [[nodiscard]] bool waited() const { return (found & kWaited) != 0; }
    };

    explicit BasicFrameLock(Word& word) noexcept : word_(word) {}

    /// Also granted to a slot that already holds it, shared or exclusive.
    [[nodiscard]] Attempt try_shared(unsigned slot) noexcept {
        std::uint64_t found = word_.load_relaxed();
        do {
            if ((found & bit(slot)) != 0)
                return {true, found};
            if ((found & kExclusive) != 0)
                return {false, found};
        } while (!word_.compare_exchange(found, found | bit(slot)));
        return {true, found};
    }

    /// Also granted to the only holder of the shared lock, and to its exclusive holder.
    [[nodiscard]] Attempt try_exclusive(unsigned slot) noexcept {
        const std::uint64_t wanted = bit(slot) | kExclusive;
        std::uint64_t found = word_.load_relaxed();
        do {
            if ((found & wanted) == wanted)
                return {true, found};
            if ((found & kHolders & ~bit(slot)) != 0)
                return {false, found};
        } while (!word_.compare_exchange(found, found | wanted));
        return {true, found};
    }

    /// Releases the slot's hold; requires one. True: the caller must `notify_all` the event.
    [[nodiscard]] bool release(unsigned slot) noexcept {
        std::uint64_t found = word_.load_relaxed();
        for (;;) {
            const std::uint64_t left = found & kHolders & ~bit(slot);
            const bool tell = (found & kWaited) != 0 && std::popcount(left) <= 1;
            const std::uint64_t waited = tell ? 0 : found & kWaited;
            if (word_.compare_exchange(found, left | waited))
                return tell;
        }
    }

    /// Marks a lock that refused, after Event::prepare. False: it has changed, retry.
    [[nodiscard]] bool mark_waited(const Attempt& refused) noexcept {
        std::uint64_t found = refused.found;
        return word_.compare_exchange(found, refused.found | kWaited);
    }

    /// Sleeps until a refused lock may be free, or until `give_up()` is true at a notification. A
    /// thread that makes `give_up()` true must then `notify_all` the event.
    template <class Event, class GiveUp>
    void wait_for(const Attempt& refused, Event& event, GiveUp give_up) {
        const auto epoch = event.prepare();
        if (give_up() || !mark_waited(refused))
            event.cancel();
        else
            event.wait(epoch);
    }

    [[nodiscard]] std::uint64_t holders() const noexcept { return word_.load_acquire() & kHolders; }
    [[nodiscard]] bool held_by(unsigned slot) const noexcept {
        return (word_.load_relaxed() & bit(slot)) != 0;
    }
    [[nodiscard]] bool held_exclusively_by(unsigned slot) const noexcept {
        const std::uint64_t wanted = bit(slot) | kExclusive;
        return (word_.load_relaxed() & wanted) == wanted;
    }

private:
    Word& word_;
};

using FrameLock = BasicFrameLock<Word>;

}  // namespace tfdb::sync
