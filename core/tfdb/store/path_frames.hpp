// The frames on which answers about a path depend: what waits and watches look at.
#pragma once

#include <vector>

#include "tfdb/store/store.hpp"

namespace tfdb::store {

/// What is looked at beside frames. No frame has these numbers.
inline constexpr FrameId kBirths = kNoFrame;       // frames that are not there yet
inline constexpr FrameId kCommits = kNoFrame + 1;  // every commit

/// A frame of a state and all above it by their newest parents, up to the root.
struct Chain {
    std::vector<FrameId> frames;
    /// So many of them, from the first on, have samples of one parent; that of others depends on
    /// the stamp.
    std::size_t sure = 0;
};

/// False: the state can be read no more.
[[nodiscard]] bool climb(const StoreView& view, FrameId from, Chain& chain);

/// The frames whose edges are the path between two frames of a state: those below where both chains
/// meet, or both chains where they do not. Of a frame and itself: that frame. Where it depends on
/// the stamp: kCommits. False: the state can be read no more.
[[nodiscard]] bool find_path(const StoreView& view, FrameId target, FrameId source,
                             std::vector<FrameId>& frames);

}  // namespace tfdb::store
