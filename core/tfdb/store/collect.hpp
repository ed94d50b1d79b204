// Copies of an edge's samples in plain memory: for batches, infos and dumps.
#pragma once

#include <cstdint>
#include <vector>

#include "tfdb/store/impl.hpp"

namespace tfdb::store {

/// One edge's visible samples in stamp order, each stamp once. A static edge has one pose and no
/// stamp.
struct Track {
    std::vector<StampNs> stamps;
    std::vector<Pose> poses;
    std::vector<FrameId> parents;
    std::vector<CommitNumber> commits;
    bool is_static = false;
};

/// Everything that the view retains of an edge.
[[nodiscard]] lookup::Outcome collect_all(const StoreView& view, FrameId id, Track& track);

/// What is needed for stamps in [first, last]: those samples, one more at either side of them, and
/// two more there so that the outermost pair stays the outermost pair of the edge.
/// `most` bounds the copy: kFailed if more samples than that would be needed.
[[nodiscard]] lookup::Outcome collect_window(const StoreView& view, FrameId id, StampNs first,
                                             StampNs last, std::size_t most, Track& track);

}  // namespace tfdb::store
