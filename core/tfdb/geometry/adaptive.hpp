// Simplification of a path: the samples that suffice to interpolate the rest.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "tfdb/geometry/pose.hpp"

namespace tfdb::geometry {

/// Ascending rows of a path. Interpolation between them stays within `metres` and `radians` of
/// interpolation between all rows, at every stamp. Each kept row is followed by the farthest one
/// that a single interpolation reaches among the next few; the first and the last row are always
/// kept. The stamps must be strictly ascending and not negative, the poses finite. The tolerances
/// must not be negative and may be infinite. Long work: see Interruption.
std::vector<std::size_t> enough_rows(std::span<const std::int64_t> stamps,
                                     std::span<const Pose> poses, double metres, double radians);

}  // namespace tfdb::geometry
