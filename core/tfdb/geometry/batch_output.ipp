// The kernels that leave a block: rows of poses and matrices, points. Rules as batch_kernels.ipp.
#pragma once

#include "tfdb/geometry/batch_kernels.ipp"

namespace tfdb::geometry {
namespace {

/// Four consecutive doubles a row, from four columns; rows are `stride` doubles apart.
TFDB_LANES_INLINE void scatter(Real<2> c0, Real<2> c1, Real<2> c2, Real<2> c3, double* out,
                               std::size_t stride) {
    Lanes<2>::transpose(c0, c1);
    Lanes<2>::transpose(c2, c3);
    store(out, c0);
    store(out + 2, c2);
    store(out + stride, c1);
    store(out + stride + 2, c3);
}

#ifdef __AVX2__
TFDB_LANES_INLINE void scatter(Real<4> c0, Real<4> c1, Real<4> c2, Real<4> c3, double* out,
                               std::size_t stride) {
    Lanes<4>::transpose(c0, c1, c2, c3);
    store(out, c0);
    store(out + stride, c1);
    store(out + 2 * stride, c2);
    store(out + 3 * stride, c3);
}
#endif

template <int L>
void store_poses(const PoseBlock& block, std::size_t count, double* out) {
    std::size_t i = 0;
    for (; i + L <= count; i += L) {
        const PoseLanes<L> p = load_poses<L>(block, i);
        // Both halves write qx: two whole stores a row are cheaper than a masked one.
        scatter(p.x, p.y, p.z, p.q.x, out + 7 * i, 7);
        scatter(p.q.x, p.q.y, p.q.z, p.q.w, out + 7 * i + 3, 7);
    }
    for (; i < count; ++i) {
        const double row[7] = {block.x[i],  block.y[i],  block.z[i], block.qx[i],
                               block.qy[i], block.qz[i], block.qw[i]};
        __builtin_memcpy(out + 7 * i, row, sizeof row);
    }
}

/// Nine columns: the rotation matrix, row-major.
template <int L>
struct MatrixLanes {
    Real<L> m[9];

    TFDB_LANES_INLINE explicit MatrixLanes(const QuatLanes<L>& q) {
        const Real<L> one = Lanes<L>::all(1.0);
        const Real<L> x2 = q.x + q.x;
        const Real<L> y2 = q.y + q.y;
        const Real<L> z2 = q.z + q.z;
        m[0] = one - (q.y * y2 + q.z * z2);
        m[1] = q.x * y2 - q.w * z2;
        m[2] = q.x * z2 + q.w * y2;
        m[3] = q.x * y2 + q.w * z2;
        m[4] = one - (q.x * x2 + q.z * z2);
        m[5] = q.y * z2 - q.w * x2;
        m[6] = q.x * z2 - q.w * y2;
        m[7] = q.y * z2 + q.w * x2;
        m[8] = one - (q.x * x2 + q.y * y2);
    }
};

template <int L>
void store_matrices(const PoseBlock& block, std::size_t count, double* out) {
    const Real<L> zero = Lanes<L>::all(0.0);
    const Real<L> one = Lanes<L>::all(1.0);
    for (std::size_t i = 0; i < count; i += L) {
        const PoseLanes<L> p = load_poses<L>(block, i);
        const MatrixLanes<L> r(p.q);
        double spill[16 * L];
        const bool whole = i + L <= count;
        double* rows = whole ? out + 16 * i : spill;
        scatter(r.m[0], r.m[1], r.m[2], p.x, rows, 16);
        scatter(r.m[3], r.m[4], r.m[5], p.y, rows + 4, 16);
        scatter(r.m[6], r.m[7], r.m[8], p.z, rows + 8, 16);
        scatter(zero, zero, zero, one, rows + 12, 16);
        if (!whole) {
            __builtin_memcpy(out + 16 * i, spill, (count - i) * 16 * sizeof(double));
        }
    }
}

// --- points ----------------------------------------------------------------------------------

template <int L>
struct PointLanes {
    Real<L> x, y, z;
};

template <int L, class Number>
TFDB_LANES_INLINE PointLanes<L> load_points(const Number* from, std::ptrdiff_t stride) {
    const auto column = [&](std::ptrdiff_t k) {
        return Lanes<L>::make(
            [&](int lane) { return static_cast<double>(from[lane * stride + k]); });
    };
    return {column(0), column(1), column(2)};
}

template <int L, class Number>
TFDB_LANES_INLINE void store_points(Number* to, std::ptrdiff_t stride, const PointLanes<L>& p) {
#pragma GCC unroll 4
    for (int lane = 0; lane < L; ++lane) {
        Number* row = to + lane * stride;
        row[0] = static_cast<Number>(p.x[lane]);
        row[1] = static_cast<Number>(p.y[lane]);
        row[2] = static_cast<Number>(p.z[lane]);
    }
}

/// Calls move(i, points) for whole vectors of points; the last rows go through a copy.
template <int L, class Number, class Move>
TFDB_LANES_INLINE void for_points(std::size_t count, PointRows<const Number> in,
                                  PointRows<Number> out, Move move) {
    std::size_t i = 0;
    for (; i + L <= count; i += L) {
        const auto row = static_cast<std::ptrdiff_t>(i);
        const PointLanes<L> p = load_points<L>(in.data + row * in.stride, in.stride);
        store_points<L>(out.data + row * out.stride, out.stride, move(i, p));
    }
    if (i == count) {
        return;
    }
    Number rest[3 * L] = {};
    for (std::size_t k = i; k < count; ++k) {
        const Number* from = in.data + static_cast<std::ptrdiff_t>(k) * in.stride;
        __builtin_memcpy(rest + 3 * (k - i), from, 3 * sizeof(Number));
    }
    store_points<L>(rest, 3, move(i, load_points<L>(static_cast<const Number*>(rest), 3)));
    for (std::size_t k = i; k < count; ++k) {
        Number* to = out.data + static_cast<std::ptrdiff_t>(k) * out.stride;
        __builtin_memcpy(to, rest + 3 * (k - i), 3 * sizeof(Number));
    }
}

template <int L, class Number>
void move_points(const PoseBlock& block, std::size_t count, PointRows<const Number> in,
                 PointRows<Number> out) {
    for_points<L, Number>(count, in, out, [&](std::size_t i, PointLanes<L> p) {
        const PoseLanes<L> pose = load_poses<L>(block, i);
        rotate_lanes<L>(pose.q, p.x, p.y, p.z);
        return PointLanes<L>{p.x + pose.x, p.y + pose.y, p.z + pose.z};
    });
}

template <int L, class Number>
void move_points_by_one(const Pose& pose, std::size_t count, PointRows<const Number> in,
                        PointRows<Number> out) {
    const PoseLanes<L> t = broadcast<L>(pose);
    const MatrixLanes<L> r(t.q);
    for_points<L, Number>(count, in, out, [&](std::size_t, const PointLanes<L>& p) {
        return PointLanes<L>{t.x + r.m[0] * p.x + r.m[1] * p.y + r.m[2] * p.z,
                             t.y + r.m[3] * p.x + r.m[4] * p.y + r.m[5] * p.z,
                             t.z + r.m[6] * p.x + r.m[7] * p.y + r.m[8] * p.z};
    });
}

template <int L>
constexpr Kernels make_kernels(const char* name) {
    return Kernels{name,
                   &weigh<L>,
                   &join_run<L>,
                   &join_scattered<L>,
                   &join_constant<L>,
                   &store_poses<L>,
                   &store_matrices<L>,
                   &move_points<L, double>,
                   &move_points<L, float>,
                   &move_points_by_one<L, double>,
                   &move_points_by_one<L, float>};
}

}  // namespace
}  // namespace tfdb::geometry
