// Durations in logarithmic buckets: 64 to a doubling, so a percentile is off by 1.6 % at most.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>

namespace tfdb::driver {

// Counts of nanoseconds, from 0 to four hours; what is longer counts as four hours.
// Threads: one writes; `add` after the writers have ended.
// Guarantee: no call allocates.
class Histogram {
public:
    static constexpr unsigned kSubBits = 6;
    static constexpr unsigned kTopBit = 43;
    static constexpr std::uint64_t kPerDoubling = std::uint64_t{1} << kSubBits;
    static constexpr std::uint64_t kLongest = (std::uint64_t{1} << (kTopBit + 1)) - 1;
    static constexpr std::size_t kBuckets = (kTopBit - kSubBits + 2) * kPerDoubling;

    void record(std::int64_t nanos) noexcept {
        const auto value =
            std::min(nanos < 0 ? std::uint64_t{0} : static_cast<std::uint64_t>(nanos), kLongest);
        ++counts_[bucket_of(value)];
        ++total_;
        longest_ = std::max(longest_, value);
    }

    void add(const Histogram& other) noexcept {
        for (std::size_t i = 0; i < kBuckets; ++i) {
            counts_[i] += other.counts_[i];
        }
        total_ += other.total_;
        longest_ = std::max(longest_, other.longest_);
    }

    /// The value that the share `part` of all records does not exceed; 0 where there are none.
    [[nodiscard]] double percentile(double part) const noexcept {
        if (total_ == 0) {
            return 0.0;
        }
        const auto rank = std::clamp<std::uint64_t>(
            static_cast<std::uint64_t>(part * static_cast<double>(total_) + 0.5), 1, total_);
        std::uint64_t seen = 0;
        for (std::size_t i = 0; i < kBuckets; ++i) {
            seen += counts_[i];
            if (seen >= rank) {
                return std::min(middle_of(i), static_cast<double>(longest_));
            }
        }
        return static_cast<double>(longest_);
    }

    [[nodiscard]] std::uint64_t total() const noexcept { return total_; }
    [[nodiscard]] std::uint64_t longest() const noexcept { return longest_; }

    [[nodiscard]] static constexpr std::size_t bucket_of(std::uint64_t value) noexcept {
        if (value < kPerDoubling) {
            return value;
        }
        const auto shift = static_cast<unsigned>(std::bit_width(value)) - 1 - kSubBits;
        return (shift + 1) * kPerDoubling + ((value >> shift) - kPerDoubling);
    }

    [[nodiscard]] static constexpr double middle_of(std::size_t bucket) noexcept {
        if (bucket < kPerDoubling) {
            return static_cast<double>(bucket);
        }
        const auto shift = static_cast<unsigned>(bucket / kPerDoubling) - 1;
        const std::uint64_t low = (kPerDoubling + bucket % kPerDoubling) << shift;
        const std::uint64_t width = std::uint64_t{1} << shift;
        return static_cast<double>(low) + 0.5 * static_cast<double>(width - 1);
    }

private:
    std::array<std::uint64_t, kBuckets> counts_{};
    std::uint64_t total_ = 0;
    std::uint64_t longest_ = 0;
};

}  // namespace tfdb::driver
