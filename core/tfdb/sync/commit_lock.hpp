// The lock that lets one writer commit at a time: spins briefly, then sleeps.
#pragma once

#include "tfdb/sync/word.hpp"

namespace tfdb::sync {

/// A mutex on one word, after U. Drepper, "Futexes Are Tricky" (2011), section "Mutex, take 3".
/// Threads: any may lock; only the holder may unlock.
/// Guarantee: `try_lock` is wait-free; `lock` blocks, and is not fair. `Spins` is small only in
/// tests that walk every interleaving.
template <class Word, int Spins = 100>  // a futex hand-off costs twice the throughput (measured)
class BasicCommitLock {
public:
    explicit BasicCommitLock(Word& word) noexcept : word_(word) {}

    bool try_lock() noexcept {
        std::uint64_t expected = kFree;
        return word_.compare_exchange(expected, kHeld);
    }

    void lock() noexcept {
        for (int i = 0; i < Spins; ++i) {
            if (word_.load_relaxed() == kFree && try_lock())
                return;
            spin_pause();
        }
        while (word_.exchange(kContended) != kFree)
            word_.wait(kContended);
    }

    void unlock() noexcept {
        if (word_.exchange(kFree) == kContended)
            word_.notify_one();
    }

    [[nodiscard]] bool held() const noexcept { return word_.load_relaxed() != kFree; }

private:
    static constexpr std::uint64_t kFree = 0;
    static constexpr std::uint64_t kHeld = 1;
    static constexpr std::uint64_t kContended = 2;  // held, and somebody may sleep

    Word& word_;
};

using CommitLock = BasicCommitLock<Word>;

}  // namespace tfdb::sync
