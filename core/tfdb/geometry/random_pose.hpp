// Random poses and trajectories for tests, away from the identity.
#pragma once

#include <cmath>
#include <cstdio>
#include <random>
#include <vector>

#include "tfdb/clock/stamp.hpp"
#include "tfdb/geometry/pose.hpp"

namespace tfdb::geometry::testing {

using clock::StampNs;

/// One random source per test. It prints its seed so that a failure can be repeated.
/// Threads: one. Guarantee: the same numbers for the same seed on one standard library.
class RandomPoses {
public:
    RandomPoses(const char* test, unsigned seed) : engine_(seed) {
        std::printf("%s: seed %u\n", test, seed);
    }

    double normal() { return normal_(engine_); }
    double uniform(double low, double high) {
        return std::uniform_real_distribution<double>(low, high)(engine_);
    }
    StampNs stamp(StampNs low, StampNs high) {
        return std::uniform_int_distribution<StampNs>(low, high)(engine_);
    }
    Vec3 point(double scale) { return {scale * normal(), scale * normal(), scale * normal()}; }
    Quat rotation() { return normalized({normal(), normal(), normal(), normal()}); }
    Pose pose(double scale = 3.0) { return {point(scale), rotation()}; }

    /// A quaternion at exactly this angle from q, on the four-dimensional sphere.
    Quat apart(const Quat& q, double angle) {
        const Quat r = rotation();
        const double along = dot(q, r);
        const Quat side = normalized(
            {r.x - along * q.x, r.y - along * q.y, r.z - along * q.z, r.w - along * q.w});
        const double c = std::cos(angle);
        const double s = std::sin(angle);
        return normalized({c * q.x + s * side.x, c * q.y + s * side.y, c * q.z + s * side.z,
                           c * q.w + s * side.w});
    }

    std::mt19937_64& engine() { return engine_; }

private:
    std::mt19937_64 engine_;
    std::normal_distribution<double> normal_;
};

inline double distance(const Vec3& a, const Vec3& b) {
    return std::hypot(a.x - b.x, a.y - b.y, a.z - b.z);
}

/// Greatest difference of two components; q and -q differ here.
inline double distance(const Quat& a, const Quat& b) {
    return std::fmax(std::fmax(std::fabs(a.x - b.x), std::fabs(a.y - b.y)),
                     std::fmax(std::fabs(a.z - b.z), std::fabs(a.w - b.w)));
}

/// The same for rotations: q and -q are equal.
inline double rotation_distance(const Quat& a, const Quat& b) {
    return std::fmin(distance(a, b), distance(a, {-b.x, -b.y, -b.z, -b.w}));
}

}  // namespace tfdb::geometry::testing
