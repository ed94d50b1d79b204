// Rows of poses as batch lookups return them.
#pragma once

#include <algorithm>
#include <limits>
#include <span>
#include <string>

#include "tfdb/geometry/pose.hpp"
#include "tfdb/store/buffer.hpp"

namespace tfdb::store {

[[nodiscard]] constexpr std::size_t row_width(Layout layout) {
    return layout == Layout::kMatrix ? 16 : 7;
}

/// Throws InvalidArgument if `out` has no room for a row of each stamp.
inline void check_room(std::span<const StampNs> stamps, Layout layout, std::span<double> out) {
    const std::size_t needed = row_width(layout) * stamps.size();
    if (out.size() < needed) {
        throw InvalidArgument("lookup_many needs room for " + std::to_string(needed) +
                              " numbers, not " + std::to_string(out.size()));
    }
}

/// One row; NaN where there is no pose.
inline void write_row(const Pose* pose, Layout layout, double* row) {
    std::fill_n(row, row_width(layout), std::numeric_limits<double>::quiet_NaN());
    if (pose == nullptr)
        return;
    if (layout == Layout::kPose) {
        std::copy_n(&pose->translation.x, 3, row);
        std::copy_n(&pose->rotation.x, 4, row + 3);
        return;
    }
    for (int column = 0; column < 3; ++column) {
        const geometry::Vec3 axis{column == 0 ? 1.0 : 0.0, column == 1 ? 1.0 : 0.0,
                                  column == 2 ? 1.0 : 0.0};
        const geometry::Vec3 turned = geometry::rotate(pose->rotation, axis);
        row[column] = turned.x;
        row[4 + column] = turned.y;
        row[8 + column] = turned.z;
    }
    row[3] = pose->translation.x;
    row[7] = pose->translation.y;
    row[11] = pose->translation.z;
    row[12] = row[13] = row[14] = 0.0;
    row[15] = 1.0;
}

}  // namespace tfdb::store
