// The lock that lets one writer commit at a time: spins briefly, then sleeps.
#pragma once

#include <cstdint>
#include <limits>

#include "tfdb/sync/word.hpp"

namespace tfdb::sync {

/// A mutex on one word, after U. Drepper, "Futexes Are Tricky" (2011), section "Mutex, take 3",
/// with a second lane for urgent requests, which the word counts.
/// Threads: any may lock; only the holder may unlock.
/// Guarantee: `try_lock` is wait-free. Once an urgent request is counted, it waits only for the
/// holder and for other urgent requests: no ordinary request gets the lock before it. Within a lane
/// the lock is not fair, and urgent requests may starve the others. `Spins` is small only in tests
/// that explore every interleaving.
template <class Word, int Spins = 100>  // a futex hand-off costs twice the throughput (measured)
class BasicCommitLock {
public:
    explicit BasicCommitLock(Word& word) noexcept : word_(word) {}

    /// Also fails while an urgent request is counted.
    bool try_lock() noexcept {
        std::uint64_t found = 0;
        return word_.compare_exchange(found, kHeld);
    }

    void lock() noexcept { (void)await(kHeld | kAnyUrgent, 0, kForever); }

    void lock_urgently() noexcept {
        if (try_lock())
            return;
        word_.fetch_add(kOneUrgent);
        (void)await(kHeld, kOneUrgent, kForever);
    }

    /// Sleeps once, for at most this time. False: another thread still holds the lock; the caller
    /// may do other work, even with this lock, and call again. An urgent request is not counted
    /// between two calls.
    [[nodiscard]] bool lock_within(std::int64_t longest_ns, bool urgently) noexcept {
        if (try_lock())
            return true;
        if (!urgently)
            return await(kHeld | kAnyUrgent, 0, longest_ns);
        word_.fetch_add(kOneUrgent);
        if (await(kHeld, kOneUrgent, longest_ns))
            return true;
        withdraw();
        return false;
    }

    void unlock() noexcept {
        std::uint64_t found = kHeld;
        while (!word_.compare_exchange(found, found & kAnyUrgent)) {
        }
        if ((found & kSleepers) == 0)
            return;
        // A woken thread that may not lock yet would block one that may.
        if ((found & kAnyUrgent) != 0)
            word_.wake_all();
        else
            word_.wake_one();
    }

    /// Whether the lock is held or urgently requested.
    [[nodiscard]] bool in_use() const noexcept { return word_.load_relaxed() != 0; }

private:
    static constexpr std::uint64_t kHeld = 1;
    static constexpr std::uint64_t kSleepers = 2;  // a thread may sleep
    static constexpr std::uint64_t kOneUrgent = 4;
    static constexpr std::uint64_t kAnyUrgent = ~(kHeld | kSleepers);

    static constexpr std::int64_t kForever = std::numeric_limits<std::int64_t>::max();

    /// Locks once nothing is `in_the_way`; `counted` is this request's own part of the word. False:
    /// the word is still in the way after a sleep of `longest_ns`. The word then marks a possible
    /// sleeper, so other threads do not lose the wake-up that ended this sleep.
    bool await(std::uint64_t in_the_way, std::uint64_t counted, std::int64_t longest_ns) noexcept {
        std::uint64_t sleepers = 0;
        for (int spin = 0;;) {
            std::uint64_t found = word_.load_relaxed();
            if ((found & in_the_way) == 0) {
                if (word_.compare_exchange(found, (found - counted) | kHeld | sleepers))
                    return true;
            } else if (spin < Spins) {
                ++spin;
                spin_pause();
            } else if ((found & kSleepers) != 0 ||
                       word_.compare_exchange(found, found | kSleepers)) {
                if (sleepers != 0 && longest_ns != kForever)
                    return false;
                (void)word_.sleep(found | kSleepers, longest_ns);
                sleepers = kSleepers;  // other threads may sleep
            }
        }
    }

    /// Takes an urgent request out of the word. A free lock was reserved for it, so others are
    /// woken.
    void withdraw() noexcept {
        std::uint64_t found = word_.load_relaxed();
        std::uint64_t left = 0;
        do {
            left = found - kOneUrgent;
            if ((found & kHeld) == 0)
                left &= ~kSleepers;
        } while (!word_.compare_exchange(found, left));
        if ((found & kHeld) == 0 && (found & kSleepers) != 0)
            word_.wake_all();
    }

    Word& word_;
};

using CommitLock = BasicCommitLock<Word>;

}  // namespace tfdb::sync
