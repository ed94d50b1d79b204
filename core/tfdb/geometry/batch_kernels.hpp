// The arithmetic of the batch functions over one block of stamps, once per instruction set.
#pragma once

#include <cstddef>
#include <cstdint>

#include "tfdb/geometry/batch.hpp"

namespace tfdb::geometry {

/// Stamps that are worked on together: few enough that a block's poses stay in the first cache.
inline constexpr std::size_t kBlock = 256;

/// Kernels work on whole groups of stamps, so that no vector width needs a tail.
inline constexpr std::size_t kGroup = 4;
static_assert(kBlock % kGroup == 0);

constexpr std::size_t round_up_to_group(std::size_t count) noexcept {
    return (count + kGroup - 1) / kGroup * kGroup;
}

/// The poses of one block, each component by itself.
struct alignas(64) PoseBlock {
    double x[kBlock], y[kBlock], z[kBlock];
    double qx[kBlock], qy[kBlock], qz[kBlock], qw[kBlock];
};

/// Half-open range of positions in a block; both ends are multiples of kGroup.
struct GroupRange {
    std::size_t begin, end;
};

/// Threads: pure functions over the caller's memory. Guarantee: blocking-free, no allocation.
struct Kernels {
    const char* name;

    /// weights[i]: how far queries[i] lies between stamps[index[i]] and the next one, 0 to 1.
    void (*weigh)(const StampNs* stamps, const StampNs* queries, const std::uint32_t* index,
                  std::size_t count, double* weights);

    // Joining puts an edge's poses in front of those of the edges before it; where it is the first,
    // they are the result.

    /// One segment for the whole range.
    void (*join_run)(PoseBlock& block, GroupRange range, const Pose* segment, const double* weights,
                     bool first);

    /// A segment of its own for every position.
    void (*join_scattered)(PoseBlock& block, GroupRange range, const Pose* poses,
                           const std::uint32_t* index, const double* weights, bool first);

    void (*join_constant)(PoseBlock& block, std::size_t count, const Pose& pose, bool first);

    /// The inverse of each pose.
    void (*turn)(PoseBlock& block, std::size_t count);
    /// T[target<-source] into `block` from T[meeting<-source] in it and T[meeting<-target].
    void (*meet)(PoseBlock& block, const PoseBlock& target_side, std::size_t count);

    void (*store_poses)(const PoseBlock& block, std::size_t count, double* out);
    void (*store_matrices)(const PoseBlock& block, std::size_t count, double* out);

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
extern const Kernels kAvx2Kernels;
#endif

}  // namespace tfdb::geometry
