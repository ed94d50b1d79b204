// A set of frames that is emptied at once.
#pragma once

#include <cstdint>
#include <vector>

#include "tfdb/base/types.hpp"

namespace tfdb::txn {

/// Threads: one. Guarantee: `contains`, `insert` and `clear` are O(1); memory is asked for only
/// where a frame has a greater id than all before.
class FrameSet {
public:
    void clear() { ++round_; }
    [[nodiscard]] bool contains(FrameId id) const {
        return id < rounds_.size() && rounds_[id] == round_;
    }
    /// False: it was there.
    bool insert(FrameId id) {
        if (contains(id))
            return false;
        if (id >= rounds_.size())
            rounds_.resize(std::size_t{id} + 1 + rounds_.size() / 2);
        rounds_[id] = round_;
        return true;
    }

private:
    std::vector<std::uint64_t> rounds_;  // in which each was inserted last
    std::uint64_t round_ = 1;
};

}  // namespace tfdb::txn
