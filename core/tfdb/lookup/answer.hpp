// The result of a lookup: the pose, and the samples used on each edge.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tfdb/base/error.hpp"
#include "tfdb/base/types.hpp"
#include "tfdb/clock/stamp.hpp"
#include "tfdb/geometry/pose.hpp"

namespace tfdb::lookup {

using clock::StampNs;

/// A frame's slot plus its generation, which make it unique. Cheap to keep and to compare.
struct FrameHandle {
    FrameId id = kNoFrame;
    std::uint32_t generation = 0;

    friend bool operator==(const FrameHandle&, const FrameHandle&) = default;
};

/// How an edge's pose was computed.
enum class Used : std::uint8_t {
    kStatic,
    kExact,         // a stored sample at exactly this stamp
    kInterpolated,  // between `before` and `after`
    kHeld,          // the sample at or before the stamp, unchanged
    kNearest,       // the closest sample
    kExtrapolated,  // beyond the samples
    kLatest,        // the newest sample
};

/// One edge of a path, with the samples used.
struct EdgeUse {
    FrameId child = kNoFrame;
    FrameId parent = kNoFrame;
    std::uint32_t generation = 0;  // of the child's slot in the frame table
    std::uint32_t parent_generation = 0;
    StampNs before = -1;  // stamps used; -1 for a static edge
    StampNs after = -1;   // equal to `before` if only one sample was used
    Used used = Used::kStatic;
    bool inverted = false;  // the path goes from the parent to the child
};

/// A successful lookup: `pose` is T[target<-source] at `stamp` in snapshot `commit`.
/// `edges` lists the source's side upward, then the target's side upward.
struct Answer {
    geometry::Pose pose;
    StampNs stamp = 0;
    CommitNumber commit = 0;
    StampNs oldest = 0;                 // oldest stamp that the path covers: see covered_stamps
    std::vector<EdgeUse> edges;         // kept between lookups to avoid allocation
    std::vector<FrameId> source_chain;  // the source and its ancestors, scratch memory of the walk
    std::vector<FrameId> target_chain;
    std::vector<EdgeUse> target_edges;
};

/// The part of a lookup through a fixed frame that failed.
enum class Half : std::uint8_t {
    kWhole,   // not a lookup through a fixed frame
    kSource,  // T[fixed<-source]
    kTarget,  // T[target<-fixed]
};

/// Why a lookup failed. It never allocates: programs probe, so failures must be cheap.
struct Failure {
    ErrorCode code = ErrorCode::kUnknownFrame;
    FrameHandle frame;   // the edge's child, or the target's root
    FrameHandle other;   // the edge's parent, or the source's root
    FrameHandle edge;    // if two trees: child of an edge without data at the stamp ...
    FrameHandle parent;  // ... and its parent
    Half half = Half::kWhole;
    int argument = 0;   // position of an unknown frame's argument: 0 target, 1 source, 2 fixed
    int direction = 0;  // -1 past, 1 future, 0 no data
    StampNs stamp = -1;
    StampNs oldest = -1;
    StampNs newest = -1;
    StampNs before = -1;
    StampNs after = -1;
    StampNs limit = -1;
    // owned by the store: the name whose lifespan has ended
    const std::string* expectation = nullptr;
    CommitNumber commit = 0;
};

}  // namespace tfdb::lookup
