// What the batch kernels read: one edge's samples as plain arrays, the path of edges between two
// frames, and the rule that picks the pose of an edge at a stamp.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>

#include "tfdb/clock/stamp.hpp"
#include "tfdb/geometry/pose.hpp"

namespace tfdb::geometry {

using clock::StampNs;

/// One edge's samples in plain memory, copied out of the store under one snapshot.
/// Threads: a view, read only. Guarantee: none of its own; the arrays must outlive the call.
struct TrackView {
    const StampNs* stamps = nullptr;  // `size` of them, rising strictly; unused when static
    const Pose* poses = nullptr;      // T[parent<-child], unit quaternions
    // Parent of each sample, or null when all are the same. Between two samples with different
    // parents the earlier one is held.
    const std::uint32_t* parents = nullptr;
    std::size_t size = 0;    // below 2^32; a moving edge without samples refuses every stamp
    bool is_static = false;  // poses[0] is valid at every stamp
};

/// The edges between two frames, each side from its frame upward to where both meet.
struct Path {
    std::span<const TrackView> source_side;
    std::span<const TrackView> target_side;
};

enum class Selection : std::uint8_t {
    kInterpolate,  // between the neighbours; limit: greatest distance of the two
    kExact,        // a stored stamp only
    kPrevious,     // the newest sample at or before the stamp; limit: greatest age
    kNearest,      // the closest sample, the earlier one of two; limit: greatest distance
    kExtrapolate,  // as kInterpolate inside, constant velocity outside; limit: how far outside
};

inline constexpr StampNs kNoLimit = std::numeric_limits<StampNs>::max();

struct Rule {
    Selection selection = Selection::kInterpolate;
    StampNs limit = kNoLimit;
};

/// Where a rule finds the pose of a moving track at a stamp: see pose_at.
struct Selected {
    std::size_t index = 0;  // 0 for a track of one sample
    double u = 0.0;        // how far on the way to the next sample; as far as it is known in double
    bool refused = false;  // the rule gives no pose at this stamp; index and u are then 0
    bool outside = false;  // extrapolated
};

/// One stamp, by binary search: the definition that the kernels must agree with.
Selected select_sample(const TrackView& track, const Rule& rule, StampNs stamp) noexcept;

/// The pose at a stamp for which `selected` is not refused. Beyond an end the motion goes on from
/// the sample there.
Pose pose_at(const TrackView& track, const Selected& selected, StampNs stamp) noexcept;

}  // namespace tfdb::geometry
