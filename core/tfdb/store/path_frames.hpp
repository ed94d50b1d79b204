// The frames on which answers about a path depend: waits and watches look at them.
#pragma once

#include <bit>
#include <vector>

#include "tfdb/graph/frames.hpp"
#include "tfdb/history/layout.hpp"
#include "tfdb/lookup/walk.hpp"

namespace tfdb::store {

/// Special ids that waits can look at. No frame has these numbers.
inline constexpr FrameId kBirths = kNoFrame;       // frames that do not exist yet
inline constexpr FrameId kCommits = kNoFrame + 1;  // every commit

/// A frame of a state and its ancestors by newest parents, up to the root.
struct Chain {
    std::vector<FrameId> frames;
    /// The number of frames at the start whose samples name one parent; the parents of the others
    /// depend on the stamp.
    std::size_t sure = 0;
};

/// False: the state can no longer be read.
template <class View>
[[nodiscard]] bool climb(const View& view, FrameId from, Chain& chain) {
    using history::SlotWord;
    // A cycle reaches its mark again; the mark moves after 1, 2, 4 ... steps.
    FrameId mark = kNoFrame;
    FrameId at = from;
    bool sure = true;
    chain = {};
    for (std::uint32_t steps = 1; at != kNoFrame && at != mark; ++steps) {
        if (std::has_single_bit(steps))
            mark = at;
        chain.frames.push_back(at);
        typename View::Edge edge;
        if (!view.open(at, edge))
            return false;
        const history::SampleAt newest = edge.newest();
        const std::uint64_t slot = newest ? edge.slot_word(newest) : 0;
        sure = sure && edge.had_one_parent();
        chain.sure += sure ? 1 : 0;
        if (!edge.confirm())
            return false;
        const bool has_parent =
            newest && view.alive_since(SlotWord::parent(slot), SlotWord::commit(slot));
        // Alternatively, another frame may have the parent's slot by now.
        if (newest && !has_parent) {
            View::Memory::fence_acquire();
            if (view.frames().store_word(graph::kRecycleFloor).load_relaxed() > view.commit())
                return false;
        }
        at = has_parent ? SlotWord::parent(slot) : kNoFrame;
    }
    if (at != kNoFrame)
        chain.sure = 0;
    return true;
}

/// The frames whose edges form the path between two frames of a state: those below the meeting
/// point of both chains, or both chains if they do not meet. For a frame and itself: that frame. If
/// the path depends on the stamp: kCommits. False: the state can no longer be read.
template <class View>
[[nodiscard]] bool find_path(const View& view, FrameId target, FrameId source,
                             std::vector<FrameId>& frames) {
    Chain down;
    Chain up;
    if (!climb(view, target, down) || !climb(view, source, up))
        return false;
    if (lookup::cut_at_meeting(up.frames, down.frames)) {
        up.frames.pop_back();
        down.frames.pop_back();
    }
    frames.clear();
    for (const Chain* const chain : {&down, &up}) {
        if (chain->frames.size() > chain->sure) {
            frames.assign(1, kCommits);
            return true;
        }
        frames.insert(frames.end(), chain->frames.begin(), chain->frames.end());
    }
    if (frames.empty())
        frames.push_back(target);
    return true;
}

}  // namespace tfdb::store
