// The kernels of batch_kernels.hpp for any number of lanes. Included by one file per instruction
// set; everything is in an unnamed namespace and calls no inline function of another header, so
// that code for AVX2 stays in its file.
#pragma once

#include "tfdb/geometry/batch_kernels.hpp"
#include "tfdb/geometry/lanes.hpp"

namespace tfdb::geometry {
namespace {

template <int L>
using Real = typename Lanes<L>::Real;
template <int L>
using Word = typename Lanes<L>::Word;
template <int L>
using Mask = typename Lanes<L>::Mask;

template <class Vector>
TFDB_LANES_INLINE Vector load(const void* from) {
    Vector value;
    __builtin_memcpy(&value, from, sizeof value);
    return value;
}

template <class Vector>
TFDB_LANES_INLINE void store(void* to, Vector value) {
    __builtin_memcpy(to, &value, sizeof value);
}

template <class To, class From>
TFDB_LANES_INLINE To bits_as(From value) {
    static_assert(sizeof(To) == sizeof(From));
    To result;
    __builtin_memcpy(&result, &value, sizeof result);
    return result;
}

template <int L>
TFDB_LANES_INLINE Real<L> choose(Mask<L> mask, Real<L> yes, Real<L> no) {
    return bits_as<Real<L>>((mask & bits_as<Mask<L>>(yes)) | (~mask & bits_as<Mask<L>>(no)));
}

template <int L>
struct QuatLanes {
    Real<L> x, y, z, w;
};

template <int L>
struct PoseLanes {
    Real<L> x, y, z;
    QuatLanes<L> q;
};

template <int L>
TFDB_LANES_INLINE PoseLanes<L> load_poses(const PoseBlock& block, std::size_t i) {
    using R = Real<L>;
    return {load<R>(block.x + i),
            load<R>(block.y + i),
            load<R>(block.z + i),
            {load<R>(block.qx + i), load<R>(block.qy + i), load<R>(block.qz + i),
             load<R>(block.qw + i)}};
}

template <int L>
TFDB_LANES_INLINE void store_poses_at(PoseBlock& block, std::size_t i, const PoseLanes<L>& p) {
    store(block.x + i, p.x);
    store(block.y + i, p.y);
    store(block.z + i, p.z);
    store(block.qx + i, p.q.x);
    store(block.qy + i, p.q.y);
    store(block.qz + i, p.q.z);
    store(block.qw + i, p.q.w);
}

template <int L>
TFDB_LANES_INLINE PoseLanes<L> broadcast(const Pose& pose) {
    using V = Lanes<L>;
    const Vec3& t = pose.translation;
    const Quat& q = pose.rotation;
    return {V::all(t.x),
            V::all(t.y),
            V::all(t.z),
            {V::all(q.x), V::all(q.y), V::all(q.z), V::all(q.w)}};
}

template <int L>
TFDB_LANES_INLINE Real<L> dot_lanes(const QuatLanes<L>& a, const QuatLanes<L>& b) {
    return (a.x * b.x + a.y * b.y) + (a.z * b.z + a.w * b.w);
}

/// x, y, z turned by q, in place.
template <int L>
TFDB_LANES_INLINE void rotate_lanes(const QuatLanes<L>& q, Real<L>& x, Real<L>& y, Real<L>& z) {
    const Real<L> two = Lanes<L>::all(2.0);
    const Real<L> cx = two * (q.y * z - q.z * y);
    const Real<L> cy = two * (q.z * x - q.x * z);
    const Real<L> cz = two * (q.x * y - q.y * x);
    x = (x + q.w * cx) + (q.y * cz - q.z * cy);
    y = (y + q.w * cy) + (q.z * cx - q.x * cz);
    z = (z + q.w * cz) + (q.x * cy - q.y * cx);
}

template <int L>
TFDB_LANES_INLINE QuatLanes<L> multiply_lanes(const QuatLanes<L>& a, const QuatLanes<L>& b) {
    return {(a.w * b.x + a.x * b.w) + (a.y * b.z - a.z * b.y),
            (a.w * b.y + a.y * b.w) + (a.z * b.x - a.x * b.z),
            (a.w * b.z + a.z * b.w) + (a.x * b.y - a.y * b.x),
            (a.w * b.w - a.x * b.x) - (a.y * b.y + a.z * b.z)};
}

/// Joins E to what the block holds at position i.
template <int L, bool First, bool Inverted>
TFDB_LANES_INLINE void join_at(PoseBlock& block, std::size_t i, PoseLanes<L> edge) {
    if constexpr (Inverted) {
        edge.q.x = -edge.q.x;
        edge.q.y = -edge.q.y;
        edge.q.z = -edge.q.z;
    }
    if constexpr (First && !Inverted) {
        store_poses_at<L>(block, i, edge);
    } else if constexpr (First) {
        PoseLanes<L> result{-edge.x, -edge.y, -edge.z, edge.q};
        rotate_lanes<L>(edge.q, result.x, result.y, result.z);
        store_poses_at<L>(block, i, result);
    } else {
        PoseLanes<L> result = load_poses<L>(block, i);
        if constexpr (Inverted) {
            result.x -= edge.x;
            result.y -= edge.y;
            result.z -= edge.z;
        }
        rotate_lanes<L>(edge.q, result.x, result.y, result.z);
        if constexpr (!Inverted) {
            result.x += edge.x;
            result.y += edge.y;
            result.z += edge.z;
        }
        result.q = multiply_lanes<L>(edge.q, result.q);
        store_poses_at<L>(block, i, result);
    }
}

/// Calls body<First, Inverted>().
template <class Body>
TFDB_LANES_INLINE void with_join(Join join, Body body) {
    if (join.first) {
        join.inverted ? body.template operator()<true, true>()
                      : body.template operator()<true, false>();
    } else {
        join.inverted ? body.template operator()<false, true>()
                      : body.template operator()<false, false>();
    }
}

// --- weights ---------------------------------------------------------------------------------

/// Exact up to 2^53, rounded to nearest above: both halves are put into doubles by their bits.
template <int L>
TFDB_LANES_INLINE Real<L> to_real(Word<L> value) {
    using V = Lanes<L>;
    constexpr std::uint64_t kTwo52 = 0x4330000000000000;
    constexpr std::uint64_t kTwo84 = 0x4530000000000000;
    const Word<L> low = (value & V::all(std::uint64_t{0xFFFFFFFF})) | V::all(kTwo52);
    const Word<L> high = (value >> 32) | V::all(kTwo84);
    return (bits_as<Real<L>>(high) - V::all(0x1.00000001p84)) + bits_as<Real<L>>(low);
}

template <int L>
void weigh(const StampNs* stamps, const StampNs* queries, const std::uint32_t* index,
           std::size_t count, double* weights) {
    for (std::size_t i = 0; i < count; i += L) {
        const auto gather = [&](std::size_t next) {
            return Lanes<L>::make_words([&](int lane) {
                return static_cast<std::uint64_t>(
                    stamps[index[i + static_cast<std::size_t>(lane)] + next]);
            });
        };
        const Word<L> before = gather(0);
        const Word<L> after = gather(1);
        const Word<L> query = load<Word<L>>(queries + i);
        store(weights + i, to_real<L>(query - before) / to_real<L>(after - before));
    }
}

// --- slerp -----------------------------------------------------------------------------------

/// As slerp_series::sum.
template <int Terms, int L>
TFDB_LANES_INLINE Real<L> series(Real<L> x, Real<L> squared) {
    const Real<L> one = Lanes<L>::all(1.0);
    Real<L> value = one;
#pragma GCC unroll 32
    for (int j = Terms - 1; j >= 1; --j) {
        const double scale = 1.0 / (j * (2 * j + 1));
        const double shift = static_cast<double>(j) / (2 * j + 1);
        value = one + value * (x * (squared * Lanes<L>::all(scale) - Lanes<L>::all(shift)));
    }
    return value;
}

/// of_a a + of_b b, and one Newton step towards length one.
template <int L>
TFDB_LANES_INLINE QuatLanes<L> mix_lanes(const QuatLanes<L>& a, Real<L> of_a, const QuatLanes<L>& b,
                                         Real<L> of_b) {
    const QuatLanes<L> q{of_a * a.x + of_b * b.x, of_a * a.y + of_b * b.y, of_a * a.z + of_b * b.z,
                         of_a * a.w + of_b * b.w};
    const Real<L> scale = Lanes<L>::all(1.5) - Lanes<L>::all(0.5) * dot_lanes<L>(q, q);
    return {q.x * scale, q.y * scale, q.z * scale, q.w * scale};
}

template <int Terms, int L>
TFDB_LANES_INLINE QuatLanes<L> mix_by_series(const QuatLanes<L>& a, const QuatLanes<L>& b,
                                             Real<L> x, Real<L> u) {
    const Real<L> v = Lanes<L>::all(1.0) - u;
    return mix_lanes<L>(a, v * series<Terms, L>(x, v * v), b, u * series<Terms, L>(x, u * u));
}

/// Any angle: the half of the arc in which u lies is at most 45 degrees wide, |x| <= 0.293, and
/// there 19 terms leave less than 1e-16. No trigonometry, so no library call per lane.
template <int L>
TFDB_LANES_INLINE QuatLanes<L> wide_slerp_lanes(const QuatLanes<L>& a, const QuatLanes<L>& b,
                                                Real<L> u) {
    using V = Lanes<L>;
    const QuatLanes<L> sum{a.x + b.x, a.y + b.y, a.z + b.z, a.w + b.w};
    const Real<L> length = V::root(dot_lanes<L>(sum, sum));
    const Real<L> scale = V::all(1.0) / length;
    const QuatLanes<L> middle{sum.x * scale, sum.y * scale, sum.z * scale, sum.w * scale};
    const Mask<L> late = u >= V::all(0.5);
    const QuatLanes<L> from{choose<L>(late, middle.x, a.x), choose<L>(late, middle.y, a.y),
                            choose<L>(late, middle.z, a.z), choose<L>(late, middle.w, a.w)};
    const QuatLanes<L> to{choose<L>(late, b.x, middle.x), choose<L>(late, b.y, middle.y),
                          choose<L>(late, b.z, middle.z), choose<L>(late, b.w, middle.w)};
    const Real<L> twice = u + u;
    return mix_by_series<19, L>(from, to, V::all(0.5) * length - V::all(1.0),
                                choose<L>(late, twice - V::all(1.0), twice));
}

/// The shorter way; like the scalar slerp it ends at b itself and not at -b.
template <int L>
TFDB_LANES_INLINE QuatLanes<L> slerp_lanes(const QuatLanes<L>& a, QuatLanes<L> b, Real<L> u) {
    using V = Lanes<L>;
    Real<L> cosine = dot_lanes<L>(a, b);
    const Mask<L> behind = cosine < V::all(0.0);
    if (V::any(behind)) [[unlikely]] {
        const Mask<L> flip = behind & (u < V::all(1.0));
        b = {choose<L>(flip, -b.x, b.x), choose<L>(flip, -b.y, b.y), choose<L>(flip, -b.z, b.z),
             choose<L>(flip, -b.w, b.w)};
        cosine = choose<L>(behind, -cosine, cosine);
    }
    const Real<L> x = cosine - V::all(1.0);
    if (!V::any(x < V::all(-slerp_series::kShortLimit))) {
        return mix_by_series<4, L>(a, b, x, u);
    }
    if (!V::any(x < V::all(-slerp_series::kLongLimit))) {
        return mix_by_series<8, L>(a, b, x, u);
    }
    return wide_slerp_lanes<L>(a, b, u);
}

// --- one edge over a range -------------------------------------------------------------------

/// One segment's slerp weights as polynomials: sin(u th)/sin(th) = u * sum_m power[m] u^(2 m).
template <int Terms>
struct Segment {
    double power[Terms];

    explicit Segment(double x) {
        power[0] = 1.0;
        for (int m = 1; m < Terms; ++m) {
            power[m] = 0.0;
        }
        // value = 1 + value * x (s - j^2) / (j (2 j + 1)), by coefficients of s.
        for (int j = Terms - 1; j >= 1; --j) {
            const double scale = x / (j * (2 * j + 1));
            const double shift = scale * (j * j);
            for (int m = Terms - j; m >= 1; --m) {
                power[m] = power[m - 1] * scale - power[m] * shift;
            }
            power[0] = 1.0 - power[0] * shift;
        }
    }

    template <int L>
    TFDB_LANES_INLINE Real<L> weight(Real<L> u) const {
        const Real<L> squared = u * u;
        Real<L> value = Lanes<L>::all(power[Terms - 1]);
#pragma GCC unroll 8
        for (int m = Terms - 2; m >= 0; --m) {
            value = value * squared + Lanes<L>::all(power[m]);
        }
        return u * value;
    }
};

template <int L, int Terms, bool First, bool Inverted>
void join_run_by(PoseBlock& block, GroupRange range, const Pose* segment, double x,
                 const double* weights) {
    const Segment<Terms> polynomial(x);
    const PoseLanes<L> a = broadcast<L>(segment[0]);
    const PoseLanes<L> b = broadcast<L>(segment[1]);
    const PoseLanes<L> step{b.x - a.x, b.y - a.y, b.z - a.z, b.q};
    for (std::size_t i = range.begin; i < range.end; i += L) {
        const Real<L> u = load<Real<L>>(weights + i);
        const Real<L> of_a = polynomial.template weight<L>(Lanes<L>::all(1.0) - u);
        const Real<L> of_b = polynomial.template weight<L>(u);
        join_at<L, First, Inverted>(block, i,
                                    {a.x + u * step.x, a.y + u * step.y, a.z + u * step.z,
                                     mix_lanes<L>(a.q, of_a, b.q, of_b)});
    }
}

template <int L>
bool join_run(PoseBlock& block, GroupRange range, const Pose* segment, const double* weights,
              Join join) {
    const Quat& a = segment[0].rotation;
    const Quat& b = segment[1].rotation;
    const double x = (a.x * b.x + a.y * b.y) + (a.z * b.z + a.w * b.w) - 1.0;
    if (x < -slerp_series::kLongLimit) {
        return false;
    }
    with_join(join, [&]<bool First, bool Inverted>() {
        x > -slerp_series::kShortLimit
            ? join_run_by<L, 4, First, Inverted>(block, range, segment, x, weights)
            : join_run_by<L, 8, First, Inverted>(block, range, segment, x, weights);
    });
    return true;
}

/// Seven consecutive doubles of each of L rows, as columns.
TFDB_LANES_INLINE PoseLanes<2> gather(const double* r0, const double* r1) {
    using R = Real<2>;
    R columns[8] = {load<R>(r0),
                    load<R>(r1),
                    load<R>(r0 + 2),
                    load<R>(r1 + 2),
                    load<R>(r0 + 4),
                    load<R>(r1 + 4),
                    {},
                    {}};
    for (int pair = 0; pair < 3; ++pair) {
        Lanes<2>::transpose(columns[2 * pair], columns[2 * pair + 1]);
    }
    return {
        columns[0], columns[1], columns[2], {columns[3], columns[4], columns[5], R{r0[6], r1[6]}}};
}

#ifdef __AVX2__
TFDB_LANES_INLINE PoseLanes<4> gather(const double* r0, const double* r1, const double* r2,
                                      const double* r3) {
    using R = Real<4>;
    R x = load<R>(r0);
    R y = load<R>(r1);
    R z = load<R>(r2);
    R unused = load<R>(r3);
    Lanes<4>::transpose(x, y, z, unused);
    QuatLanes<4> q{load<R>(r0 + 3), load<R>(r1 + 3), load<R>(r2 + 3), load<R>(r3 + 3)};
    Lanes<4>::transpose(q.x, q.y, q.z, q.w);
    return {x, y, z, q};
}
#endif

template <int L>
TFDB_LANES_INLINE PoseLanes<L> gather_poses(const Pose* poses, const std::uint32_t* index,
                                            std::size_t next) {
    const auto row = [&](int lane) { return &poses[index[lane] + next].translation.x; };
    if constexpr (L == 2) {
        return gather(row(0), row(1));
    } else {
        return gather(row(0), row(1), row(2), row(3));
    }
}

template <int L, bool First, bool Inverted>
void join_scattered_by(PoseBlock& block, GroupRange range, const Pose* poses,
                       const std::uint32_t* index, const double* weights) {
    for (std::size_t i = range.begin; i < range.end; i += L) {
        const PoseLanes<L> a = gather_poses<L>(poses, index + i, 0);
        const PoseLanes<L> b = gather_poses<L>(poses, index + i, 1);
        const Real<L> u = load<Real<L>>(weights + i);
        join_at<L, First, Inverted>(block, i,
                                    {a.x + u * (b.x - a.x), a.y + u * (b.y - a.y),
                                     a.z + u * (b.z - a.z), slerp_lanes<L>(a.q, b.q, u)});
    }
}

template <int L>
void join_scattered(PoseBlock& block, GroupRange range, const Pose* poses,
                    const std::uint32_t* index, const double* weights, Join join) {
    with_join(join, [&]<bool First, bool Inverted>() {
        join_scattered_by<L, First, Inverted>(block, range, poses, index, weights);
    });
}

template <int L>
void join_constant(PoseBlock& block, std::size_t count, const Pose& pose, bool first) {
    const PoseLanes<L> edge = broadcast<L>(pose);
    for (std::size_t i = 0; i < count; i += L) {
        first ? join_at<L, true, false>(block, i, edge) : join_at<L, false, false>(block, i, edge);
    }
}

}  // namespace
}  // namespace tfdb::geometry
