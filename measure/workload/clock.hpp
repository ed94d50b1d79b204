// One clock for latencies and stamps: it never jumps, and reads like the time of day.
#pragma once

#include <time.h>

#include <cstdint>

namespace tfdb::driver {

inline std::int64_t clock_ns(clockid_t clock) noexcept {
    timespec time{};
    clock_gettime(clock, &time);
    return std::int64_t{1'000'000'000} * time.tv_sec + time.tv_nsec;
}

// Threads: any, once made. Guarantee: `now` is one read of the monotonic clock.
class Clock {
public:
    Clock() : offset_(clock_ns(CLOCK_REALTIME) - clock_ns(CLOCK_MONOTONIC)) {}

    [[nodiscard]] std::int64_t now() const noexcept { return clock_ns(CLOCK_MONOTONIC) + offset_; }
    void sleep_until(std::int64_t when) const noexcept {
        const std::int64_t at = when - offset_;
        const timespec time{at / 1'000'000'000, at % 1'000'000'000};
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &time, nullptr);
    }

private:
    std::int64_t offset_;
};

}  // namespace tfdb::driver
