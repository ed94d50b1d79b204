#include "tfdb/geometry/slerp.hpp"

#include <cmath>
#include <numbers>

#include "tfdb/geometry/random_pose.hpp"
#include "tfdb/testing/check.hpp"

namespace tfdb::geometry {
namespace {

using testing::distance;
using testing::RandomPoses;
using testing::rotation_distance;

constexpr double kTight = 4e-15;
constexpr int kRounds = 20'000;
constexpr double kDegree = std::numbers::pi / 180.0;

struct LongQuat {
    long double x, y, z, w;
};

LongQuat widen(const Quat& q) {
    const LongQuat r{q.x, q.y, q.z, q.w};
    const long double length = std::sqrt(r.x * r.x + r.y * r.y + r.z * r.z + r.w * r.w);
    return {r.x / length, r.y / length, r.z / length, r.w / length};
}

/// The definition, in long double; the sign follows `a`'s side.
Quat reference_slerp(const Quat& from, const Quat& to, double at) {
    const LongQuat a = widen(from);
    LongQuat b = widen(to);
    if (a.x * b.x + a.y * b.y + a.z * b.z + a.w * b.w < 0) {
        b = {-b.x, -b.y, -b.z, -b.w};
    }
    const long double u = at;
    const long double apart =
        std::hypot(std::hypot(a.x - b.x, a.y - b.y), std::hypot(a.z - b.z, a.w - b.w));
    const long double along =
        std::hypot(std::hypot(a.x + b.x, a.y + b.y), std::hypot(a.z + b.z, a.w + b.w));
    const long double angle = 2 * std::atan2(apart, along);
    const bool still = angle == 0;
    const long double of_a = still ? 1 - u : std::sin((1 - u) * angle) / std::sin(angle);
    const long double of_b = still ? u : std::sin(u * angle) / std::sin(angle);
    return {
        static_cast<double>(of_a * a.x + of_b * b.x), static_cast<double>(of_a * a.y + of_b * b.y),
        static_cast<double>(of_a * a.z + of_b * b.z), static_cast<double>(of_a * a.w + of_b * b.w)};
}

/// Greatest error of slerp over random quaternions at angles of the sphere in [low, high].
double worst_slerp(RandomPoses& random, double low, double high, double u_low, double u_high) {
    double worst = 0.0;
    for (int i = 0; i < kRounds; ++i) {
        const Quat a = random.rotation();
        const Quat b = random.apart(a, random.uniform(low, high));
        const double u = random.uniform(u_low, u_high);
        worst = std::fmax(worst, distance(slerp(a, b, u), reference_slerp(a, b, u)));
    }
    return worst;
}

TFDB_TEST(pose_composition_is_associative) {
    RandomPoses random("pose_composition_is_associative", 1);
    for (int i = 0; i < kRounds; ++i) {
        const Pose a = random.pose();
        const Pose b = random.pose();
        const Pose c = random.pose();
        const Pose left = compose(compose(a, b), c);
        const Pose right = compose(a, compose(b, c));
        CHECK_NEAR(distance(left.translation, right.translation), 0.0, 1e-13);
        CHECK_NEAR(distance(left.rotation, right.rotation), 0.0, kTight);
    }
}

TFDB_TEST(pose_inverse_undoes_on_both_sides) {
    RandomPoses random("pose_inverse_undoes_on_both_sides", 2);
    for (int i = 0; i < kRounds; ++i) {
        const Pose a = random.pose();
        for (const Pose& none : {compose(a, inverse(a)), compose(inverse(a), a)}) {
            CHECK_NEAR(distance(none.translation, {0.0, 0.0, 0.0}), 0.0, 1e-13);
            CHECK_NEAR(distance(none.rotation, identity().rotation), 0.0, kTight);
        }
        const Pose b = random.pose();
        const Pose whole = inverse(compose(a, b));
        const Pose parts = compose(inverse(b), inverse(a));
        CHECK_NEAR(distance(whole.translation, parts.translation), 0.0, 1e-13);
        CHECK_NEAR(distance(whole.rotation, parts.rotation), 0.0, kTight);
    }
}

TFDB_TEST(pose_composition_moves_points_one_after_the_other) {
    RandomPoses random("pose_composition_moves_points_one_after_the_other", 3);
    for (int i = 0; i < kRounds; ++i) {
        const Pose a = random.pose();
        const Pose b = random.pose();
        const Vec3 p = random.point(5.0);
        CHECK_NEAR(distance(apply(compose(a, b), p), apply(a, apply(b, p))), 0.0, 1e-13);
        CHECK_NEAR(distance(apply(inverse(a), apply(a, p)), p), 0.0, 1e-13);
        CHECK_NEAR(distance(rotate_inverse(a.rotation, rotate(a.rotation, p)), p), 0.0, 1e-13);
    }
}

TFDB_TEST(pose_of_known_values) {
    // A quarter turn about z maps x to y; the translation comes after the rotation.
    const double h = std::sqrt(0.5);
    const Pose turn{{1.0, 2.0, 3.0}, {0.0, 0.0, h, h}};
    CHECK_NEAR(distance(apply(turn, {5.0, 0.0, 0.0}), {1.0, 7.0, 3.0}), 0.0, 3e-15);
    const Pose twice = compose(turn, turn);
    CHECK_NEAR(distance(twice.translation, {-1.0, 3.0, 6.0}), 0.0, 2e-15);
    CHECK_NEAR(distance(twice.rotation, {0.0, 0.0, 1.0, 0.0}), 0.0, 1e-15);
    // Rotation by the full quaternion product.
    RandomPoses random("pose_of_known_values", 4);
    const Quat q = random.rotation();
    const Vec3 v = random.point(1.0);
    const Quat slow = multiply(multiply(q, {v.x, v.y, v.z, 0.0}), conjugate(q));
    CHECK_NEAR(distance(rotate(q, v), {slow.x, slow.y, slow.z}), 0.0, 1e-15);
}

TFDB_TEST(slerp_agrees_with_the_definition) {
    RandomPoses random("slerp_agrees_with_the_definition", 5);
    const double edges[] = {0.0, 1e-9, 1e-4, 0.0278, 0.0280, 0.191, 0.193, 1.0, 1.5, 1.5707};
    for (std::size_t i = 0; i + 1 < std::size(edges); ++i) {
        const double worst = worst_slerp(random, edges[i], edges[i + 1], 0.0, 1.0);
        std::printf("  slerp error, sphere angle %g to %g: %.2e\n", edges[i], edges[i + 1], worst);
        CHECK_NEAR(worst, 0.0, 1e-15);
    }
}

TFDB_TEST(slerp_goes_on_outside_the_segment) {
    RandomPoses random("slerp_goes_on_outside_the_segment", 6);
    CHECK_NEAR(worst_slerp(random, 1e-6, 0.02, -2.0, 3.0), 0.0, 2e-15);
    CHECK_NEAR(worst_slerp(random, 0.02, 1.5, -2.0, 3.0), 0.0, 2e-15);
    // The end of one segment, compared with the continuation of the other.
    for (int i = 0; i < kRounds; ++i) {
        const Quat a = random.rotation();
        const Quat b = random.apart(a, random.uniform(0.001, 0.7));
        CHECK_NEAR(distance(slerp(a, slerp(a, b, 2.0), 0.5), b), 0.0, 1e-14);
        CHECK_NEAR(distance(slerp(a, b, -1.0), slerp(b, a, 2.0)), 0.0, 2e-15);
    }
}

TFDB_TEST(slerp_takes_the_shorter_way) {
    RandomPoses random("slerp_takes_the_shorter_way", 7);
    for (int i = 0; i < kRounds; ++i) {
        const Quat a = random.rotation();
        const Quat b = random.apart(a, random.uniform(0.0, 1.57));
        const Quat minus_b{-b.x, -b.y, -b.z, -b.w};
        const double u = random.uniform(0.01, 0.99);
        CHECK_EQ(distance(slerp(a, b, u), slerp(a, minus_b, u)), 0.0);
        CHECK(dot(slerp(a, minus_b, u), a) > 0.0);
    }
    const Quat a = random.rotation();
    const Quat opposite{-a.x, -a.y, -a.z, -a.w};
    CHECK_NEAR(distance(slerp(a, opposite, 0.3), a), 0.0, 1e-15);
    CHECK_NEAR(distance(slerp(a, a, 0.3), a), 0.0, 1e-15);
    CHECK_NEAR(distance(slerp(a, a, 7.0), a), 0.0, 1e-14);
    // Half a turn: the direction is undefined, but the result is a rotation half way.
    const Quat across = random.apart(a, 90.0 * kDegree);
    const Quat half = slerp(a, across, 0.5);
    CHECK_NEAR(norm_squared(half), 1.0, 1e-15);
    CHECK_NEAR(std::fabs(dot(half, a)), std::sqrt(0.5), 1e-15);
}

TFDB_TEST(slerp_gives_unit_quaternions) {
    RandomPoses random("slerp_gives_unit_quaternions", 8);
    for (int i = 0; i < kRounds; ++i) {
        const Quat a = random.rotation();
        const Quat b = random.apart(a, random.uniform(0.0, 1.57));
        CHECK_NEAR(norm_squared(slerp(a, b, random.uniform(-1.0, 2.0))), 1.0, 1e-15);
    }
}

TFDB_TEST(interpolation_is_exact_at_the_ends_and_symmetric) {
    RandomPoses random("interpolation_is_exact_at_the_ends_and_symmetric", 9);
    for (int i = 0; i < kRounds; ++i) {
        const Pose a = random.pose();
        const Pose b = random.pose();
        CHECK_EQ(distance(interpolate(a, b, 0.0).translation, a.translation), 0.0);
        CHECK_EQ(distance(interpolate(a, b, 0.0).rotation, a.rotation), 0.0);
        CHECK_EQ(distance(interpolate(a, b, 1.0).translation, b.translation), 0.0);
        CHECK_EQ(distance(interpolate(a, b, 1.0).rotation, b.rotation), 0.0);
        const double u = i % 2 == 0 ? 0.5 : random.uniform(0.0, 1.0);
        const Pose there = interpolate(a, b, u);
        const Pose back = interpolate(b, a, 1.0 - u);
        CHECK_NEAR(distance(there.translation, back.translation), 0.0, 1e-14);
        CHECK_NEAR(rotation_distance(there.rotation, back.rotation), 0.0, 2e-15);
    }
}

}  // namespace
}  // namespace tfdb::geometry
