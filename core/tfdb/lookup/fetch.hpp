// Prefetches a path's cache lines all at once. With active writers most of them are in another
// core's cache, and a lookup that loads them one by one waits for each.
#pragma once

#include <array>

#include "tfdb/graph/frames.hpp"
#include "tfdb/history/segment.hpp"
#include "tfdb/memory/memory.hpp"

namespace tfdb::lookup {

/// Prefetches the headers and newest samples of a path's first edges, as the hints show it; returns
/// the number of edges. Wrong hints only cost time.
template <memory::Fetchable Memory>
[[gnu::noinline]] unsigned fetch_path(const graph::Frames<Memory>& frames, FrameId target,
                                      FrameId source) {
    using history::SegmentWord;
    using history::Topology;
    // edges: at three lines each they fill half of a first-level cache
    constexpr unsigned kMost = 64;
    std::array<FrameId, kMost> edges;
    const Memory& memory = frames.memory();
    const std::uint32_t count = frames.max_frames();
    unsigned found = 0;
    std::uint64_t up = frames.hint(source);
    std::uint64_t down = frames.hint(target);
    while (source != target && found < kMost) {
        const bool move_up = Topology::depth(up) >= Topology::depth(down);
        FrameId& id = move_up ? source : target;
        std::uint64_t& hint = move_up ? up : down;
        memory.fetch(frames.header(id));
        edges[found++] = id;
        id = Topology::parent(hint);
        if (id >= count)
            break;
        hint = frames.hint(id);
    }
    for (unsigned i = 0; i < found; ++i) {
        const Offset header = frames.header(edges[i]);
        const std::uint64_t word = memory.word(header + 8 * history::kTail).load_relaxed();
        if (SegmentWord::count(word) == 0)
            continue;
        const history::Segment<Memory> tail(memory, word);
        memory.fetch(tail.stamp_offset(tail.end() - 1));
        memory.fetch(tail.slot(tail.end() - 1));
    }
    return found;
}

}  // namespace tfdb::lookup
