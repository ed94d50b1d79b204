// The lock that lets one writer commit at a time: spins briefly, then sleeps.
#pragma once

#include "tfdb/sync/word.hpp"

namespace tfdb::sync {

/// A mutex on one word, after U. Drepper, "Futexes Are Tricky" (2011), section "Mutex, take 3",
/// with a second lane for urgent requests, which the word counts.
/// Threads: any may lock; only the holder may unlock.
/// Guarantee: `try_lock` is wait-free. An urgent request waits, from when it is counted, for the
/// holder and for other urgent ones only: nobody else gets the lock before it. Within a lane the
/// lock is not fair, and urgent requests may starve the others. `Spins` is small only in tests that
/// walk every interleaving.
template <class Word, int Spins = 100>  // a futex hand-off costs twice the throughput (measured)
class BasicCommitLock {
public:
    explicit BasicCommitLock(Word& word) noexcept : word_(word) {}

    /// Fails also while somebody asks urgently.
    bool try_lock() noexcept {
        std::uint64_t found = 0;
        return word_.compare_exchange(found, kHeld);
    }

    void lock() noexcept { await(kHeld | kAnyUrgent, 0); }

    void lock_urgently() noexcept {
        if (try_lock())
            return;
        word_.fetch_add(kOneUrgent);
        await(kHeld, kOneUrgent);
    }

    void unlock() noexcept {
        std::uint64_t found = kHeld;
        while (!word_.compare_exchange(found, found & kAnyUrgent)) {
        }
        if ((found & kSleepers) == 0)
            return;
        // One who is woken and may not have it yet would keep it from one who may.
        if ((found & kAnyUrgent) != 0)
            word_.notify_all();
        else
            word_.notify_one();
    }

    /// Whether somebody holds it, or asks urgently.
    [[nodiscard]] bool in_use() const noexcept { return word_.load_relaxed() != 0; }

private:
    static constexpr std::uint64_t kHeld = 1;
    static constexpr std::uint64_t kSleepers = 2;  // somebody may sleep
    static constexpr std::uint64_t kOneUrgent = 4;
    static constexpr std::uint64_t kAnyUrgent = ~(kHeld | kSleepers);

    /// Takes it once nothing is `in_the_way`; `counted` is this request's own part of the word.
    void await(std::uint64_t in_the_way, std::uint64_t counted) noexcept {
        std::uint64_t sleepers = 0;
        for (int spin = 0;;) {
            std::uint64_t found = word_.load_relaxed();
            if ((found & in_the_way) == 0) {
                if (word_.compare_exchange(found, (found - counted) | kHeld | sleepers))
                    return;
            } else if (spin < Spins) {
                ++spin;
                spin_pause();
            } else if ((found & kSleepers) != 0 ||
                       word_.compare_exchange(found, found | kSleepers)) {
                word_.wait(found | kSleepers);
                sleepers = kSleepers;  // who was woken may not have been the only one
            }
        }
    }

    Word& word_;
};

using CommitLock = BasicCommitLock<Word>;

}  // namespace tfdb::sync
