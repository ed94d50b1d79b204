// The kernels of batch_kernels.hpp for any number of lanes. One file per instruction set includes
// this. Everything is in an unnamed namespace, and calls to other headers are always inlined, so
// code for one instruction set stays in its file.
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

// --- samples ---------------------------------------------------------------------------------

/// Exact up to 2^53, rounded to nearest above. Both halves are converted through the bits of
/// doubles.
template <int L>
TFDB_INLINE Real<L> to_real(Word<L> value) {
    using V = Lanes<L>;
#ifdef __AVX512DQ__
    if constexpr (L == 8)
        return __builtin_convertvector(value, Real<L>);
#endif
    constexpr std::uint64_t kTwo52 = 0x4330000000000000;
    constexpr std::uint64_t kTwo84 = 0x4530000000000000;
    const Word<L> low = (value & V::fill(std::uint64_t{0xFFFFFFFF})) | V::fill(kTwo52);
    const Word<L> high = (value >> 32) | V::fill(kTwo84);
    return (bits_as<Real<L>>(high) - V::fill(0x1.00000001p84)) + bits_as<Real<L>>(low);
}

/// Plain loads of memory that writers may overwrite: ThreadSanitizer must not report this race.
template <int L>
__attribute__((no_sanitize("thread"))) bool load_pairs(Pairs& p, const SlotWords& words) {
    using V = Lanes<L>;
    for (std::size_t k = p.count; k < round_up_to_group(p.count); ++k) {
        p.first[k] = p.first[p.count - 1];
        p.second[k] = p.second[p.count - 1];
    }
    const Word<L> least = V::fill(words.least);
    const Word<L> range = V::fill(words.most - words.least);
    const Word<L> bits = V::fill(words.bits);
    typename V::Mask wrong{};
    for (std::size_t k = 0; k < p.count; k += L) {
        Real<L> a[8];
        Real<L> b[8];
        V::columns(p.first + k, a);
        V::columns(p.second + k, b);
        for (const Real<L>& column : {a[0], b[0]}) {
            const auto word = bits_as<Word<L>>(column);
            wrong |=
                (word - least > range) | (((word ^ least) & bits) != V::fill(std::uint64_t{0}));
        }
        const QuatOf<Real<L>> q{a[4], a[5], a[6], a[7]};
        const QuatOf<Real<L>> to{b[4], b[5], b[6], b[7]};
        const auto [x, sign] = apart(q, to);
        double* const at = p.numbers + k;
        for (std::size_t i = 0; i < 7; ++i)
            store(at + Pairs::kRoom * (Pairs::kX + i), a[1 + i]);
        for (std::size_t i = 0; i < 3; ++i)
            store(at + Pairs::kRoom * (Pairs::kWayX + i), b[1 + i] - a[1 + i]);
        for (std::size_t i = 0; i < 4; ++i)
            store(at + Pairs::kRoom * (Pairs::kToX + i), b[4 + i] * sign);
        store(at + Pairs::kRoom * Pairs::kApart, x);
    }
    return !V::any(wrong);
}

// --- one edge over a block -------------------------------------------------------------------

/// The numbers of Pairs, for L stamps.
template <int L>
struct PairLanes {
    Word<L> from;
    Real<L> span;
    PoseLanes<L> first;
    Vec3Of<Real<L>> way;
    QuatOf<Real<L>> to;
    Real<L> apart;
};

/// `lanes(column)`: that column's numbers for L stamps; the first stamp's number is at `column`.
template <int L, class Fetch>
TFDB_INLINE PairLanes<L> fetch_pairs(const double* at, Fetch lanes) {
    const auto get = [&](Pairs::Column column) { return lanes(at + Pairs::kRoom * column); };
    return {bits_as<Word<L>>(get(Pairs::kFrom)),
            get(Pairs::kSpan),
            {{get(Pairs::kX), get(Pairs::kY), get(Pairs::kZ)},
             {get(Pairs::kQx), get(Pairs::kQy), get(Pairs::kQz), get(Pairs::kQw)}},
            {get(Pairs::kWayX), get(Pairs::kWayY), get(Pairs::kWayZ)},
            {get(Pairs::kToX), get(Pairs::kToY), get(Pairs::kToZ), get(Pairs::kToW)},
            get(Pairs::kApart)};
}

/// As `interpolate`, for a prepared pair; no share is 1.
template <int L, bool First>
TFDB_INLINE void join_pairs_at(PoseBlock& block, std::size_t i, const PairLanes<L>& p,
                               const StampNs* stamps) {
    using V = Lanes<L>;
    const Real<L> u = to_real<L>(load<Word<L>>(stamps + i) - p.from) / p.span;
    const Vec3Of<Real<L>>& t = p.first.translation;
    const Apart<Real<L>> apart{p.apart, V::fill(1.0)};
    PoseLanes<L> edge{{t.x + u * p.way.x, t.y + u * p.way.y, t.z + u * p.way.z},
                      slerp(p.first.rotation, p.to, apart, u)};
    const auto stored = u == V::fill(0.0);
    if (V::any(stored)) [[unlikely]]
        edge = detail::choose(stored, p.first, edge);
    join_at<L, First>(block, i, edge);
}

/// A run: at least this many stamps between the same two samples, whose numbers are loaded once.
constexpr std::size_t kRun = 16;

template <int L, bool First>
void join_by(PoseBlock& block, std::size_t count, const StampNs* stamps, const Pairs& pairs) {
    using V = Lanes<L>;
    const std::uint32_t* const of = pairs.of;
    for (std::size_t i = 0; i < count;) {
        const std::uint32_t k = of[i];
        const double* const at = pairs.numbers + k;
        if (i + kRun <= count && k == of[i + kRun - 1]) {
            const PairLanes<L> run = fetch_pairs<L>(
                at, [](const double* column) { return V::fill(load<double>(column)); });
            for (; i + L <= count && of[i + L - 1] == k; i += L)
                join_pairs_at<L, First>(block, i, run, stamps);
            continue;
        }
        const auto places = V::places(of + i);
        const PairLanes<L> group =
            fetch_pairs<L>(at, [&](const double* column) { return V::spread(column, places); });
        join_pairs_at<L, First>(block, i, group, stamps);
        i += L;
    }
}

template <int L>
void join(PoseBlock& block, std::size_t count, const StampNs* stamps, const Pairs& pairs,
          bool first) {
    first ? join_by<L, true>(block, count, stamps, pairs)
          : join_by<L, false>(block, count, stamps, pairs);
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

template <int L>
bool all_finite(const PoseBlock& block, std::size_t count) {
    const Real<L> zero = Lanes<L>::fill(0.0);
    auto wrong = zero != zero;
    for (std::size_t i = 0; i < count; i += L) {
        const auto& [t, q] = load_poses<L>(block, i);
        // Zero times infinity or NaN is NaN.
        wrong |= 0.0 * t.x + 0.0 * t.y + 0.0 * t.z != zero;
    }
    return !Lanes<L>::any(wrong);
}

}  // namespace
}  // namespace tfdb::geometry
