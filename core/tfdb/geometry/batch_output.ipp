// The kernels that write a block's results: rows of poses and matrices, points. The rules of
// batch_kernels.ipp apply.
#pragma once

#include <algorithm>

#include "tfdb/geometry/batch_kernels.ipp"

namespace tfdb::geometry {
namespace {

/// Writes four consecutive doubles per row, from four columns; rows are `stride` doubles apart.
TFDB_INLINE void scatter(Real<2> c0, Real<2> c1, Real<2> c2, Real<2> c3, double* out,
                         std::size_t stride) {
    Lanes<2>::transpose(c0, c1);
    Lanes<2>::transpose(c2, c3);
    store(out, c0);
    store(out + 2, c2);
    store(out + stride, c1);
    store(out + stride + 2, c3);
}

#ifdef __AVX2__
TFDB_INLINE void scatter(Real<4> c0, Real<4> c1, Real<4> c2, Real<4> c3, double* out,
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
        // Both halves write qx: two full stores per row are cheaper than a masked one.
        const auto& [t, q] = p;
        scatter(t.x, t.y, t.z, q.x, out + 7 * i, 7);
        scatter(q.x, q.y, q.z, q.w, out + 7 * i + 3, 7);
    }
    for (; i < count; ++i) {
        const double row[7] = {block.x[i],  block.y[i],  block.z[i], block.qx[i],
                               block.qy[i], block.qz[i], block.qw[i]};
        __builtin_memcpy(out + 7 * i, row, sizeof row);
    }
}

template <int L>
void store_matrices(const PoseBlock& block, std::size_t count, double* out) {
    const Real<L> zero = Lanes<L>::fill(0.0);
    const Real<L> one = Lanes<L>::fill(1.0);
    for (std::size_t i = 0; i < count; i += L) {
        const PoseLanes<L> p = load_poses<L>(block, i);
        const Vec3Of<Real<L>>& t = p.translation;
        const MatrixOf<Real<L>> r = matrix(p.rotation);
        double spill[16 * L];
        const bool whole = i + L <= count;
        double* rows = whole ? out + 16 * i : spill;
        scatter(r.m[0], r.m[1], r.m[2], t.x, rows, 16);
        scatter(r.m[3], r.m[4], r.m[5], t.y, rows + 4, 16);
        scatter(r.m[6], r.m[7], r.m[8], t.z, rows + 8, 16);
        scatter(zero, zero, zero, one, rows + 12, 16);
        if (!whole) {
            __builtin_memcpy(out + 16 * i, spill, (count - i) * 16 * sizeof(double));
        }
    }
}

// --- points ----------------------------------------------------------------------------------

template <int L>
using PointLanes = Vec3Of<Real<L>>;

template <int L, class Number>
TFDB_INLINE PointLanes<L> load_points(const Number* from, std::ptrdiff_t stride) {
    const auto column = [&](std::ptrdiff_t k) {
        return Lanes<L>::make(
            [&](int lane) { return static_cast<double>(from[lane * stride + k]); });
    };
    return {column(0), column(1), column(2)};
}

template <int L, class Number>
TFDB_INLINE void store_points(Number* to, std::ptrdiff_t stride, const PointLanes<L>& p) {
#pragma GCC unroll 4
    for (int lane = 0; lane < L; ++lane) {
        Number* row = to + lane * stride;
        row[0] = static_cast<Number>(p.x[lane]);
        row[1] = static_cast<Number>(p.y[lane]);
        row[2] = static_cast<Number>(p.z[lane]);
    }
}

#ifdef __AVX2__
using Floats = float __attribute__((vector_size(16)));

/// Four points side by side in memory: as load_points, without a conversion per number.
TFDB_INLINE PointLanes<4> load_packed(const float* from) {
    const auto a = load<Floats>(from);      // x0 y0 z0 x1
    const auto b = load<Floats>(from + 4);  // y1 z1 x2 y2
    const auto c = load<Floats>(from + 8);  // z2 x3 y3 z3
    const Floats x = __builtin_shufflevector(a, b, 0, 3, 6, 6);
    const Floats y = __builtin_shufflevector(a, b, 1, 4, 7, 7);
    const Floats z = __builtin_shufflevector(a, b, 2, 5, 5, 5);
    const auto widen = [](Floats v) { return __builtin_convertvector(v, Real<4>); };
    return {widen(__builtin_shufflevector(x, c, 0, 1, 2, 5)),
            widen(__builtin_shufflevector(y, c, 0, 1, 2, 6)),
            widen(__builtin_shufflevector(z, c, 0, 1, 4, 7))};
}

TFDB_INLINE void store_packed(float* to, const PointLanes<4>& p) {
    const auto x = __builtin_convertvector(p.x, Floats);
    const auto y = __builtin_convertvector(p.y, Floats);
    const auto z = __builtin_convertvector(p.z, Floats);
    const Floats first = __builtin_shufflevector(x, y, 0, 4, 1, 5);  // x0 y0 x1 y1
    const Floats last = __builtin_shufflevector(x, y, 2, 6, 3, 7);   // x2 y2 x3 y3
    const Floats middle = __builtin_shufflevector(first, z, 3, 5, 3, 3);
    store(to, __builtin_shufflevector(first, z, 0, 1, 4, 2));
    store(to + 4, __builtin_shufflevector(middle, last, 0, 1, 4, 5));
    store(to + 8, __builtin_shufflevector(z, last, 2, 6, 7, 3));
}
#endif

/// Calls move(i, points) for full vectors of points; the remaining rows go through a copy.
template <int L, class Number, class Move>
TFDB_INLINE void for_points(std::size_t count, PointRows<const Number> in, PointRows<Number> out,
                            Move move) {
    std::size_t i = 0;
#ifdef __AVX2__
    if constexpr (L == 4 && sizeof(Number) == sizeof(float)) {
        if (in.stride == 3 && out.stride == 3) {
            for (; i + L <= count; i += L) {
                store_packed(out.data + 3 * i, move(i, load_packed(in.data + 3 * i)));
            }
        }
    }
#endif
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
    for_points<L, Number>(count, in, out, [&](std::size_t i, const PointLanes<L>& p) {
        return apply(load_poses<L>(block, i), p);
    });
}

template <int L, class Number>
void move_points_by_one(const Pose& pose, std::size_t count, PointRows<const Number> in,
                        PointRows<Number> out) {
    const PoseLanes<L> all = broadcast<L>(pose);
    for_points<L, Number>(count, in, out,
                          [&](std::size_t, const PointLanes<L>& p) { return apply(all, p); });
}

/// Rows and points are written with four lanes at most: memory limits eight lanes.
template <int L>
constexpr Kernels make_kernels(const char* name) {
    constexpr int kOut = std::min(L, 4);
    return Kernels{name,
                   &load_pairs<L>,
                   &join<L>,
                   &join_constant<L>,
                   &turn<L>,
                   &meet<L>,
                   &all_finite<L>,
                   &store_poses<kOut>,
                   &store_matrices<kOut>,
                   &move_points<kOut, double>,
                   &move_points<kOut, float>,
                   &move_points_by_one<kOut, double>,
                   &move_points_by_one<kOut, float>};
}

}  // namespace
}  // namespace tfdb::geometry
