// Which samples of a path are enough to interpolate the rest.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "tfdb/geometry/pose.hpp"

namespace tfdb::geometry {

/// Rows of a path, rising, that keep what is interpolated between them within `metres` and
/// `radians` of what is interpolated between all of them, at every stamp. From each row on to the
/// farthest that one interpolation reaches, of the next few; the first and the last are among them.
/// The stamps rise strictly and are not negative, the poses are finite, the tolerances are not
/// negative and may be infinite. Long work: see Interruption.
std::vector<std::size_t> enough_rows(std::span<const std::int64_t> stamps,
                                     std::span<const Pose> poses, double metres, double radians);

}  // namespace tfdb::geometry
