// Velocities of motions that are known in closed form.
#include <functional>

#include "tfdb/store/fixture.hpp"

namespace tfdb {
namespace {

using namespace fixture;
using geometry::Quat;
using geometry::Vec3;

constexpr StampNs kMilli = 1'000'000;

Quat about_z(double angle) {
    return {0.0, 0.0, std::sin(angle / 2), std::cos(angle / 2)};
}

/// Samples of a motion each millisecond of the first two seconds.
Buffer moving(const std::function<Pose(double)>& motion) {
    Buffer buffer(keeping(std::nullopt));
    std::vector<TransformView> batch;
    for (StampNs stamp = 0; stamp <= 2 * kSecond; stamp += kMilli)
        batch.push_back({"map", "base", stamp, motion(clock::to_seconds(stamp))});
    buffer.set_transforms(batch, false, "");
    return buffer;
}

void check_vector(const Vec3& got, const Vec3& expected, double tolerance) {
    CHECK_NEAR(got.x, expected.x, tolerance);
    CHECK_NEAR(got.y, expected.y, tolerance);
    CHECK_NEAR(got.z, expected.z, tolerance);
}

}  // namespace

TFDB_TEST(velocity_constant_and_straight) {
    const Buffer buffer = moving([](double t) {
        return Pose{{1 + 2 * t, 3 - t, 0.5 * t}, about_z(0.7)};
    });
    for (const std::optional<StampNs> at : {std::optional<StampNs>(kSecond), {}}) {
        const Twist twist = buffer.lookup_velocity("map", "base", at, kSecond / 10, "", {}, "");
        check_vector(twist.linear, {2, -1, 0.5}, 1e-9);
        check_vector(twist.angular, {0, 0, 0}, 1e-9);
    }
}

TFDB_TEST(velocity_turning_in_place_about_a_tilted_axis) {
    // A rotation at 1.5 rad/s about (0.6, 0, 0.8).
    const Buffer buffer = moving([](double t) {
        const double half = 0.75 * t;
        return Pose{{4, 5, 6}, {0.6 * std::sin(half), 0, 0.8 * std::sin(half), std::cos(half)}};
    });
    const Twist twist = buffer.lookup_velocity("map", "base", kSecond, kSecond / 10, "", {}, "");
    check_vector(twist.linear, {0, 0, 0}, 1e-9);
    check_vector(twist.angular, {0.9, 0, 1.2}, 1e-9);
    // The axis is the same in the frame itself, because it is the rotation axis.
    const Twist own = buffer.lookup_velocity("map", "base", kSecond, kSecond / 10, "base", {}, "");
    check_vector(own.angular, {0.9, 0, 1.2}, 1e-9);
}

TFDB_TEST(velocity_of_a_point_on_a_turning_frame) {
    constexpr double kRate = 2.0;
    const Buffer buffer = moving([](double t) { return Pose{{4, 5, 6}, about_z(kRate * t)}; });
    // The point (1, 0, 0) of base circles around (4, 5, 6) at 2 m/s.
    const Twist twist =
        buffer.lookup_velocity("map", "base", kSecond, 2 * kMilli, "", {1, 0, 0}, "");
    const double angle = kRate;
    check_vector(twist.linear, {-kRate * std::sin(angle), kRate * std::cos(angle), 0}, 1e-5);
    check_vector(twist.angular, {0, 0, kRate}, 1e-9);
    // In the axes of base it is always along +y.
    const Twist own =
        buffer.lookup_velocity("map", "base", kSecond, 2 * kMilli, "base", {1, 0, 0}, "base");
    check_vector(own.linear, {0, kRate, 0}, 1e-5);
    // The same point given in map coordinates.
    const Vec3 in_map{4 + std::cos(angle), 5 + std::sin(angle), 6};
    const Twist given =
        buffer.lookup_velocity("map", "base", kSecond, 2 * kMilli, "", in_map, "map");
    check_vector(given.linear, twist.linear, 1e-9);
}

TFDB_TEST(velocity_on_a_circle_has_centre_and_rim_right) {
    constexpr double kRate = 0.5;
    constexpr double kRadius = 3.0;
    const Buffer buffer = moving([](double t) {
        const double angle = kRate * t;
        return Pose{{kRadius * std::cos(angle), kRadius * std::sin(angle), 1}, about_z(angle)};
    });
    const Twist rim =
        buffer.lookup_velocity("map", "base", kSecond, 10 * kMilli, "base", {0, 0, 0}, "");
    check_vector(rim.linear, {0, kRadius * kRate, 0}, 1e-4);
    const Twist centre =
        buffer.lookup_velocity("map", "base", kSecond, 10 * kMilli, "base", {-kRadius, 0, 0}, "");
    check_vector(centre.linear, {0, 0, 0}, 1e-4);
}

TFDB_TEST(velocity_window_lies_inside_the_data_and_keeps_its_length) {
    // Speed 2 t in x: the mean over a window is the speed at its midpoint.
    const Buffer buffer = moving([](double t) { return Pose{{t * t, 0, 0}, about_z(0.3)}; });
    const auto speed = [&](std::optional<StampNs> at, StampNs interval) {
        return buffer.lookup_velocity("map", "base", at, interval, "", {}, "").linear.x;
    };
    CHECK_NEAR(speed(kSecond, kSecond / 5), 2.0, 1e-9);
    CHECK_NEAR(speed(2 * kSecond, kSecond / 5), 2 * 1.9, 1e-9);
    CHECK_NEAR(speed({}, kSecond / 5), 2 * 1.9, 1e-9);
    CHECK_NEAR(speed(2 * kSecond - 50 * kMilli, kSecond / 5), 2 * 1.9, 1e-9);
    CHECK_NEAR(speed(kSecond / 20, kSecond / 5), 2 * 0.1, 1e-9);
    CHECK_NEAR(speed(0, kSecond / 5), 2 * 0.1, 1e-9);
    // A window longer than the data: the mean speed of all data.
    CHECK_NEAR(speed(kSecond / 3, 5 * kSecond), 2.0, 1e-9);
    CHECK_NEAR(speed(2 * kSecond, StampNs{1} << 60), 2.0, 1e-9);
    CHECK_THROWS_AS(speed(kSecond, -1), InvalidArgument);
    // Outside the data the error names the requested stamp.
    const auto past = THROWN(Extrapolation, speed(2 * kSecond + 1, kSecond / 5));
    CHECK(past && past->detail().stamp == 2 * kSecond + 1 && past->detail().reason == "future");
}

TFDB_TEST(velocity_window_lies_inside_what_hangs_on_the_same_parent) {
    // Until 4 s base moves at 2 m/s in map, and then at -3 m/s on a ship.
    Buffer buffer(keeping(std::nullopt));
    set_static(buffer, "map", "ship", pose_of(50));
    for (StampNs s = 0; s < 4; ++s)
        set(buffer, "map", "base", s * kSecond, {{2.0 * static_cast<double>(s), 1, 2}, about_z(1)});
    for (StampNs s = 4; s <= 8; ++s) {
        const Pose pose{{-3.0 * static_cast<double>(s), 5, 6}, about_z(1)};
        set(buffer, "ship", "base", s * kSecond, pose);
    }
    const auto speed = [&](const char* in, StampNs at) {
        return buffer.lookup_velocity(in, "base", at, 2 * kSecond, "", {}, "").linear.x;
    };
    CHECK_NEAR(speed("map", 0), 2.0, 1e-9);
    CHECK_NEAR(speed("map", 3 * kSecond / 2), 2.0, 1e-9);
    CHECK_NEAR(speed("ship", 4 * kSecond), -3.0, 1e-9);
    CHECK_NEAR(speed("ship", 9 * kSecond / 2), -3.0, 1e-9);
    CHECK_NEAR(speed("ship", 8 * kSecond), -3.0, 1e-9);
}

TFDB_TEST(velocity_needs_two_stamps) {
    Buffer buffer(keeping(std::nullopt));
    set(buffer, "map", "base", 3 * kSecond, pose_of(1));
    set_static(buffer, "base", "eye", pose_of(2));
    const auto lone =
        THROWN(Extrapolation, buffer.lookup_velocity("map", "eye", {}, kSecond, "", {}, ""));
    CHECK(lone && lone->detail().reason == "no data" && lone->detail().edge == "base");
    CHECK(lone && lone->detail().stamp == 3 * kSecond && says(*lone, "needs two stamps"));
    // A static edge has velocity 0 at every stamp.
    for (const StampNs at : {StampNs{0}, kSecond, 9 * kSecond}) {
        const Twist still = buffer.lookup_velocity("base", "eye", at, kSecond, "", {1, 2, 3}, "");
        check_vector(still.linear, {0, 0, 0}, 0);
        check_vector(still.angular, {0, 0, 0}, 0);
    }
}

TFDB_TEST(velocity_errors_name_the_frames_that_were_asked_for) {
    Buffer buffer = moving([](double t) { return Pose{{t, 0, 0}, about_z(0.3)}; });
    set_static(buffer, "space", "moon", pose_of(1));
    const auto ask = [&](const char* tracking, const char* observation, const char* reference,
                         const char* point_frame) {
        return buffer.lookup_velocity(observation, tracking, kSecond, kMilli, reference, {},
                                      point_frame);
    };
    const auto tracking = THROWN(UnknownFrame, ask("nil", "map", "", ""));
    CHECK(tracking && tracking->detail().frame == "nil");
    const auto observation = THROWN(UnknownFrame, ask("base", "nil", "", ""));
    CHECK(observation && observation->detail().frame == "nil");
    const auto reference = THROWN(UnknownFrame, ask("base", "map", "nil", ""));
    CHECK(reference && reference->detail().frame == "nil" && says(*reference, "'nil'"));
    const auto point = THROWN(UnknownFrame, ask("base", "map", "", "nil"));
    CHECK(point && point->detail().frame == "nil" && says(*point, "'nil'"));
    const auto apart = THROWN(Disconnected, ask("base", "map", "moon", ""));
    CHECK(apart && apart->detail().target == "moon" && apart->detail().source == "map");
}

TFDB_TEST(velocity_of_a_point_that_is_nowhere_is_refused) {
    Buffer buffer = moving([](double t) { return Pose{{t, 0, 0}, about_z(0.3)}; });
    for (const double bad :
         {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
        for (const geometry::Vec3& point : {geometry::Vec3{bad, 0, 0}, {0, bad, 0}, {1, 2, bad}}) {
            const auto error =
                THROWN(InvalidArgument,
                       buffer.lookup_velocity("map", "base", kSecond, kMilli, "", point, ""));
            CHECK(error && says(*error, "must be finite"));
        }
    }
}

}  // namespace tfdb
