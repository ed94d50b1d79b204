// Poses of a whole path of edges at many stamps, and points each moved at its own stamp.
//
// The caller copies each edge's window of samples into plain memory under one snapshot and hands
// over both sides of the path: from the source s and from the target g upward to the meeting point
// m, with s under a under m and g under b under m:
//
//     source side: tracks of s, a        target side: tracks of g, b
//
// A path without edges is the identity. Stamps may have any order; sorted ones are found faster.
// The poses are, bit for bit, those of slerp.hpp and pose.hpp composed edge by edge: upward on each
// side, then one side with the inverse of the other.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <span>

#include "tfdb/geometry/track.hpp"

namespace tfdb::geometry {

inline constexpr std::size_t kNoneRefused = std::numeric_limits<std::size_t>::max();

enum class PoseLayout : std::uint8_t {
    kPose,    // 7 doubles a row: x y z qx qy qz qw
    kMatrix,  // 16 doubles a row: the 4 x 4 matrix, row-major
};

/// What to do when the rule gives an edge no pose at a stamp.
enum class OnRefused : std::uint8_t {
    kStop,  // write nothing at all; the result names the first such stamp
    kNan,   // fill its row with NaN and go on
};

enum class KernelChoice : std::uint8_t {
    kBest,      // AVX2 where the processor has it
    kPortable,  // the same algorithm in plain C++
};

struct BatchResult {
    std::size_t first_refused = kNoneRefused;  // smallest index of a refused stamp
    std::size_t refused = 0;                   // how many; with kStop 0 or 1
};

/// Working memory of the functions below; keep one and pass it again to save the allocations.
/// Threads: one call at a time per object. Guarantee: blocking-free; grows to the largest call.
class BatchScratch {
public:
    explicit BatchScratch(KernelChoice choice = KernelChoice::kBest);
    ~BatchScratch();
    BatchScratch(BatchScratch&&) noexcept;
    BatchScratch& operator=(BatchScratch&&) noexcept;

    /// "avx2" or "portable".
    [[nodiscard]] const char* kernel_name() const noexcept;

    struct State;
    [[nodiscard]] State& state() noexcept { return *state_; }

private:
    std::unique_ptr<State> state_;
};

/// Rows of T[target<-source] at the stamps into `out`: stamps.size() rows without padding.
BatchResult evaluate_poses(const Path& path, const Rule& rule, std::span<const StampNs> stamps,
                           PoseLayout layout, double* out, OnRefused on_refused,
                           BatchScratch& scratch);

/// Rows of three coordinates. Real is float, double, const float or const double.
template <class Real>
struct PointRows {
    Real* data = nullptr;
    std::ptrdiff_t stride = 3;  // from row to row, in numbers
};

/// out[i] = T[target<-source](stamps[i]) * in[i] for `count` points. One stamp for all points is
/// allowed: stamps.size() is `count` or 1. In place when `in` and `out` are the same rows; rows
/// that overlap otherwise are not supported. The arithmetic is in double also for float.
BatchResult transform_points(const Path& path, const Rule& rule, std::span<const StampNs> stamps,
                             std::size_t count, PointRows<const double> in, PointRows<double> out,
                             OnRefused on_refused, BatchScratch& scratch);
BatchResult transform_points(const Path& path, const Rule& rule, std::span<const StampNs> stamps,
                             std::size_t count, PointRows<const float> in, PointRows<float> out,
                             OnRefused on_refused, BatchScratch& scratch);

/// out[i] = pose * in[i].
void transform_points(const Pose& pose, std::size_t count, PointRows<const double> in,
                      PointRows<double> out, BatchScratch& scratch);
void transform_points(const Pose& pose, std::size_t count, PointRows<const float> in,
                      PointRows<float> out, BatchScratch& scratch);

/// The smallest index of a stamp at which some edge of the path is refused, or kNoneRefused.
std::size_t first_refused(const Path& path, const Rule& rule, std::span<const StampNs> stamps,
                          BatchScratch& scratch);

}  // namespace tfdb::geometry
