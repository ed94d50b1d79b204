// Finds the sample before each of many stamps: a cursor for sorted stamps, a bucket table for any
// others, a branch-free binary search where the table would be poor or not worth its making.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "tfdb/clock/stamp.hpp"

namespace tfdb::geometry {

using clock::StampNs;

/// What is known about the stamps of one call.
struct QueryRange {
    StampNs least = 0;
    StampNs greatest = 0;
    std::size_t count = 0;
    bool sorted = true;
};

QueryRange describe(std::span<const StampNs> queries) noexcept;

/// The greatest i with stamps[i] <= stamp, or 0 when there is none; size > 0.
std::size_t sample_before(const StampNs* stamps, std::size_t size, StampNs stamp) noexcept;

/// Prepared search in one track of at least two samples.
/// Threads: one at a time. Guarantee: blocking-free; `prepare` allocates when it meets a larger
/// track than before, the rest never does.
class Locator {
public:
    enum class Method : std::uint8_t { kCursor, kBuckets, kBinary };

    void prepare(const StampNs* stamps, std::size_t size, const QueryRange& queries);

    /// Starts sorted queries again from the beginning.
    void rewind() noexcept { cursor_ = low_; }

    /// index[i] = the greatest k <= size - 2 with stamps[k] <= queries[i], or 0. In stamp order
    /// from call to call when the queries of `prepare` were said to be sorted.
    void locate(const StampNs* queries, std::size_t count, std::uint32_t* index) noexcept;

    [[nodiscard]] Method method() const noexcept { return method_; }

    /// All queries lie between these two samples, or before the first or after the last one.
    [[nodiscard]] std::size_t low() const noexcept { return low_; }
    [[nodiscard]] std::size_t high() const noexcept { return high_; }

private:
    void walk(const StampNs* queries, std::size_t count, std::uint32_t* index) noexcept;
    bool make_table();
    template <int Steps>
    void look_up(const StampNs* queries, std::size_t count, std::uint32_t* index) const noexcept;
    void look_up_any(const StampNs* queries, std::size_t count,
                     std::uint32_t* index) const noexcept;
    void bisect(const StampNs* queries, std::size_t count, std::uint32_t* index) const noexcept;

    const StampNs* stamps_ = nullptr;
    std::size_t size_ = 0;
    std::size_t low_ = 0;
    std::size_t high_ = 0;
    std::size_t cursor_ = 0;
    std::vector<std::uint32_t> table_;
    unsigned shift_ = 0;
    int steps_ = 0;
    Method method_ = Method::kCursor;
};

}  // namespace tfdb::geometry
