// The kernels of batch_kernels.hpp for any number of lanes. Included by one file per instruction
// set; everything is in an unnamed namespace and what it calls of other headers is always inlined,
// so that code for AVX2 stays in its file.
#pragma once

#include "tfdb/geometry/batch_kernels.hpp"
#include "tfdb/geometry/lanes.hpp"
#include "tfdb/geometry/slerp.hpp"

namespace tfdb::geometry {
namespace {

template <int L>
using Real = typename Lanes<L>::Real;
template <int L>
using Word = typename Lanes<L>::Word;

template <class Vector>
TFDB_INLINE Vector load(const void* from) {
    Vector value;
    __builtin_memcpy(&value, from, sizeof value);
    return value;
}

template <class Vector>
TFDB_INLINE void store(void* to, Vector value) {
    __builtin_memcpy(to, &value, sizeof value);
}

template <class To, class From>
TFDB_INLINE To bits_as(From value) {
    static_assert(sizeof(To) == sizeof(From));
    To result;
    __builtin_memcpy(&result, &value, sizeof result);
    return result;
}

template <int L>
using PoseLanes = PoseOf<Real<L>>;

template <int L>
TFDB_INLINE PoseLanes<L> load_poses(const PoseBlock& block, std::size_t i) {
    using R = Real<L>;
    return {{load<R>(block.x + i), load<R>(block.y + i), load<R>(block.z + i)},
            {load<R>(block.qx + i), load<R>(block.qy + i), load<R>(block.qz + i),
             load<R>(block.qw + i)}};
}

template <int L>
TFDB_INLINE void store_poses_at(PoseBlock& block, std::size_t i, const PoseLanes<L>& p) {
    store(block.x + i, p.translation.x);
    store(block.y + i, p.translation.y);
    store(block.z + i, p.translation.z);
    store(block.qx + i, p.rotation.x);
    store(block.qy + i, p.rotation.y);
    store(block.qz + i, p.rotation.z);
    store(block.qw + i, p.rotation.w);
}

template <int L>
TFDB_INLINE PoseLanes<L> broadcast(const Pose& pose) {
    using V = Lanes<L>;
    const Vec3& t = pose.translation;
    const Quat& q = pose.rotation;
    return {{V::fill(t.x), V::fill(t.y), V::fill(t.z)},
            {V::fill(q.x), V::fill(q.y), V::fill(q.z), V::fill(q.w)}};
}

template <int L, bool First>
TFDB_INLINE void join_at(PoseBlock& block, std::size_t i, const PoseLanes<L>& edge) {
    if constexpr (First) {
        store_poses_at<L>(block, i, edge);
    } else {
        store_poses_at<L>(block, i, compose(edge, load_poses<L>(block, i)));
    }
}

// --- weights ---------------------------------------------------------------------------------

/// Exact up to 2^53, rounded to nearest above: both halves are put into doubles by their bits.
template <int L>
TFDB_INLINE Real<L> to_real(Word<L> value) {
    using V = Lanes<L>;
    constexpr std::uint64_t kTwo52 = 0x4330000000000000;
    constexpr std::uint64_t kTwo84 = 0x4530000000000000;
    const Word<L> low = (value & V::fill(std::uint64_t{0xFFFFFFFF})) | V::fill(kTwo52);
    const Word<L> high = (value >> 32) | V::fill(kTwo84);
    return (bits_as<Real<L>>(high) - V::fill(0x1.00000001p84)) + bits_as<Real<L>>(low);
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

// --- one edge over a range -------------------------------------------------------------------

template <int L, bool First>
void join_run_by(PoseBlock& block, GroupRange range, const Pose* segment, const double* weights) {
    const PoseLanes<L> a = broadcast<L>(segment[0]);
    const PoseLanes<L> b = broadcast<L>(segment[1]);
    for (std::size_t i = range.begin; i < range.end; i += L) {
        join_at<L, First>(block, i, interpolate(a, b, load<Real<L>>(weights + i)));
    }
}

template <int L>
void join_run(PoseBlock& block, GroupRange range, const Pose* segment, const double* weights,
              bool first) {
    first ? join_run_by<L, true>(block, range, segment, weights)
          : join_run_by<L, false>(block, range, segment, weights);
}

/// Seven consecutive doubles of each of L rows, as columns.
TFDB_INLINE PoseLanes<2> gather(const double* r0, const double* r1) {
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
    return {{columns[0], columns[1], columns[2]},
            {columns[3], columns[4], columns[5], R{r0[6], r1[6]}}};
}

#ifdef __AVX2__
TFDB_INLINE PoseLanes<4> gather(const double* r0, const double* r1, const double* r2,
                                const double* r3) {
    using R = Real<4>;
    R x = load<R>(r0);
    R y = load<R>(r1);
    R z = load<R>(r2);
    R unused = load<R>(r3);
    Lanes<4>::transpose(x, y, z, unused);
    QuatOf<R> q{load<R>(r0 + 3), load<R>(r1 + 3), load<R>(r2 + 3), load<R>(r3 + 3)};
    Lanes<4>::transpose(q.x, q.y, q.z, q.w);
    return {{x, y, z}, q};
}
#endif

template <int L>
TFDB_INLINE PoseLanes<L> gather_poses(const Pose* poses, const std::uint32_t* index,
                                      std::size_t next) {
    const auto row = [&](int lane) { return &poses[index[lane] + next].translation.x; };
    if constexpr (L == 2) {
        return gather(row(0), row(1));
    } else {
        return gather(row(0), row(1), row(2), row(3));
    }
}

template <int L, bool First>
void join_scattered_by(PoseBlock& block, GroupRange range, const Pose* poses,
                       const std::uint32_t* index, const double* weights) {
    for (std::size_t i = range.begin; i < range.end; i += L) {
        const PoseLanes<L> a = gather_poses<L>(poses, index + i, 0);
        const PoseLanes<L> b = gather_poses<L>(poses, index + i, 1);
        join_at<L, First>(block, i, interpolate(a, b, load<Real<L>>(weights + i)));
    }
}

template <int L>
void join_scattered(PoseBlock& block, GroupRange range, const Pose* poses,
                    const std::uint32_t* index, const double* weights, bool first) {
    first ? join_scattered_by<L, true>(block, range, poses, index, weights)
          : join_scattered_by<L, false>(block, range, poses, index, weights);
}

template <int L>
void join_constant(PoseBlock& block, std::size_t count, const Pose& pose, bool first) {
    const PoseLanes<L> edge = broadcast<L>(pose);
    for (std::size_t i = 0; i < count; i += L) {
        first ? join_at<L, true>(block, i, edge) : join_at<L, false>(block, i, edge);
    }
}

// --- both sides ------------------------------------------------------------------------------

template <int L>
void turn(PoseBlock& block, std::size_t count) {
    for (std::size_t i = 0; i < count; i += L) {
        store_poses_at<L>(block, i, inverse(load_poses<L>(block, i)));
    }
}

template <int L>
void meet(PoseBlock& block, const PoseBlock& target_side, std::size_t count) {
    for (std::size_t i = 0; i < count; i += L) {
        const PoseLanes<L> back = inverse(load_poses<L>(target_side, i));
        store_poses_at<L>(block, i, compose(back, load_poses<L>(block, i)));
    }
}

}  // namespace
}  // namespace tfdb::geometry
