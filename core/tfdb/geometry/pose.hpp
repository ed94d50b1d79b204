// Rigid transforms: a translation in metres and a unit quaternion in the order x, y, z, w.
//
// A pose T[target<-source] maps a point of `source` into `target`. All functions are pure and take
// unit quaternions (to about 1e-9; `normalized` makes one).
//
// The arithmetic of a lookup is written once, for any number type: a double, or several side by
// side (lanes.hpp). The same operations in the same order give the same bits in each type, if the
// compiler never fuses a product and a sum into one rounding: -ffp-contract=off.
#pragma once

#include <cmath>
#include <type_traits>

// A lookup calls a handful of these functions per edge. They are inlined even if GCC thinks them
// too large. Poses are written member by member: a block copy would go through memory, and a wide
// load after narrow stores stalls. Inlining also keeps code for one instruction set in the file
// that was compiled for it.
#define TFDB_INLINE [[gnu::always_inline]] inline

namespace tfdb::geometry {

/// The arithmetic on a number type besides + - * /.
template <class Number>
struct Arithmetic;

template <>
struct Arithmetic<double> {
    using Mask = bool;
    TFDB_INLINE static constexpr double fill(double value) { return value; }
    TFDB_INLINE static constexpr bool any(bool mask) { return mask; }
    TFDB_INLINE static constexpr double choose(bool mask, double yes, double no) {
        return mask ? yes : no;
    }
    TFDB_INLINE static double root(double a) { return std::sqrt(a); }
};

template <class Number>
struct Vec3Of {
    Number x, y, z;
};

template <class Number>
struct QuatOf {
    Number x, y, z, w;
};

template <class Number>
struct PoseOf {
    Vec3Of<Number> translation;
    QuatOf<Number> rotation;
};

using Vec3 = Vec3Of<double>;
using Quat = QuatOf<double>;
using Pose = PoseOf<double>;

static_assert(sizeof(Pose) == 7 * sizeof(double), "x y z qx qy qz qw, without padding");
static_assert(std::is_trivially_copyable_v<Pose> && std::is_standard_layout_v<Pose>);

/// Type of a second argument: only the first one decides the number type.
template <class Type>
using Same = std::type_identity_t<Type>;

constexpr Pose identity() noexcept {
    return Pose{{0.0, 0.0, 0.0}, {0.0, 0.0, 0.0, 1.0}};
}

template <class Number>
TFDB_INLINE constexpr Number dot(const QuatOf<Number>& a, const Same<QuatOf<Number>>& b) noexcept {
    return (a.x * b.x + a.y * b.y) + (a.z * b.z + a.w * b.w);
}

template <class Number>
TFDB_INLINE constexpr Number norm_squared(const QuatOf<Number>& q) noexcept {
    return dot(q, q);
}

template <class Number>
TFDB_INLINE constexpr QuatOf<Number> conjugate(const QuatOf<Number>& q) noexcept {
    return {-q.x, -q.y, -q.z, q.w};
}

template <class Number>
TFDB_INLINE constexpr QuatOf<Number> scaled(const QuatOf<Number>& q, Number by) noexcept {
    return {q.x * by, q.y * by, q.z * by, q.w * by};
}

/// Any nonzero quaternion, scaled to length one.
inline Quat normalized(const Quat& q) noexcept {
    return scaled(q, 1.0 / std::sqrt(norm_squared(q)));
}

/// First rotation b, then a.
template <class Number>
TFDB_INLINE constexpr QuatOf<Number> multiply(const QuatOf<Number>& a,
                                              const Same<QuatOf<Number>>& b) noexcept {
    return {(a.w * b.x + a.x * b.w) + (a.y * b.z - a.z * b.y),
            (a.w * b.y + a.y * b.w) + (a.z * b.x - a.x * b.z),
            (a.w * b.z + a.z * b.w) + (a.x * b.y - a.y * b.x),
            (a.w * b.w - a.x * b.x) - (a.y * b.y + a.z * b.z)};
}

/// q v q*, as v + 2 w (r x v) + 2 r x (r x v), with r the vector part.
template <class Number>
TFDB_INLINE constexpr Vec3Of<Number> rotate(const QuatOf<Number>& q,
                                            const Same<Vec3Of<Number>>& v) noexcept {
    const Number cx = 2.0 * (q.y * v.z - q.z * v.y);
    const Number cy = 2.0 * (q.z * v.x - q.x * v.z);
    const Number cz = 2.0 * (q.x * v.y - q.y * v.x);
    return {(v.x + q.w * cx) + (q.y * cz - q.z * cy), (v.y + q.w * cy) + (q.z * cx - q.x * cz),
            (v.z + q.w * cz) + (q.x * cy - q.y * cx)};
}

template <class Number>
TFDB_INLINE constexpr Vec3Of<Number> rotate_inverse(const QuatOf<Number>& q,
                                                    const Same<Vec3Of<Number>>& v) noexcept {
    return rotate(conjugate(q), v);
}

/// The point p of the source frame, expressed in the target frame.
template <class Number>
TFDB_INLINE constexpr Vec3Of<Number> apply(const PoseOf<Number>& pose,
                                           const Same<Vec3Of<Number>>& p) noexcept {
    const Vec3Of<Number> turned = rotate(pose.rotation, p);
    return {pose.translation.x + turned.x, pose.translation.y + turned.y,
            pose.translation.z + turned.z};
}

/// T[c<-a] from T[c<-b] and T[b<-a].
template <class Number>
TFDB_INLINE constexpr PoseOf<Number> compose(const PoseOf<Number>& c_from_b,
                                             const Same<PoseOf<Number>>& b_from_a) noexcept {
    return {apply(c_from_b, b_from_a.translation), multiply(c_from_b.rotation, b_from_a.rotation)};
}

/// to = from, member by member.
template <class Number>
TFDB_INLINE constexpr void assign(PoseOf<Number>& to, const Same<PoseOf<Number>>& from) noexcept {
    to.translation.x = from.translation.x;
    to.translation.y = from.translation.y;
    to.translation.z = from.translation.z;
    to.rotation.x = from.rotation.x;
    to.rotation.y = from.rotation.y;
    to.rotation.z = from.rotation.z;
    to.rotation.w = from.rotation.w;
}

/// T[a<-b] from T[b<-a].
template <class Number>
TFDB_INLINE constexpr PoseOf<Number> inverse(const PoseOf<Number>& pose) noexcept {
    const QuatOf<Number> back = conjugate(pose.rotation);
    const Vec3Of<Number> turned = rotate(back, pose.translation);
    return {{-turned.x, -turned.y, -turned.z}, back};
}

/// The rotation as a row-major matrix.
template <class Number>
struct MatrixOf {
    Number m[9];
};

template <class Number>
TFDB_INLINE constexpr MatrixOf<Number> matrix(const QuatOf<Number>& q) noexcept {
    const Number x2 = q.x + q.x;
    const Number y2 = q.y + q.y;
    const Number z2 = q.z + q.z;
    return {{1.0 - (q.y * y2 + q.z * z2), q.x * y2 - q.w * z2, q.x * z2 + q.w * y2,
             q.x * y2 + q.w * z2, 1.0 - (q.x * x2 + q.z * z2), q.y * z2 - q.w * x2,
             q.x * z2 - q.w * y2, q.y * z2 + q.w * x2, 1.0 - (q.x * x2 + q.y * y2)}};
}

/// Whether all numbers are finite, for a rotation of length about one.
TFDB_INLINE constexpr bool is_finite(const Pose& pose) noexcept {
    const Vec3& t = pose.translation;
    // Zero times infinity or NaN is NaN.
    return 0.0 * t.x + 0.0 * t.y + 0.0 * t.z == 0.0;
}

}  // namespace tfdb::geometry
