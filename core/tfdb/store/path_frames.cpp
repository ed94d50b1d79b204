#include "tfdb/store/path_frames.hpp"

#include <bit>

#include "tfdb/lookup/walk.hpp"

namespace tfdb::store {

using history::SlotWord;

bool climb(const StoreView& view, FrameId from, Chain& chain) {
    // A circle comes by its mark again, which is set anew after 1, 2, 4 ... steps.
    FrameId mark = kNoFrame;
    FrameId at = from;
    bool sure = true;
    chain = {};
    for (std::uint32_t steps = 1; at != kNoFrame && at != mark; ++steps) {
        if (std::has_single_bit(steps))
            mark = at;
        chain.frames.push_back(at);
        StoreEdge edge;
        if (!view.open(at, edge))
            return false;
        const history::SampleAt newest = edge.newest();
        const std::uint64_t slot = newest ? edge.slot_word(newest) : 0;
        sure = sure && edge.had_one_parent();
        chain.sure += sure ? 1 : 0;
        if (!edge.confirm())
            return false;
        const bool hangs =
            newest && view.alive_since(SlotWord::parent(slot), SlotWord::commit(slot));
        // Or is the parent's slot another frame's by now?
        if (newest && !hangs) {
            StoreMemory::fence_acquire();
            if (view.frames().store_word(graph::kRecycleFloor).load_relaxed() > view.commit())
                return false;
        }
        at = hangs ? SlotWord::parent(slot) : kNoFrame;
    }
    if (at != kNoFrame)
        chain.sure = 0;
    return true;
}

bool find_path(const StoreView& view, FrameId target, FrameId source,
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
