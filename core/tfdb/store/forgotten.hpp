// Counts the samples written to a store that its limited history no longer has.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <string>
#include <string_view>
#include <unordered_map>

#include "tfdb/clock/stamp.hpp"

namespace tfdb {

/// Counts the evicted samples of moving edges, from their stamps in write order. Repeats of a
/// retained stamp count once. Its memory grows with the retained samples, not with the evicted
/// ones.
/// Threads: one. Guarantee: a sample is not counted if memory runs out.
class Forgotten {
public:
    explicit Forgotten(clock::StampNs history) : history_(history) {}

    /// Call after a sample was stored.
    void stored(std::string_view child, clock::StampNs stamp);
    /// Call after a sample was refused with TooOld.
    void refused() { ++count_; }

    [[nodiscard]] std::uint64_t count() const { return count_; }

private:
    struct Hash {
        using is_transparent = void;
        std::size_t operator()(std::string_view name) const {
            return std::hash<std::string_view>{}(name);
        }
    };
    /// Sorted, without duplicates.
    using Stamps = std::deque<clock::StampNs>;

    clock::StampNs history_;
    std::unordered_map<std::string, Stamps, Hash, std::equal_to<>> edges_;
    std::uint64_t count_ = 0;
};

}  // namespace tfdb
