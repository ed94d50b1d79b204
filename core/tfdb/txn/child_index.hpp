// The children of each frame in one state, for removals.
#pragma once

#include <algorithm>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "tfdb/lookup/edge.hpp"
#include "tfdb/txn/snapshot_view.hpp"

namespace tfdb::txn {

/// The frames of one state, indexed by their newest parents.
/// Threads: a value; `build` may run in any thread, concurrently with writers.
/// Guarantee: lock-free; `build` is false if a writer overtook it.
class ChildIndex {
public:
    template <class Memory>
    [[nodiscard]] bool build(const SnapshotView<Memory>& view) {
        constexpr int kTries = 16;
        pairs_.clear();
        const std::uint32_t count = view.frame_count();
        for (FrameId id = 0; id < count; ++id) {
            if (!view.alive(id))
                continue;
            FrameId parent = kNoFrame;
            int tries = 0;
            while (lookup::parent_at(view, id, std::nullopt, parent) != lookup::Outcome::kOk) {
                if (++tries == kTries)
                    return false;
            }
            if (parent != kNoFrame)
                pairs_.emplace_back(parent, id);
        }
        std::sort(pairs_.begin(), pairs_.end());
        return true;
    }

    /// Appends the children of a frame, ascending.
    void append_children(FrameId parent, std::vector<FrameId>& out) const {
        auto at = std::lower_bound(pairs_.begin(), pairs_.end(), std::pair{parent, FrameId{0}});
        for (; at != pairs_.end() && at->first == parent; ++at)
            out.push_back(at->second);
    }

private:
    std::vector<std::pair<FrameId, FrameId>> pairs_;
};

}  // namespace tfdb::txn
