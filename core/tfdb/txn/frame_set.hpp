// A set of frames with O(1) `clear`, and a position for each frame.
#pragma once

#include <cstdint>
#include <vector>

#include "tfdb/base/types.hpp"

namespace tfdb::txn {

/// Threads: one. Guarantee: `contains`, `insert` and `clear` are O(1); it allocates only if a
/// frame's id is greater than all before.
class FrameSet {
public:
    void clear() { ++round_; }
    [[nodiscard]] bool contains(FrameId id) const {
        return id < entries_.size() && entries_[id].round == round_;
    }
    /// The position that `insert` stored for a frame.
    [[nodiscard]] std::uint32_t place(FrameId id) const { return entries_[id].place; }
    /// False: the frame is already in the set.
    bool insert(FrameId id, std::uint32_t place = 0) {
        make_room(id);
        Entry& entry = entries_[id];
        if (entry.round == round_)
            return false;
        entry = {round_, place};
        return true;
    }
    /// Allocates in advance, so that inserting frames up to this one does not.
    void make_room(FrameId id) {
        if (id >= entries_.size()) [[unlikely]]
            grow(id);
    }

private:
    struct Entry {
        std::uint64_t round = 0;  // of the last insertion
        std::uint32_t place = 0;
    };
    [[gnu::noinline]] void grow(FrameId id) {
        entries_.resize(std::size_t{id} + 1 + entries_.size() / 2);
    }

    std::vector<Entry> entries_;
    std::uint64_t round_ = 1;
};

}  // namespace tfdb::txn
