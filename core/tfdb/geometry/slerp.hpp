// Interpolation between two poses: linear in the translation, slerp in the rotation. For any number
// type of pose.hpp, so that a single lookup and a batch give the same bits.
//
// Slerp without trigonometry. Put f_u(x) = sin(u th) / sin(th) with x = cos(th) - 1. It solves the
// Gegenbauer equation (1 - c^2) f'' - 3 c f' + (u^2 - 1) f = 0 in c = cos(th), regular at c = 1,
// where f = u (sin(u th)/sin(th) is the Chebyshev function U_{u-1}; Abramowitz and Stegun 22.6.5
// and 15.4). Its power series there is the hypergeometric one, u 2F1(1 - u, 1 + u; 3/2; -x / 2):
//
//     f_u(x) = u * sum_i x^i * prod_{j=1..i} (u^2 - j^2) / (j (2 j + 1)).
//
// For 0 <= u <= 1 the terms fall like (x / 2)^i, so a few of them are exact to the last bits of a
// double; D. Eberly, "A fast and accurate algorithm for computing slerp", JGT 15 (2011), uses the
// same expansion. An angle of more than 11 degrees is halved first: 19 terms then suffice for any
// angle.
#pragma once

#include <cstdint>

#include "tfdb/geometry/pose.hpp"

namespace tfdb::geometry {

/// The position of `stamp` between `a` and `b`: 0 at `a`, 1 at `b`.
TFDB_INLINE constexpr double share(std::int64_t a, std::int64_t b, std::int64_t stamp) noexcept {
    return static_cast<double>(stamp - a) / static_cast<double>(b - a);
}

namespace slerp_series {

// 1 - cos(th) below which 4 and 8 terms leave less than 3e-16: th < 1.6 and th < 11 degrees.
inline constexpr double kShortLimit = 3.9e-4;
inline constexpr double kLongLimit = 0.0184;
inline constexpr int kShort = 4;
inline constexpr int kLong = 8;
// Half of any angle: th < 45 degrees,
// x
// < 0.293. These terms leave less than 1e-16.
inline constexpr int kHalved = 19;

/// f_u(x) / u with `Terms` terms, in Horner's form; `squared` is u^2, or several of them. The parts
/// that depend on x alone are separate: they are equal for all stamps between two samples.
template <int Terms, class X, class Number>
TFDB_INLINE constexpr Number sum(X x, Number squared) noexcept {
    const auto factor = [&](int j) {
        const double scale = 1.0 / (j * (2 * j + 1));
        const double shift = static_cast<double>(j) / (2 * j + 1);
        return squared * (x * scale) - x * shift;
    };
    Number value = 1.0 + factor(Terms - 1);
#pragma GCC unroll 32
    for (int j = Terms - 2; j >= 1; --j) {
        value = 1.0 + value * factor(j);
    }
    return value;
}

}  // namespace slerp_series

namespace detail {

/// Two numbers side by side, computed at once.
using TwoDoubles [[gnu::vector_size(16)]] = double;

template <class Number>
struct Weights {
    Number of_a, of_b;
};

template <int Terms, class Number>
TFDB_INLINE constexpr Weights<Number> weights(Number x, Number u) noexcept {
    if constexpr (std::is_same_v<Number, double>) {
        const TwoDoubles ways{1.0 - u, u};
        const TwoDoubles both = ways * slerp_series::sum<Terms>(x, ways * ways);
        return {both[0], both[1]};
    } else {
        const Number v = 1.0 - u;
        return {v * slerp_series::sum<Terms>(x, v * v), u * slerp_series::sum<Terms>(x, u * u)};
    }
}

template <class Number>
TFDB_INLINE constexpr QuatOf<Number> mix(const QuatOf<Number>& a, Number of_a,
                                         const QuatOf<Number>& b, Number of_b) noexcept {
    return {of_a * a.x + of_b * b.x, of_a * a.y + of_b * b.y, of_a * a.z + of_b * b.z,
            of_a * a.w + of_b * b.w};
}

template <int Terms, class Number>
TFDB_INLINE constexpr QuatOf<Number> mix_by_series(const QuatOf<Number>& a, const QuatOf<Number>& b,
                                                   Number x, Number sign, Number u) noexcept {
    const Weights<Number> weight = weights<Terms>(x, u);
    return mix(a, weight.of_a, b, weight.of_b * sign);
}

/// One Newton step towards 1 / sqrt(norm^2): enough for a norm so near to one.
template <class Number>
TFDB_INLINE constexpr QuatOf<Number> straightened(const QuatOf<Number>& q) noexcept {
    return scaled(q, 1.5 - 0.5 * norm_squared(q));
}

template <class Number, class Mask>
TFDB_INLINE constexpr QuatOf<Number> choose(Mask mask, const QuatOf<Number>& yes,
                                            const QuatOf<Number>& no) noexcept {
    using A = Arithmetic<Number>;
    return {A::choose(mask, yes.x, no.x), A::choose(mask, yes.y, no.y),
            A::choose(mask, yes.z, no.z), A::choose(mask, yes.w, no.w)};
}

template <class Number, class Mask>
TFDB_INLINE constexpr PoseOf<Number> choose(Mask mask, const PoseOf<Number>& yes,
                                            const PoseOf<Number>& no) noexcept {
    using A = Arithmetic<Number>;
    const Vec3Of<Number>& t = yes.translation;
    const Vec3Of<Number>& f = no.translation;
    return {{A::choose(mask, t.x, f.x), A::choose(mask, t.y, f.y), A::choose(mask, t.z, f.z)},
            choose(mask, yes.rotation, no.rotation)};
}

/// For any angle: interpolates in the half of the arc that contains u.
template <class Number>
TFDB_INLINE QuatOf<Number> slerp_halved(const QuatOf<Number>& a, const QuatOf<Number>& b,
                                        Number sign, Number u) noexcept {
    using A = Arithmetic<Number>;
    const QuatOf<Number> end = scaled(b, sign);
    const QuatOf<Number> sum{a.x + end.x, a.y + end.y, a.z + end.z, a.w + end.w};
    const Number length = A::root(norm_squared(sum));  // twice the cosine of half the angle
    const QuatOf<Number> middle = scaled(sum, 1.0 / length);
    const auto late = u >= A::fill(0.5);
    const Number twice = u + u;
    return straightened(mix_by_series<slerp_series::kHalved>(
        choose(late, middle, a), choose(late, end, middle), 0.5 * length - 1.0, A::fill(1.0),
        A::choose(late, twice - 1.0, twice)));
}

/// If some angle is too wide for the short series: each number takes its own series.
template <class Number>
TFDB_INLINE QuatOf<Number> slerp_far(const QuatOf<Number>& a, const QuatOf<Number>& b, Number x,
                                     Number sign, Number u) noexcept {
    using namespace slerp_series;
    using A = Arithmetic<Number>;
    const Number short_limit = A::fill(-kShortLimit);
    const Number long_limit = A::fill(-kLongLimit);
    QuatOf<Number> result{};
    if (A::any(x < long_limit)) {
        result = slerp_halved(a, b, sign, u);
    }
    const auto narrow = x >= long_limit;
    if (A::any(narrow)) {
        result = choose(narrow, straightened(mix_by_series<kLong>(a, b, x, sign, u)), result);
    }
    const auto near = x > short_limit;
    if (A::any(near)) {
        result = choose(near, mix_by_series<kShort>(a, b, x, sign, u), result);
    }
    return result;
}

/// For u outside [0, 1], by libm.
inline Quat slerp_outside(const Quat& a, const Quat& b, double sign, double u) noexcept {
    // Half the angle from
    // a - b
    // and
    // a + b
    // : accurate near 0 and near 180 degrees, unlike acos.
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

/// The rare cases of a double, kept out of the common one.
[[gnu::noinline]] inline Quat slerp_rare(Quat a, Quat b, double x, double sign, double u) noexcept {
    const bool inside = u >= 0.0 && u <= 1.0;
    return inside ? slerp_far(a, b, x, sign, u) : slerp_outside(a, b, sign, u);
}

}  // namespace detail

/// The distance of two unit quaternions: the part of a slerp that does not depend on u.
template <class Number>
struct Apart {
    Number x;     // cosine of the angle between a and the nearer of b and -b, minus one
    Number sign;  // 1 if b is the nearer one, otherwise -1
};

template <class Number>
TFDB_INLINE Apart<Number> apart(const QuatOf<Number>& a, const Same<QuatOf<Number>>& b) noexcept {
    using A = Arithmetic<Number>;
    const Number cosine = dot(a, b);
    const Number sign = A::choose(cosine < A::fill(0.0), A::fill(-1.0), A::fill(1.0));
    return {cosine * sign - 1.0, sign};
}

/// From a (u = 0) towards b (u = 1) at constant angular speed, along the shorter arc. If both arcs
/// are equally long, it ends at b and not at -b. The norm is 1 to a few units of the last place. A
/// double u may lie outside [0, 1]: the rotation continues at the same speed.
template <class Number>
TFDB_INLINE QuatOf<Number> slerp(const QuatOf<Number>& a, const Same<QuatOf<Number>>& b,
                                 const Apart<Number>& way, Number u) noexcept {
    using A = Arithmetic<Number>;
    const auto far = way.x <= A::fill(-slerp_series::kShortLimit);
    if constexpr (std::is_same_v<Number, double>) {
        if (far || u < 0.0 || u > 1.0) [[unlikely]] {
            // Copies: the address of an argument would keep it in memory on the common path below.
            return detail::slerp_rare(Quat{a.x, a.y, a.z, a.w}, Quat{b.x, b.y, b.z, b.w}, way.x,
                                      way.sign, u);
        }
    } else if (A::any(far)) {
        return detail::slerp_far(a, b, way.x, way.sign, u);
    }
    return detail::mix_by_series<slerp_series::kShort>(a, b, way.x, way.sign, u);
}

template <class Number>
TFDB_INLINE QuatOf<Number> slerp(const QuatOf<Number>& a, const Same<QuatOf<Number>>& b,
                                 Number u) noexcept {
    return slerp(a, b, apart(a, b), u);
}

/// Linear in the translation, slerp in the rotation. Exactly a and b at u = 0 and u = 1.
template <class Number>
TFDB_INLINE PoseOf<Number> interpolate(const PoseOf<Number>& a, const Same<PoseOf<Number>>& b,
                                       Number u) noexcept {
    using A = Arithmetic<Number>;
    const Vec3Of<Number>& p = a.translation;
    const Vec3Of<Number>& q = b.translation;
    PoseOf<Number> pose{{p.x + u * (q.x - p.x), p.y + u * (q.y - p.y), p.z + u * (q.z - p.z)},
                        slerp(a.rotation, b.rotation, u)};
    const auto at_a = u == A::fill(0.0);
    const auto at_b = u == A::fill(1.0);
    if (A::any(at_a | at_b)) [[unlikely]] {
        pose = detail::choose(at_b, b, detail::choose(at_a, a, pose));
    }
    return pose;
}

}  // namespace tfdb::geometry
