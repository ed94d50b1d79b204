// How an edge's samples determine the pose at a stamp.
#pragma once

#include <cstdint>
#include <limits>

#include "tfdb/clock/stamp.hpp"

namespace tfdb::lookup {

using clock::StampNs;

enum class PolicyKind : std::uint8_t {
    kInterpolate,  // linear and slerp between the samples around the stamp; limit = max gap
    kExact,        // only a stored stamp
    kPrevious,     // newest sample at or before the stamp; limit = max age
    kNearest,      // closest sample; limit = tolerance
    kExtrapolate,  // interpolate; beyond the ends, for at most `limit`, at constant velocity
    kLatest,       // each edge's own newest sample, at any stamp
};

inline constexpr StampNs kNoLimit = std::numeric_limits<StampNs>::max() / 4;

/// A time policy. `limit` in ns; its meaning depends on the kind.
struct Policy {
    PolicyKind kind = PolicyKind::kInterpolate;
    StampNs limit = kNoLimit;
};

}  // namespace tfdb::lookup
