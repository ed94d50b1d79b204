// Stamps: int64 nanoseconds >= 0 on the data's clock, and arithmetic on them that cannot overflow.
#pragma once

#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>

namespace tfdb::clock {

using StampNs = std::int64_t;

inline constexpr StampNs kNanosPerSecond = 1'000'000'000;
/// The greatest stamp that a store accepts, 2^61 - 1: 2043-01-25. Differences of two stamps, and
/// sums of a stamp and a duration up to it, fit into int64.
inline constexpr StampNs kMaxStamp = std::numeric_limits<StampNs>::max() / 4;

/// Whether a store accepts it.
constexpr bool is_stamp(StampNs value) noexcept {
    return value >= 0 && value <= kMaxStamp;
}

/// a + b, clamped to the range of int64.
constexpr StampNs saturating_add(StampNs a, StampNs b) noexcept {
    StampNs sum = 0;
    if (__builtin_add_overflow(a, b, &sum)) {
        return b < 0 ? std::numeric_limits<StampNs>::min() : std::numeric_limits<StampNs>::max();
    }
    return sum;
}

/// a - b, clamped to the range of int64.
constexpr StampNs saturating_sub(StampNs a, StampNs b) noexcept {
    StampNs difference = 0;
    if (__builtin_sub_overflow(a, b, &difference)) {
        return b < 0 ? std::numeric_limits<StampNs>::max() : std::numeric_limits<StampNs>::min();
    }
    return difference;
}

/// The exact stamp of a message's two fields. Empty if it is negative, if `nanoseconds` is one
/// second or more, or if the sum overflows int64.
constexpr std::optional<StampNs> stamp_from_parts(std::int64_t seconds,
                                                  std::int64_t nanoseconds) noexcept {
    StampNs stamp = 0;
    if (seconds < 0 || nanoseconds < 0 || nanoseconds >= kNanosPerSecond ||
        __builtin_mul_overflow(seconds, kNanosPerSecond, &stamp) ||
        __builtin_add_overflow(stamp, nanoseconds, &stamp)) {
        return std::nullopt;
    }
    return stamp;
}

/// Encodes the stamp of a message whose nanoseconds are one second or more: a value below that of
/// any valid seconds and nanoseconds.
constexpr StampNs with_excess(std::uint32_t nanoseconds) noexcept {
    return std::numeric_limits<StampNs>::min() + StampNs{nanoseconds};
}
/// Decodes `with_excess`; empty for any other value.
constexpr std::optional<StampNs> excess_of(StampNs stamp) noexcept {
    const StampNs least = with_excess(static_cast<std::uint32_t>(kNanosPerSecond));
    if (stamp < least || stamp > with_excess(std::numeric_limits<std::uint32_t>::max())) {
        return std::nullopt;
    }
    return stamp - std::numeric_limits<StampNs>::min();
}

/// A duration in seconds, rounded to the nearest nanosecond (ties away from zero). Empty if it is
/// not finite or overflows. For durations only: a double cannot hold a current stamp exactly.
inline std::optional<StampNs> nanoseconds_from_seconds(double seconds) noexcept {
    const double nanoseconds = std::round(seconds * static_cast<double>(kNanosPerSecond));
    // 2^63 is exact as a double; the greatest int64 is not. The comparisons are false for NaN.
    constexpr double kLimit = 9223372036854775808.0;
    if (!(nanoseconds >= -kLimit && nanoseconds < kLimit)) {
        return std::nullopt;
    }
    return static_cast<StampNs>(nanoseconds);
}

/// For display and for ratios; loses the nanoseconds of large stamps.
constexpr double to_seconds(StampNs nanoseconds) noexcept {
    return static_cast<double>(nanoseconds) / static_cast<double>(kNanosPerSecond);
}

}  // namespace tfdb::clock
