// Rigid transforms: a translation in metres and a unit quaternion in the order x, y, z, w.
//
// A pose T[target<-source] maps a point of `source` into `target`. All functions are pure and take
// unit quaternions (to about 1e-9; `normalized` makes one).
#pragma once

#include <cmath>
#include <type_traits>

// A lookup is a handful of these per edge. They are inlined even where GCC thinks them too large,
// and poses are written member by member: copied as blocks they would go through memory, and a wide
// load that follows narrow stores stalls.
#define TFDB_INLINE [[gnu::always_inline]] inline

namespace tfdb::geometry {

struct Vec3 {
    double x, y, z;
};

struct Quat {
    double x, y, z, w;
};

struct Pose {
    Vec3 translation;
    Quat rotation;
};

static_assert(sizeof(Pose) == 7 * sizeof(double), "x y z qx qy qz qw, without padding");
static_assert(std::is_trivially_copyable_v<Pose> && std::is_standard_layout_v<Pose>);

constexpr Pose identity() noexcept {
    return Pose{{0.0, 0.0, 0.0}, {0.0, 0.0, 0.0, 1.0}};
}

TFDB_INLINE constexpr double dot(const Quat& a, const Quat& b) noexcept {
    return (a.x * b.x + a.y * b.y) + (a.z * b.z + a.w * b.w);
}

TFDB_INLINE constexpr double norm_squared(const Quat& q) noexcept {
    return dot(q, q);
}

TFDB_INLINE constexpr Quat conjugate(const Quat& q) noexcept {
    return Quat{-q.x, -q.y, -q.z, q.w};
}

/// Any quaternion but zero, scaled to length one.
inline Quat normalized(const Quat& q) noexcept {
    const double scale = 1.0 / std::sqrt(norm_squared(q));
    return Quat{q.x * scale, q.y * scale, q.z * scale, q.w * scale};
}

/// The rotation b first, then a.
TFDB_INLINE constexpr Quat multiply(const Quat& a, const Quat& b) noexcept {
    return Quat{(a.w * b.x + a.x * b.w) + (a.y * b.z - a.z * b.y),
                (a.w * b.y + a.y * b.w) + (a.z * b.x - a.x * b.z),
                (a.w * b.z + a.z * b.w) + (a.x * b.y - a.y * b.x),
                (a.w * b.w - a.x * b.x) - (a.y * b.y + a.z * b.z)};
}

/// q v q*, as v + 2 w (r x v) + 2 r x (r x v) with r the vector part.
TFDB_INLINE constexpr Vec3 rotate(const Quat& q, const Vec3& v) noexcept {
    const double cx = 2.0 * (q.y * v.z - q.z * v.y);
    const double cy = 2.0 * (q.z * v.x - q.x * v.z);
    const double cz = 2.0 * (q.x * v.y - q.y * v.x);
    return Vec3{(v.x + q.w * cx) + (q.y * cz - q.z * cy), (v.y + q.w * cy) + (q.z * cx - q.x * cz),
                (v.z + q.w * cz) + (q.x * cy - q.y * cx)};
}

constexpr Vec3 rotate_inverse(const Quat& q, const Vec3& v) noexcept {
    return rotate(conjugate(q), v);
}

/// The point p of the source frame, in the target frame.
TFDB_INLINE constexpr Vec3 apply(const Pose& pose, const Vec3& p) noexcept {
    const Vec3 turned = rotate(pose.rotation, p);
    return Vec3{pose.translation.x + turned.x, pose.translation.y + turned.y,
                pose.translation.z + turned.z};
}

/// T[c<-a] from T[c<-b] and T[b<-a].
TFDB_INLINE constexpr Pose compose(const Pose& c_from_b, const Pose& b_from_a) noexcept {
    return Pose{apply(c_from_b, b_from_a.translation),
                multiply(c_from_b.rotation, b_from_a.rotation)};
}

/// to = from, member by member.
TFDB_INLINE constexpr void assign(Pose& to, const Pose& from) noexcept {
    to.translation.x = from.translation.x;
    to.translation.y = from.translation.y;
    to.translation.z = from.translation.z;
    to.rotation.x = from.rotation.x;
    to.rotation.y = from.rotation.y;
    to.rotation.z = from.rotation.z;
    to.rotation.w = from.rotation.w;
}

/// T[a<-b] from T[b<-a].
TFDB_INLINE constexpr Pose inverse(const Pose& pose) noexcept {
    const Quat back = conjugate(pose.rotation);
    const Vec3 turned = rotate(back, pose.translation);
    return Pose{{-turned.x, -turned.y, -turned.z}, back};
}

// Slerp without trigonometry. Put f_u(x) = sin(u th) / sin(th) with x = cos(th) - 1. It solves the
// Gegenbauer equation (1 - c^2) f'' - 3 c f' + (u^2 - 1) f = 0 in c = cos(th), regular at c = 1,
// where f = u (sin(u th)/sin(th) is the Chebyshev function U_{u-1}; Abramowitz and Stegun 22.6.5
// and 15.4). Its power series there is the hypergeometric one, u 2F1(1 - u, 1 + u; 3/2; -x / 2):
//
//     f_u(x) = u * sum_i x^i * prod_{j=1..i} (u^2 - j^2) / (j (2 j + 1)).
//
// For 0 <= u <= 1 the terms fall like (x / 2)^i, so a few of them are exact to the last bits of a
// double; D. Eberly, "A fast and accurate algorithm for computing slerp", JGT 15 (2011), uses the
// same expansion.
namespace slerp_series {

// 1 - cos(th) below which 4 and 8 terms leave less than 3e-16: th < 1.6 and th < 11 degrees.
inline constexpr double kShortLimit = 3.9e-4;
inline constexpr double kLongLimit = 0.0184;

/// f_u(x) / u with `Terms` terms, in Horner's form; `squared` is u^2, or two of them side by side.
template <int Terms, class Number>
TFDB_INLINE constexpr Number sum(double x, Number squared) noexcept {
    const auto factor = [&](int j) {
        const double scale = 1.0 / (j * (2 * j + 1));
        const double shift = static_cast<double>(j) / (2 * j + 1);
        return x * (squared * scale - shift);
    };
    Number value = 1.0 + factor(Terms - 1);
    for (int j = Terms - 2; j >= 1; --j) {
        value = 1.0 + value * factor(j);
    }
    return value;
}

}  // namespace slerp_series

namespace detail {

/// Two numbers side by side, computed at once.
using TwoDoubles [[gnu::vector_size(16)]] = double;

TFDB_INLINE constexpr Quat mix(const Quat& a, double of_a, const Quat& b, double of_b) noexcept {
    return Quat{of_a * a.x + of_b * b.x, of_a * a.y + of_b * b.y, of_a * a.z + of_b * b.z,
                of_a * a.w + of_b * b.w};
}

/// Slerp by libm: for wide angles and for u outside [0, 1]. `sign` picks the nearer of b and -b.
[[gnu::noinline]] inline Quat wide_slerp(Quat a, Quat b, double sign, double u) noexcept {
    // Half the angle from |a - b| and |a + b|: as good near 0 as near 180 degrees, unlike acos.
    const double apart = norm_squared(mix(a, 1.0, b, -sign));
    const double along = norm_squared(mix(a, 1.0, b, sign));
    const double angle = 2.0 * std::atan2(std::sqrt(apart), std::sqrt(along));
    const double sine = std::sin(angle);
    if (sine == 0.0) {
        return a;
    }
    const double of_a = std::sin((1.0 - u) * angle) / sine;
    const double of_b = std::sin(u * angle) / sine;
    return normalized(mix(a, of_a, b, of_b * sign));
}

}  // namespace detail

/// From a (u = 0) to b (u = 1) at constant angular speed along the shorter way; u outside [0, 1]
/// goes on at the same speed. a and b are exact at the ends; elsewhere the norm is 1 to an ulp.
TFDB_INLINE Quat slerp(const Quat& a, const Quat& b, double u) noexcept {
    if (u == 0.0) {
        return a;
    }
    if (u == 1.0) {
        return b;
    }
    const double cosine = dot(a, b);
    const double sign = cosine < 0.0 ? -1.0 : 1.0;
    const double x = std::fabs(cosine) - 1.0;
    const double v = 1.0 - u;
    double of_a = 0.0;
    double of_b = 0.0;
    const bool inside = u > 0.0 && u < 1.0;
    if (inside && x > -slerp_series::kShortLimit) {
        of_a = v * slerp_series::sum<4>(x, v * v);
        of_b = u * slerp_series::sum<4>(x, u * u);
    } else if (inside && x > -slerp_series::kLongLimit) {
        of_a = v * slerp_series::sum<8>(x, v * v);
        of_b = u * slerp_series::sum<8>(x, u * u);
    } else {
        return detail::wide_slerp(a, b, sign, u);
    }
    const Quat mixed = detail::mix(a, of_a, b, of_b * sign);
    // One Newton step towards 1 / sqrt(norm^2): all that a norm so near to one needs.
    const double scale = 1.5 - 0.5 * norm_squared(mixed);
    return Quat{mixed.x * scale, mixed.y * scale, mixed.z * scale, mixed.w * scale};
}

namespace detail {

[[gnu::noinline]] inline Quat slerp_called(const Quat& a, const Quat& b, double u) noexcept {
    return slerp(a, b, u);
}

}  // namespace detail

/// As `slerp`, for 0 < u < 1 and in fewer instructions: both weights are summed side by side, and
/// the norm is left as it comes, 1 to a few ulps.
TFDB_INLINE Quat slerp_between(const Quat& a, const Quat& b, double u) noexcept {
    const double cosine = dot(a, b);
    const double x = std::fabs(cosine) - 1.0;
    if (x > -slerp_series::kShortLimit) [[likely]] {
        const detail::TwoDoubles shares{1.0 - u, u};
        const detail::TwoDoubles weights = shares * slerp_series::sum<4>(x, shares * shares);
        return detail::mix(a, weights[0], b, std::copysign(weights[1], cosine));
    }
    // Copies made here: the address of an argument would keep it in memory on the way above too.
    return detail::slerp_called(Quat{a.x, a.y, a.z, a.w}, Quat{b.x, b.y, b.z, b.w}, u);
}

/// As `interpolate`, for 0 < u < 1.
TFDB_INLINE Pose between(const Pose& a, const Pose& b, double u) noexcept {
    const Vec3& p = a.translation;
    const Vec3& q = b.translation;
    return Pose{{p.x + u * (q.x - p.x), p.y + u * (q.y - p.y), p.z + u * (q.z - p.z)},
                slerp_between(a.rotation, b.rotation, u)};
}

/// Linear in the translation, slerp in the rotation. a and b are exact at u = 0 and u = 1.
TFDB_INLINE Pose interpolate(const Pose& a, const Pose& b, double u) noexcept {
    if (u == 1.0) {
        return b;
    }
    const Vec3& p = a.translation;
    const Vec3& q = b.translation;
    return Pose{{p.x + u * (q.x - p.x), p.y + u * (q.y - p.y), p.z + u * (q.z - p.z)},
                slerp(a.rotation, b.rotation, u)};
}

}  // namespace tfdb::geometry
