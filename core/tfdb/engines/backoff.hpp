// Delays before a retry after contention.
#pragma once

#include <sched.h>
#include <time.h>

#include <algorithm>

#include "tfdb/sync/word.hpp"

namespace tfdb::sync {

/// Pauses of a thread without a notification.
/// Threads: any. Guarantee: `sleep` returns after about the given time, even if a signal arrives.
class ThreadPause {
public:
    static void spin() noexcept { spin_pause(); }
    static void yield() noexcept { ::sched_yield(); }
    static void sleep(std::uint32_t nanoseconds) noexcept {
        const timespec time{0, static_cast<long>(nanoseconds)};
        ::nanosleep(&time, nullptr);
    }
};

/// Exponential backoff with jitter: spins, then yields, finally sleeps.
/// Threads: one; each session has its own.
/// Guarantee: the n-th pause spins at most 2^n times for n < 6, yields at most 2 times for n < 10,
/// and otherwise sleeps for at most 64 us (plus the kernel's delay).
template <class Pause>
class BasicBackoff {
public:
    static constexpr unsigned kSpinSteps = 6;
    static constexpr unsigned kYieldSteps = 4;
    static constexpr unsigned kMostYields = 2;
    static constexpr std::uint32_t kFirstSleep = 4'000;
    static constexpr std::uint32_t kLongestSleep = 64'000;  // ns

    explicit BasicBackoff(std::uint64_t seed) noexcept : random_(seed * 2 + 1) {}

    /// Pauses, longer each time.
    void pause() noexcept {
        const unsigned step = step_;
        step_ = std::min(step_ + 1, kLastStep);
        if (step < kSpinSteps) {
            for (std::uint64_t left = up_to(std::uint64_t{1} << step); left > 0; --left)
                Pause::spin();
        } else if (step < kSpinSteps + kYieldSteps) {
            for (std::uint64_t left = up_to(kMostYields); left > 0; --left)
                Pause::yield();
        } else {
            const unsigned doublings = step - kSpinSteps - kYieldSteps;
            const std::uint32_t window = std::min(kFirstSleep << doublings, kLongestSleep);
            Pause::sleep(static_cast<std::uint32_t>(up_to(window)));
        }
    }

    /// Makes the next pause short again.
    void reset() noexcept { step_ = 0; }

private:
    static constexpr unsigned kLastStep = kSpinSteps + kYieldSteps + 4;
    static_assert(kFirstSleep << 4 == kLongestSleep);

    /// Uniform in [window / 2, window], at least 1: two colliding threads do not wait equally long.
    std::uint64_t up_to(std::uint64_t window) noexcept {
        random_ ^= random_ << 13;  // xorshift64, G. Marsaglia (2003)
        random_ ^= random_ >> 7;
        random_ ^= random_ << 17;
        const std::uint64_t half = window / 2;
        return std::max<std::uint64_t>(1, window - half + random_ % (half + 1));
    }

    std::uint64_t random_;
    unsigned step_ = 0;
};

using Backoff = BasicBackoff<ThreadPause>;

}  // namespace tfdb::sync
