// How many samples a store with a limited history no longer has of what was written to it.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <string>
#include <string_view>
#include <unordered_map>

#include "tfdb/clock/stamp.hpp"

namespace tfdb {

/// Counts the samples of moving edges that a history forgets, from their stamps in the order of
/// writing. Repeats of a stamp that is still retained count once. Its memory grows with the samples
/// that the history retains, not with those that it forgets.
/// Threads: one. Guarantee: none is counted where memory runs out.
class Forgotten {
public:
    explicit Forgotten(clock::StampNs history) : history_(history) {}

    /// A sample was stored.
    void stored(std::string_view child, clock::StampNs stamp);
    /// A sample was refused with TooOld.
    void refused() { ++count_; }

    [[nodiscard]] std::uint64_t count() const { return count_; }

private:
    struct Hash {
        using is_transparent = void;
        std::size_t operator()(std::string_view name) const {
            return std::hash<std::string_view>{}(name);
        }
    };
    /// Sorted, each once.
    using Stamps = std::deque<clock::StampNs>;

    clock::StampNs history_;
    std::unordered_map<std::string, Stamps, Hash, std::equal_to<>> edges_;
    std::uint64_t count_ = 0;
};

}  // namespace tfdb
