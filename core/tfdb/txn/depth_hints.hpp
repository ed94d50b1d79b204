// The depth of each frame in the tree: a hint for walks.
#pragma once

#include <cstdint>
#include <vector>

#include "tfdb/graph/frames.hpp"
#include "tfdb/history/layout.hpp"

namespace tfdb::txn {

/// Computes every frame's depth by the newest parents, and stores it as the frame's hint. `depths`
/// and `climb` are scratch. Only for the holder of the commit lock.
template <class Memory>
void refresh_depths(const graph::Frames<Memory>& frames, std::vector<std::uint32_t>& depths,
                    std::vector<FrameId>& climb) {
    using history::Topology;
    constexpr std::uint32_t kUnknown = ~std::uint32_t{0};
    const std::uint32_t count = frames.count();
    depths.assign(count, kUnknown);
    for (FrameId id = 0; id < count; ++id) {
        climb.clear();
        FrameId at = id;
        while (at < count && depths[at] == kUnknown && climb.size() <= count) {
            climb.push_back(at);
            at = Topology::parent(frames.topology(at));
        }
        std::uint32_t depth = at < count && depths[at] != kUnknown ? depths[at] + 1 : 0;
        for (; !climb.empty(); climb.pop_back(), ++depth) {
            depths[climb.back()] = depth;
            const std::uint64_t topology = frames.topology(climb.back());
            if (Topology::depth(topology) == depth)
                continue;
            // A reader of this word must see all that its flags describe, as with every other store
            // to it.
            frames.word(climb.back(), history::kTopology)
                .store_release(Topology::with_parent(topology, Topology::parent(topology), depth));
            frames.refresh_hint(climb.back());
        }
    }
}

}  // namespace tfdb::txn
