// Other notations of a rotation: matrix; roll, pitch and yaw.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <span>

#include "tfdb/geometry/pose.hpp"

namespace tfdb::geometry {

/// Tolerance for the axes of a 4x4 matrix, which is often printed with few digits. It equals the
/// tolerance for a quaternion's length.
inline constexpr double kRigidTolerance = 5e-3;

/// Tolerance for the last row, which holds no measured number: the small translation of a
/// transposed matrix does not pass as rounding.
inline constexpr double kLastRowTolerance = 1e-6;

/// The violation that keeps a 4x4 matrix from being a rigid transform, and its amount.
struct RigidFault {
    enum Kind : unsigned char { kNone, kNotFinite, kLastRow, kReflection, kScale, kShear };
    Kind kind = kNone;
    double amount = 0.0;
};

namespace detail {

using Rows = std::span<const double, 16>;

inline double product(Rows m, std::size_t a, std::size_t b) noexcept {
    return m[a] * m[b] + m[4 + a] * m[4 + b] + m[8 + a] * m[8 + b];
}

inline double determinant(Rows m) noexcept {
    return m[0] * (m[5] * m[10] - m[6] * m[9]) - m[1] * (m[4] * m[10] - m[6] * m[8]) +
           m[2] * (m[4] * m[9] - m[5] * m[8]);
}

}  // namespace detail

/// Checks a row-major matrix. The amount is: for the last row, its distance from 0 0 0 1; for a
/// reflection, the determinant; for a scale, the factor; for a shear, the largest sine between two
/// axes, or the difference of two axes' lengths.
inline RigidFault rigid_fault(std::span<const double, 16> m) noexcept {
    for (const double value : m) {
        if (!std::isfinite(value)) {
            return {RigidFault::kNotFinite, value};
        }
    }
    const double row =
        std::max({std::abs(m[12]), std::abs(m[13]), std::abs(m[14]), std::abs(m[15] - 1.0)});
    if (row > kLastRowTolerance) {
        return {RigidFault::kLastRow, row};
    }
    const double determinant = detail::determinant(m);
    if (determinant <= 0.0) {
        return {RigidFault::kReflection, determinant};
    }
    const double scale = std::cbrt(determinant);
    const auto length = [&](std::size_t axis) { return std::sqrt(detail::product(m, axis, axis)); };
    const std::array lengths = {length(0), length(1), length(2)};
    const auto sine = [&](std::size_t a, std::size_t b) {
        return std::abs(detail::product(m, a, b)) / (lengths[a] * lengths[b]);
    };
    const auto [least, most] = std::minmax_element(lengths.begin(), lengths.end());
    const double shear = std::max({sine(0, 1), sine(0, 2), sine(1, 2), (*most - *least) / scale});
    if (!(shear <= kRigidTolerance)) {
        return {RigidFault::kShear, shear};
    }
    if (!(std::abs(scale - 1.0) <= kRigidTolerance)) {
        return {RigidFault::kScale, scale};
    }
    return {};
}

/// The rotation nearest to a rigid matrix's, least squares: its orthogonal polar factor, by
/// Newton's method (Higham, Computing the polar decomposition, 1986). Each step squares the error:
/// three steps lead from the tolerance to rounding.
inline std::array<double, 9> nearest_rotation(std::span<const double, 16> m) noexcept {
    std::array r = {m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]};
    for (int step = 0; step < 3; ++step) {
        const std::array cofactors = {
            r[4] * r[8] - r[5] * r[7], r[5] * r[6] - r[3] * r[8], r[3] * r[7] - r[4] * r[6],
            r[2] * r[7] - r[1] * r[8], r[0] * r[8] - r[2] * r[6], r[1] * r[6] - r[0] * r[7],
            r[1] * r[5] - r[2] * r[4], r[2] * r[3] - r[0] * r[5], r[0] * r[4] - r[1] * r[3]};
        const double determinant = r[0] * cofactors[0] + r[1] * cofactors[1] + r[2] * cofactors[2];
        for (std::size_t i = 0; i < r.size(); ++i) {
            r[i] = 0.5 * (r[i] + cofactors[i] / determinant);
        }
    }
    return r;
}

/// The pose of a rigid row-major matrix, with w >= 0. It computes the largest of the four parts
/// first (Shepperd, Quaternion from rotation matrix, 1978), which avoids cancellation.
inline Pose pose_of_matrix(std::span<const double, 16> m) noexcept {
    const std::array r = nearest_rotation(m);
    const double trace = r[0] + r[4] + r[8];
    Quat q{};
    if (trace >= std::max({r[0], r[4], r[8]})) {
        q = {r[7] - r[5], r[2] - r[6], r[3] - r[1], 1.0 + trace};
    } else if (r[0] >= std::max(r[4], r[8])) {
        q = {1.0 + r[0] - r[4] - r[8], r[1] + r[3], r[2] + r[6], r[7] - r[5]};
    } else if (r[4] >= r[8]) {
        q = {r[1] + r[3], 1.0 - r[0] + r[4] - r[8], r[5] + r[7], r[2] - r[6]};
    } else {
        q = {r[2] + r[6], r[5] + r[7], 1.0 - r[0] - r[4] + r[8], r[3] - r[1]};
    }
    if (q.w < 0.0) {
        q = {-q.x, -q.y, -q.z, -q.w};
    }
    return {{m[3], m[7], m[11]}, normalized(q)};
}

/// Rotates by roll about x, then pitch about y, then yaw about z, about fixed axes: Rz(yaw)
/// Ry(pitch) Rx(roll), as in URDF. Radians.
inline Quat quaternion_of_rpy(const Vec3& rpy) noexcept {
    const double cr = std::cos(rpy.x / 2);
    const double sr = std::sin(rpy.x / 2);
    const double cp = std::cos(rpy.y / 2);
    const double sp = std::sin(rpy.y / 2);
    const double cy = std::cos(rpy.z / 2);
    const double sy = std::sin(rpy.z / 2);
    return {sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy, cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy};
}

/// The inverse of quaternion_of_rpy. At a pitch of 90 degrees roll and yaw share one axis; roll is
/// then 0.
inline Vec3 rpy_of_quaternion(const Quat& q) noexcept {
    const auto& [m] = matrix(q);
    const double across = std::hypot(m[0], m[3]);
    const double pitch = std::atan2(0.0 - m[6], across);  // 0, never -0, for a pitch of zero
    constexpr double kLocked = 1e-9;
    if (across < kLocked) {
        return {0.0, pitch, std::atan2(0.0 - m[1], m[4])};
    }
    return {std::atan2(m[7], m[8]), pitch, std::atan2(m[3], m[0])};
}

}  // namespace tfdb::geometry
