// Copies of an edge's samples in plain memory: for infos and dumps.
#pragma once

#include <cstdint>
#include <vector>

#include "tfdb/store/store.hpp"

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

/// What an edge is like, in a few figures.
struct Outline {
    bool is_static = false;
    bool cleared = false;       // it had samples, and has none since a clear
    history::Extent extent;     // a static pose has no stamp
    FrameId parent = kNoFrame;  // that the newest sample names
    CommitNumber named = 0;     // in which commit
};

/// The outline of what the view retains of an edge. Its cost does not grow with the samples.
[[nodiscard]] lookup::Outcome outline(const StoreView& view, FrameId id, Outline& out);

/// Everything that the view retains of an edge.
[[nodiscard]] lookup::Outcome collect_all(const StoreView& view, FrameId id, Track& track);

}  // namespace tfdb::store
