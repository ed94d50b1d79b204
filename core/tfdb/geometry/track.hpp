// What the batch kernels read: one edge's samples as plain arrays, the chain of edges between two
// frames, and the rule that picks the pose of an edge at a stamp.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>

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

/// One step of the walk from the source up to the meeting point and down to the target.
struct ChainEdge {
    TrackView track;
    bool inverted = false;  // true on the way down to the target: from the parent to the child
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

/// The pose of a moving track at a stamp is interpolate(poses[index], poses[index + 1], u), with
/// u outside [0, 1] for extrapolation only; a track of one sample has index 0 and u 0.
struct Selected {
    std::size_t index = 0;
    double u = 0.0;
    bool refused = false;  // the rule gives no pose at this stamp; index and u are then 0
};

/// One stamp, by binary search: the definition that the kernels must agree with.
Selected select_sample(const TrackView& track, const Rule& rule, StampNs stamp) noexcept;

}  // namespace tfdb::geometry
