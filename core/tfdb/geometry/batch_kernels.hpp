// The arithmetic of batches over one block of stamps, compiled once per instruction set. The
// kernels read an edge's samples in place. A slot has eight words: one word with the sample's
// commit and parent, then its pose.
//
// The poses equal, bit for bit, those of slerp.hpp and pose.hpp composed edge by edge: upward on
// each side of a path, then one side with the inverse of the other.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>

#include "tfdb/clock/stamp.hpp"
#include "tfdb/geometry/pose.hpp"

namespace tfdb::geometry {

using clock::StampNs;

/// Stamps computed together: few enough that all their numbers stay in the first-level cache.
inline constexpr std::size_t kBlock = 128;

/// Kernels process whole groups of stamps, so no vector width needs a remainder loop.
inline constexpr std::size_t kGroup = 8;
static_assert(kBlock % kGroup == 0);

constexpr std::size_t round_up_to_group(std::size_t count) noexcept {
    return (count + kGroup - 1) / kGroup * kGroup;
}

/// The poses of one block, as one array per component.
struct alignas(64) PoseBlock {
    double x[kBlock], y[kBlock], z[kBlock];
    double qx[kBlock], qy[kBlock], qz[kBlock], qw[kBlock];
};

TFDB_INLINE Pose pose_at(const PoseBlock& block, std::size_t i) noexcept {
    return {{block.x[i], block.y[i], block.z[i]},
            {block.qx[i], block.qy[i], block.qz[i], block.qw[i]}};
}

TFDB_INLINE void put_pose(PoseBlock& block, std::size_t i, const Pose& pose) noexcept {
    block.x[i] = pose.translation.x;
    block.y[i] = pose.translation.y;
    block.z[i] = pose.translation.z;
    block.qx[i] = pose.rotation.x;
    block.qy[i] = pose.rotation.y;
    block.qz[i] = pose.rotation.z;
    block.qw[i] = pose.rotation.w;
}

/// On one edge, the sample pairs that enclose the stamps of a block. Threads: one. Guarantee: none
/// of its own.
struct Pairs {
    /// For a pair whose first sample is the answer unchanged: its share is 0 at any stamp.
    static constexpr double kHeld = std::numeric_limits<double>::infinity();

    /// Numbers of a pair: the first sample's stamp (an integer's bits), and the time to the second
    /// sample, below 2^53 or kHeld. Kernels::load adds the first sample's pose, the translation
    /// from it to the second sample, the second rotation or its opposite quaternion, whichever is
    /// nearer, and their distance (see Apart).
    enum Column : std::uint8_t {
        kFrom,
        kSpan,
        kX,
        kY,
        kZ,
        kQx,
        kQy,
        kQz,
        kQw,
        kWayX,
        kWayY,
        kWayZ,
        kToX,
        kToY,
        kToZ,
        kToW,
        kApart,
        kColumns
    };
    /// Space behind the last pair: a group of stamps is looked up from its first pair on.
    static constexpr std::size_t kRoom = kBlock + kGroup;

    std::size_t count = 0;
    // pair index of each stamp: rises by 0 or 1 from one to the next
    std::uint32_t of[kBlock] = {};
    const void* first[kBlock] = {};  // the samples' slots
    const void* second[kBlock] = {};
    alignas(64) double numbers[kColumns * kRoom] = {};  // column by column

    void add(StampNs from, double span, const void* first_slot, const void* second_slot) {
        numbers[kRoom * kFrom + count] = std::bit_cast<double>(from);
        numbers[kRoom * kSpan + count] = span;
        first[count] = first_slot;
        second[count] = second_slot;
        ++count;
    }
};

/// The allowed range of a slot's first word: `least` to `most`, with these bits equal to `least`'s.
struct SlotWords {
    std::uint64_t least = 0, most = 0, bits = 0;

    [[nodiscard]] constexpr bool contain(std::uint64_t word) const {
        return word - least <= most - least && ((word ^ least) & bits) == 0;
    }
};

/// Rows of three coordinates. Real is float, double, const float or const double.
template <class Real>
struct PointRows {
    Real* data = nullptr;
    std::ptrdiff_t stride = 3;  // from row to row, in numbers

    [[nodiscard]] PointRows from(std::size_t row) const {
        return {data + static_cast<std::ptrdiff_t>(row) * stride, stride};
    }
};

/// Stamp counts are whole groups, except for the last two members.
/// Threads: pure functions over the caller's memory. Guarantee: blocking-free, no allocation.
struct Kernels {
    const char* name;

    /// Reads the samples of the pairs. False if a slot's first word is not in `words`. Writers may
    /// overwrite the slots meanwhile: the result counts only if the edge's view is confirmed
    /// afterwards.
    bool (*load)(Pairs& pairs, const SlotWords& words);

    // `join` composes an edge's poses with those of the edges before it; for the first edge, they
    // are the result.
    void (*join)(PoseBlock& block, std::size_t count, const StampNs* stamps, const Pairs& pairs,
                 bool first);
    void (*join_constant)(PoseBlock& block, std::size_t count, const Pose& pose, bool first);

    /// The inverse of each pose.
    void (*turn)(PoseBlock& block, std::size_t count);
    /// Turns T[meeting<-source] in `block` into T[target<-source], given T[meeting<-target].
    void (*meet)(PoseBlock& block, const PoseBlock& target_side, std::size_t count);
    /// Whether all poses are finite: see is_finite of one pose.
    bool (*all_finite)(const PoseBlock& block, std::size_t count);

    /// Rows of 7 doubles: x y z qx qy qz qw. Rows of 16: the 4 x 4 matrix, row-major.
    void (*store_poses)(const PoseBlock& block, std::size_t count, double* out);
    void (*store_matrices)(const PoseBlock& block, std::size_t count, double* out);

    /// out[i] = pose i * in[i]; in and out may be the same rows.
    void (*move_doubles)(const PoseBlock& block, std::size_t count, PointRows<const double> in,
                         PointRows<double> out);
    void (*move_floats)(const PoseBlock& block, std::size_t count, PointRows<const float> in,
                        PointRows<float> out);
    void (*move_doubles_by_one)(const Pose& pose, std::size_t count, PointRows<const double> in,
                                PointRows<double> out);
    void (*move_floats_by_one)(const Pose& pose, std::size_t count, PointRows<const float> in,
                               PointRows<float> out);
};

extern const Kernels kPortableKernels;
#if defined(__x86_64__)
extern const Kernels kV3Kernels;
extern const Kernels kV4Kernels;
#endif

/// The kernels that this processor can run, the fastest first.
std::span<const Kernels* const> runnable_kernels();

/// The fastest runnable kernels, or those that TFDB_KERNELS names (portable, v3, v4), for tests and
/// for comparing machines.
const Kernels& chosen_kernels();

}  // namespace tfdb::geometry
