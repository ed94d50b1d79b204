// The rules of track.hpp applied to blocks of stamps whose place in the track is already known.
#pragma once

#include <cstddef>
#include <cstdint>

#include "tfdb/geometry/locate.hpp"
#include "tfdb/geometry/track.hpp"

namespace tfdb::geometry {

/// What a block of stamps needs beyond the plain case.
struct BlockSelection {
    std::size_t refused = 0;
    bool outside = false;  // some stamp is extrapolated
};

/// As select_sample, with `index` as Locator::locate gives it, or 0 for a track of one sample.
Selected select_at(const TrackView& track, const Rule& rule, StampNs stamp,
                   std::size_t index) noexcept;

/// Weights by the rule for `count` stamps with index[i] as Locator::locate gives it (0 for tracks
/// of one sample). A refused stamp gets weight 0 and refused[i] = 1; other marks stay.
BlockSelection select_block(const TrackView& track, const Rule& rule, const StampNs* queries,
                            const std::uint32_t* index, std::size_t count, double* weights,
                            std::uint8_t* refused) noexcept;

/// True when every stamp between the samples `low` and `high`, which enclose the queries as far as
/// the track does, is plain interpolation and none can be refused: the fast kernels may be used.
bool is_plain(const TrackView& track, const Rule& rule, const QueryRange& queries, std::size_t low,
              std::size_t high) noexcept;

}  // namespace tfdb::geometry
