// Sleeps until a change; notifying costs one load if no thread waits.
#pragma once

#include "tfdb/sync/word.hpp"

namespace tfdb::sync {

/// An event count in one word: the epoch in the high bits, the number of waiters in the low bits.
/// After D. Vyukov's eventcount. A waiter calls `prepare`, checks the condition, then calls `wait`
/// or `cancel`. A thread that changes the condition calls `notify_all` after the change.
/// Threads: any.
/// Guarantee: all but `wait` and `await` are wait-free. No wake-up is lost: the check after
/// `prepare` sees the change, or the change's `notify_all` ends the `wait`.
template <class Word, int Spins = 100>
class BasicEvent {
public:
    using Epoch = std::uint64_t;

    explicit BasicEvent(Word& word) noexcept : word_(word) {}

    /// Announces a waiter. Its following reads see the current or a later state.
    [[nodiscard]] Epoch prepare() noexcept {
        const std::uint64_t before = word_.fetch_add(kOneWaiter);
        Word::fence_full();
        return before >> kEpochShift;
    }

    /// Withdraws the announcement.
    void cancel() noexcept { word_.fetch_add(~kOneWaiter + 1); }

    /// Sleeps until a `notify_all` after `prepare`.
    void wait(Epoch epoch) noexcept {
        for (std::uint64_t now = word_.load_acquire(); now >> kEpochShift == epoch;
             now = word_.load_acquire()) {
            word_.wait(now);
        }
        cancel();
    }

    /// Wakes all waiting threads; one load behind a full fence if none waits.
    void notify_all() noexcept {
        Word::fence_full();
        if ((word_.load_relaxed() & kWaiters) == 0)
            return;
        word_.fetch_add(kOneEpoch);
        word_.notify_all();
    }

    /// Returns once `ready()` is true: spins a little, then sleeps.
    template <class Ready>
    void await(Ready ready) {
        for (int i = 0; i < Spins; ++i) {
            if (ready())
                return;
            spin_pause();
        }
        for (;;) {
            const Epoch epoch = prepare();
            if (ready())
                return cancel();
            wait(epoch);
        }
    }

private:
    static constexpr unsigned kEpochShift = 16;
    static constexpr std::uint64_t kOneWaiter = 1;
    static constexpr std::uint64_t kOneEpoch = std::uint64_t{1} << kEpochShift;
    static constexpr std::uint64_t kWaiters = kOneEpoch - 1;

    Word& word_;
};

using Event = BasicEvent<Word>;

}  // namespace tfdb::sync
