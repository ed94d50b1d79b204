// A commit beside others: samples for edges that are there, under their frames' locks.
#pragma once

#include <vector>

#include "tfdb/graph/frames.hpp"
#include "tfdb/history/edge_view.hpp"
#include "tfdb/history/edge_writer.hpp"
#include "tfdb/txn/guarded_view.hpp"

namespace tfdb::txn {

/// Whether parent and kind of a sample are those that its edge has already. Such a sample relates
/// no frames anew, so nobody's path changes and no cycle can close. What this asks cannot change
/// while commits that append are the only ones under way.
template <class Memory>
[[nodiscard]] bool fits_edge(const graph::Frames<Memory>& frames, FrameId child,
                             const history::NewSample<Memory>& sample) {
    using history::Topology;
    const history::EdgeWriter<Memory> edge(frames.memory(), frames.header(child));
    const std::uint64_t topology = edge.topology();
    return frames.alive(child, kSeesAll) && edge.has_samples() &&
           Topology::parent(topology) == sample.parent &&
           (topology & Topology::kMixedParents) == 0 &&
           ((topology & Topology::kStatic) != 0) == (sample.stamp == history::kStaticStamp);
}

/// Whether a moving sample that fits its edge may also go by its stamp: ahead of all others, or
/// between those that the edge retains. The frame is locked.
template <class Memory>
[[nodiscard]] bool fits_history(const graph::Frames<Memory>& frames, FrameId child,
                                clock::StampNs stamp, clock::StampNs history) {
    const history::EdgeWriter<Memory> writer(frames.memory(), frames.header(child));
    if (stamp > writer.newest())
        return true;
    if ((writer.topology() & history::Topology::kCleared) != 0)
        return false;
    history::EdgeView<Memory> edge;
    std::uint64_t index = history::kNoIndex;
    clock::StampNs oldest = 0;
    return edge.open(frames.memory(), frames.header(child), kSeesAll, history) &&
           edge.oldest(index, oldest) && index != history::kNoIndex && oldest <= stamp;
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
        bool mended = false;  // for whoever counts that
    };
    std::vector<Place> order;  // scratch of whoever fills the batch
    std::vector<Item> items;
    std::vector<FrameId> frames;  // those written, ascending, each once
};

/// An edge that a commit has written to, and how it was.
struct TouchedEdge {
    FrameId id = kNoFrame;
    history::EdgeUndo undo;
};

/// Appends under the locks of the written frames, tagged with a ticket. The destructor takes off
/// what was not kept.
/// Threads: one, which holds the written frames for writing from before the ticket was taken until
/// after the destructor. Guarantee: all or nothing, also when a call throws.
template <class Memory>
class ParallelCommit {
public:
    /// `ask_oldest` as in txn::Commit; `touched` is scratch memory.
    ParallelCommit(const graph::Frames<Memory>& frames, std::vector<TouchedEdge>& touched,
                   clock::StampNs history, CommitNumber ticket,
                   CommitNumber (*ask_oldest)(void* store), void* store)
        : frames_(frames), touched_(touched) {
        touched_.clear();
        context_.committed = ticket - 1;
        context_.history = history;
        context_.ask_oldest = ask_oldest;
        context_.store = store;
    }
    ~ParallelCommit() {
        for (const TouchedEdge& touched : touched_)
            writer(touched.id).undo(touched.undo);
    }
    ParallelCommit(const ParallelCommit&) = delete;
    ParallelCommit& operator=(const ParallelCommit&) = delete;

    /// The samples of one edge come one after another, in stamp order, and fit it.
    void append(FrameId child, const history::NewSample<Memory>& sample) {
        if (touched_.empty() || touched_.back().id != child) {
            TouchedEdge& touched = touched_.emplace_back();
            touched.id = child;
            writer(child).save(touched.undo);
        }
        writer(child).append(context_, sample);
    }
    void keep() { touched_.clear(); }

private:
    [[nodiscard]] history::EdgeWriter<Memory> writer(FrameId id) const {
        return {frames_.memory(), frames_.header(id)};
    }

    const graph::Frames<Memory>& frames_;
    std::vector<TouchedEdge>& touched_;
    history::WriteContext context_;
};

}  // namespace tfdb::txn
