#include "tfdb/clock/stamp.hpp"

#include <limits>

#include "tfdb/testing/check.hpp"

namespace tfdb::clock {
namespace {

constexpr StampNs kMin = std::numeric_limits<StampNs>::min();
constexpr StampNs kMax = std::numeric_limits<StampNs>::max();

TFDB_TEST(stamp_arithmetic_is_held_at_the_ends) {
    CHECK_EQ(saturating_add(1, 2), 3);
    CHECK_EQ(saturating_add(kMax, 1), kMax);
    CHECK_EQ(saturating_add(kMax, kMax), kMax);
    CHECK_EQ(saturating_add(kMin, -1), kMin);
    CHECK_EQ(saturating_add(kMax, -1), kMax - 1);
    CHECK_EQ(saturating_sub(3, 5), -2);
    CHECK_EQ(saturating_sub(kMin, 1), kMin);
    CHECK_EQ(saturating_sub(0, kMin), kMax);
    CHECK_EQ(saturating_sub(-2, kMax), kMin);
    CHECK_EQ(saturating_sub(kMax, -1), kMax);
}

TFDB_TEST(stamp_from_parts_is_exact_or_nothing) {
    CHECK_EQ(stamp_from_parts(0, 0).value(), 0);
    CHECK_EQ(stamp_from_parts(1'700'000'000, 123'456'789).value(), 1'700'000'000'123'456'789);
    CHECK_EQ(stamp_from_parts(9'223'372'036, 854'775'807).value(), kMax);
    CHECK(!stamp_from_parts(9'223'372'036, 854'775'808));
    CHECK(!stamp_from_parts(9'223'372'037, 0));
    CHECK(!stamp_from_parts(-1, 0));
    CHECK(!stamp_from_parts(0, -1));
    CHECK(!stamp_from_parts(0, kNanosPerSecond));
}

TFDB_TEST(nanoseconds_of_a_second_or_more_are_told_from_every_stamp) {
    constexpr StampNs kLeast = std::numeric_limits<StampNs>::min();
    for (const std::uint32_t nanos : {1'000'000'000U, 1'000'000'001U, 0xffffffffU}) {
        CHECK_EQ(excess_of(with_excess(nanos)).value(), StampNs{nanos});
        CHECK(!is_stamp(with_excess(nanos)));
        CHECK(with_excess(nanos) < -(StampNs{1} << 31) * kNanosPerSecond);
    }
    for (const StampNs stamp : {kLeast, with_excess(999'999'999U), kLeast + (StampNs{1} << 32),
                                -(StampNs{1} << 31) * kNanosPerSecond, StampNs{-1}, StampNs{0},
                                kMaxStamp, std::numeric_limits<StampNs>::max()}) {
        CHECK(!excess_of(stamp));
    }
}

TFDB_TEST(durations_in_seconds_are_rounded_and_checked) {
    CHECK_EQ(nanoseconds_from_seconds(0.1).value(), 100'000'000);
    CHECK_EQ(nanoseconds_from_seconds(-0.05).value(), -50'000'000);
    CHECK_EQ(nanoseconds_from_seconds(1.4e-9).value(), 1);
    CHECK_EQ(nanoseconds_from_seconds(1.6e-9).value(), 2);
    CHECK(!nanoseconds_from_seconds(std::numeric_limits<double>::quiet_NaN()));
    CHECK(!nanoseconds_from_seconds(std::numeric_limits<double>::infinity()));
    CHECK(!nanoseconds_from_seconds(-std::numeric_limits<double>::infinity()));
    CHECK(!nanoseconds_from_seconds(9'223'372'036.9));
    CHECK(nanoseconds_from_seconds(9'223'372'036.0).has_value());
    CHECK_NEAR(to_seconds(1'500'000'000), 1.5, 0.0);
}

}  // namespace
}  // namespace tfdb::clock
