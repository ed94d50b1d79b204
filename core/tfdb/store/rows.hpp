// Rows of poses as batch lookups return them.
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>
#include <span>
#include <string>

#include "tfdb/geometry/pose.hpp"
#include "tfdb/store/buffer.hpp"

namespace tfdb::store {

[[nodiscard]] constexpr std::size_t row_width(Layout layout) {
    return layout == Layout::kMatrix ? 16 : 7;
}

/// A memory range: its first byte and the one behind its last.
struct Bytes {
    std::uintptr_t begin, end;
};

template <class Value>
[[nodiscard]] Bytes bytes_of(std::span<Value> values) {
    const auto begin = reinterpret_cast<std::uintptr_t>(values.data());
    return {begin, begin + values.size_bytes()};
}

/// Rows of three numbers, `stride` numbers apart.
template <class Number>
[[nodiscard]] Bytes bytes_of_rows(const Number* first, std::size_t stride, std::size_t count) {
    return bytes_of(std::span(first, count == 0 ? 0 : stride * (count - 1) + 3));
}

/// Throws InvalidArgument if writing to `out` would change `input` before it is read.
inline void check_apart(Bytes input, Bytes out, const char* what) {
    if (input.begin < out.end && out.begin < input.end) {
        throw InvalidArgument(std::string("out overlaps ") + what +
                              " in memory: results would overwrite unread input");
    }
}

/// Throws InvalidArgument if `out` has no space for a row per stamp, or overlaps the stamps.
inline void check_room(std::span<const StampNs> stamps, Layout layout, std::span<double> out) {
    const std::size_t needed = row_width(layout) * stamps.size();
    if (out.size() < needed) {
        throw InvalidArgument("out of lookup_many must have space for " + std::to_string(needed) +
                              " numbers, not " + std::to_string(out.size()));
    }
    check_apart(bytes_of(stamps), bytes_of(out), "the stamps");
}

/// Throws InvalidArgument unless each point has a stamp or all share one, and `out` is the points
/// themselves or overlaps neither them nor the stamps.
template <class Real>
void check_points(const Real* points, std::size_t stride, std::size_t count,
                  std::span<const StampNs> stamps, const Real* out, std::size_t out_stride) {
    if (stamps.size() != count && stamps.size() != 1) {
        throw InvalidArgument("transform_points takes one stamp for each of the " +
                              std::to_string(count) + " points or one for all, not " +
                              std::to_string(stamps.size()));
    }
    check_apart(bytes_of(stamps), bytes_of_rows(out, out_stride, count), "the stamps");
    if (points != out || stride != out_stride) {
        check_apart(bytes_of_rows(points, stride, count), bytes_of_rows(out, out_stride, count),
                    "the points");
    }
}

/// A long batch can be interrupted after this number of edges.
inline constexpr std::size_t kEdgesBetweenEnds = 256;

/// Throws InvalidArgument if `out` has no space for a row per frame.
template <class Real>
void check_room(std::span<const FrameRef> frames, std::span<Real> out) {
    const std::size_t needed = 7 * frames.size();
    if (out.size() < needed) {
        throw InvalidArgument("out of lookup_edges must have space for " + std::to_string(needed) +
                              " numbers, not " + std::to_string(out.size()));
    }
}

/// Throws the typed error of a failed question of a batch, with its index.
template <class Asked>
[[noreturn]] void raise_at(const Asked& asked, const Failure& failure, const Question& question,
                           std::size_t index) {
    try {
        asked.raise(failure, question);
    } catch (Error& error) {
        error.detail().index = index;
        throw;
    }
}

/// One row of 7; NaN without a pose.
template <class Real>
void write_row(const Pose* pose, Real* row) {
    if (pose == nullptr) {
        std::fill_n(row, 7, std::numeric_limits<Real>::quiet_NaN());
        return;
    }
    const auto put = [](double number) { return static_cast<Real>(number); };
    std::transform(&pose->translation.x, &pose->translation.x + 3, row, put);
    std::transform(&pose->rotation.x, &pose->rotation.x + 4, row + 3, put);
}

/// One row; NaN without a pose.
inline void write_row(const Pose* pose, Layout layout, double* row) {
    if (layout == Layout::kPose)
        return write_row(pose, row);
    std::fill_n(row, row_width(layout), std::numeric_limits<double>::quiet_NaN());
    if (pose == nullptr)
        return;
    const geometry::MatrixOf<double> turn = geometry::matrix(pose->rotation);
    for (int i = 0; i < 3; ++i)
        std::copy_n(turn.m + 3 * i, 3, row + 4 * i);
    row[3] = pose->translation.x;
    row[7] = pose->translation.y;
    row[11] = pose->translation.z;
    row[12] = row[13] = row[14] = 0.0;
    row[15] = 1.0;
}

}  // namespace tfdb::store
