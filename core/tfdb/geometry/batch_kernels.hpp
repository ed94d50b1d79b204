// The arithmetic of batches over one block of stamps, once per instruction set. An edge's samples
// are read where they lie: slots of eight words, a word with the sample's commit and parent, and
// its pose.
//
// The poses are, bit for bit, those of slerp.hpp and pose.hpp composed edge by edge: upward on each
// side of a path, then one side with the inverse of the other.
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

/// Stamps that are worked on together: few enough that all their numbers stay in the first cache.
inline constexpr std::size_t kBlock = 128;

/// Kernels work on whole groups of stamps, so that no vector width needs a tail.
inline constexpr std::size_t kGroup = 8;
static_assert(kBlock % kGroup == 0);

constexpr std::size_t round_up_to_group(std::size_t count) noexcept {
    return (count + kGroup - 1) / kGroup * kGroup;
}

/// The poses of one block, each component by itself.
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

/// The pairs of samples between which the stamps of a block lie on one edge.
/// Threads: one. Guarantee: none of its own.
struct Pairs {
    /// Of a pair whose first sample is the answer as it is: its share is 0 at any stamp.
    static constexpr double kHeld = std::numeric_limits<double>::infinity();

    /// Numbers of a pair: the first sample's stamp (an integer's bits), the time from there to the
    /// second one's, below 2^53 or kHeld. By Kernels::load: the first sample's pose, the way to the
    /// second one's translation, its rotation or the opposite quaternion, whichever is nearer, and
    /// how near that is (see Apart).
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
    /// Room behind the last pair: a group of stamps is looked up from its first pair on.
    static constexpr std::size_t kRoom = kBlock + kGroup;

    std::size_t count = 0;
    std::uint32_t of[kBlock] = {};   // which pair a stamp has: rises by 0 or 1 from one to the next
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

/// What the first word of a slot must be: from `least` to `most`, with these bits of `least`.
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

/// Counts of stamps are of whole groups, but for the last two lines.
/// Threads: pure functions over the caller's memory. Guarantee: blocking-free, no allocation.
struct Kernels {
    const char* name;

    /// Reads the samples of the pairs. False if a slot's first word is not one of `words`. Writers
    /// may be at work there: what was read counts if the edge's view is confirmed afterwards.
    bool (*load)(Pairs& pairs, const SlotWords& words);

    // Joining puts an edge's poses in front of those of the edges before it; where it is the first,
    // they are the result.
    void (*join)(PoseBlock& block, std::size_t count, const StampNs* stamps, const Pairs& pairs,
                 bool first);
    void (*join_constant)(PoseBlock& block, std::size_t count, const Pose& pose, bool first);

    /// The inverse of each pose.
    void (*turn)(PoseBlock& block, std::size_t count);
    /// T[target<-source] into `block` from T[meeting<-source] in it and T[meeting<-target].
    void (*meet)(PoseBlock& block, const PoseBlock& target_side, std::size_t count);
    /// Whether all are finite: see is_finite of one pose.
    bool (*all_finite)(const PoseBlock& block, std::size_t count);

    /// Rows of 7 doubles: x y z qx qy qz qw; and of 16: the 4 x 4 matrix, row-major.
    void (*store_poses)(const PoseBlock& block, std::size_t count, double* out);
    void (*store_matrices)(const PoseBlock& block, std::size_t count, double* out);

    /// out[i] = pose of i * in[i], in place when both are the same rows.
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

/// Those that this processor can run, the fastest first.
std::span<const Kernels* const> runnable_kernels();

/// The fastest, or that of these which TFDB_KERNELS names (portable, v3, v4), for tests and to
/// compare machines.
const Kernels& chosen_kernels();

}  // namespace tfdb::geometry
