// A concurrent commit: samples for existing edges, under their frames' locks.
#pragma once

#include <span>
#include <vector>

#include "tfdb/engines/guarded_view.hpp"
#include "tfdb/graph/frames.hpp"
#include "tfdb/history/edge_writer.hpp"

namespace tfdb::txn {

/// Whether a sample has its edge's parent and kind. Such a sample adds no relation, so no path
/// changes and no cycle can close. The answer cannot change while all commits in progress only
/// append.
template <class Memory>
[[nodiscard]] bool fits_edge(const graph::Frames<Memory>& frames, FrameId child,
                             const history::NewSample<Memory>& sample) {
    using history::Topology;
    const history::EdgeSegments<Memory> edge(frames.memory(), frames.header(child));
    const std::uint64_t topology = edge.topology();
    return frames.alive(child, kSeesAll) && edge.has_samples() &&
           Topology::parent(topology) == sample.parent &&
           (topology & Topology::kMixedParents) == 0 &&
           edge.is_static() == (sample.stamp == history::kStaticStamp);
}

/// Whether a fitting sample is newer than all others. The frame is locked.
template <class Memory>
[[nodiscard]] bool fits_behind(const graph::Frames<Memory>& frames, FrameId child,
                               clock::StampNs stamp) {
    const history::EdgeSegments<Memory> edge(frames.memory(), frames.header(child));
    return stamp >= edge.newest_sample().stamp;
}

/// Samples for existing edges, ordered by edge, then by stamp.
template <class Memory>
struct PlainBatch {
    struct Place {
        FrameId child;
        FrameId parent;
        std::size_t index;
    };
    struct Item {
        FrameId child = kNoFrame;
        history::NewSample<Memory> sample;
        std::uint64_t author = 0;      // for `store`
        std::uint32_t normalised = 0;  // number of normalised quaternions
    };
    std::vector<Place> order;  // scratch for filling the batch
    std::vector<Item> items;
    std::vector<FrameId> frames;  // the written frames, ascending, without duplicates
};

/// Calls visit(edge, samples) for each edge of the items, which are ordered as in a PlainBatch.
template <class Memory, class Visit>
void for_each_edge(const graph::Frames<Memory>& frames,
                   std::span<const typename PlainBatch<Memory>::Item> items, Visit visit) {
    for (std::size_t first = 0, end = 0; first < items.size(); first = end) {
        while (end < items.size() && items[end].child == items[first].child)
            ++end;
        visit(history::EdgeWriter<Memory>(frames.memory(), frames.header(items[first].child)),
              items.subspan(first, end - first));
    }
}

/// Reserves space for appended samples before their commit gets a number: a refused commit takes
/// none. False: too many samples. The caller holds the frames for writing. Throws CapacityExceeded
/// and then changes no visible data.
template <class Memory>
[[nodiscard]] bool reserve_beside(const graph::Frames<Memory>& frames,
                                  const history::WriteContext& context,
                                  std::span<const typename PlainBatch<Memory>::Item> items) {
    bool fits = true;
    for_each_edge<Memory>(frames, items, [&](auto edge, const auto& samples) {
        fits = fits && edge.reserve(context, samples.size());
    });
    return fits;
}

/// Appends the samples that get memory. The caller must have held the frames for writing since
/// before `context` got its ticket.
template <class Memory>
void append_beside(const graph::Frames<Memory>& frames, const history::WriteContext& context,
                   std::span<const typename PlainBatch<Memory>::Item> items) {
    for_each_edge<Memory>(frames, items, [&](auto edge, const auto& samples) {
        for (const auto& item : samples)
            edge.append(context, item.sample);
    });
}

}  // namespace tfdb::txn
