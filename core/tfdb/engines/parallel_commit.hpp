// A commit beside others: samples for edges that are there, under their frames' locks.
#pragma once

#include <span>
#include <vector>

#include "tfdb/engines/guarded_view.hpp"
#include "tfdb/graph/frames.hpp"
#include "tfdb/history/edge_writer.hpp"

namespace tfdb::txn {

/// Whether parent and kind of a sample are those that its edge has already. Such a sample relates
/// no frames anew, so no path changes and no cycle can close. What this asks cannot change
/// while commits that append are the only ones under way.
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

/// Whether a sample that fits its edge goes behind all others. The frame is locked.
template <class Memory>
[[nodiscard]] bool fits_behind(const graph::Frames<Memory>& frames, FrameId child,
                               clock::StampNs stamp) {
    const history::EdgeSegments<Memory> edge(frames.memory(), frames.header(child));
    return stamp >= edge.newest_sample().stamp;
}

/// Samples for edges that are there: each edge's one after another in stamp order, edges ascending.
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
        std::uint64_t author = 0;  // for `store`
        std::uint32_t mended = 0;  // how many quaternions were normalised
    };
    std::vector<Place> order;  // scratch for filling the batch
    std::vector<Item> items;
    std::vector<FrameId> frames;  // those written, ascending, each once
};

/// Calls visit(edge, samples) for each edge of the items, which come as in a PlainBatch.
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

/// Makes room for samples that go behind all others, before their commit has a number: what is
/// refused counts as no commit. False: they are too many. The caller holds the frames for writing.
/// Throws CapacityExceeded, having changed nothing that counts.
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

/// Appends the samples that find memory. The caller holds the frames for writing, from
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
