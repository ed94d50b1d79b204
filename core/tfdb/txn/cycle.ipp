// Commit: no frame may be its own ancestor at any time.
//
// A sample names its edge's parent from its stamp to the edge's next sample (a static edge: for all
// time). A new sample closes a cycle if, somewhere in that interval, a walk from its parent upward
// comes to its child. The walk splits the interval where a frame on the way changes its parent.
#pragma once

#include <algorithm>
#include <limits>
#include <vector>

#include "tfdb/txn/commit.hpp"

namespace tfdb::txn {

namespace detail {
inline constexpr clock::StampNs kDawn = std::numeric_limits<clock::StampNs>::min();
inline constexpr clock::StampNs kDusk = std::numeric_limits<clock::StampNs>::max();
}  // namespace detail

/// A cycle needs its child to be somebody's parent already. Relations are looked at in the order in
/// which they came, so of a chain that is built from its root no frame is one yet: the last
/// relation that closes a cycle always finds the others in place.
template <class Memory>
bool Commit<Memory>::find_cycle(Cycle& cycle) {
    using history::Topology;
    for (const auto& relation : scratch_.relations) {
        if ((frames_.topology(relation.child) & Topology::kParented) != 0 &&
            reaches(relation, cycle)) {
            return true;
        }
        auto& topology = frames_.word(relation.parent, history::kTopology);
        const std::uint64_t word = topology.load_relaxed();
        if ((word & Topology::kParented) == 0)
            topology.store_release(word | Topology::kParented);
    }
    return false;
}

/// The interval in which the relation's parent holds. False if it never does: the sample is too old
/// to be seen, or a later member of the same batch replaced it.
template <class Memory>
bool Commit<Memory>::holds(const CommitScratch::Relation& relation, StampNs& from,
                           StampNs& to) const {
    const auto names_parent = [&](const history::EdgeView<Memory>& edge, std::uint64_t index) {
        // Not an earlier frame whose slot the parent took over.
        const std::uint64_t slot = edge.slot_word(index);
        return history::SlotWord::parent(slot) == relation.parent &&
               view().alive_since(relation.parent, history::SlotWord::commit(slot));
    };
    from = detail::kDawn;
    to = detail::kDusk;
    history::EdgeView<Memory> edge;
    history::Bracket around;
    if (!view().open(relation.child, edge)) {
        return false;
    }
    if (relation.stamp < 0) {
        return names_parent(edge, edge.static_index());
    }
    if (!edge.bracket(relation.stamp, around)) {
        return false;
    }
    if (around.before == history::kNoIndex) {
        // Too old by now; but what follows it may stand on its word.
        around.before = around.after;
        around.before_stamp = around.after_stamp;
        if (around.before == history::kNoIndex || !edge.bracket(around.before_stamp, around)) {
            return false;
        }
    } else if (around.before_stamp != relation.stamp) {
        return false;
    }
    if (!names_parent(edge, around.before)) {
        return false;
    }
    from = around.before_stamp;
    if ((edge.topology() & history::Topology::kMixedParents) == 0) {
        return true;
    }
    // Later samples that name the same parent are not looked at by themselves.
    while (around.after != history::kNoIndex && names_parent(edge, around.after)) {
        if (!edge.bracket(around.after_stamp, around)) {
            return false;
        }
    }
    if (around.after != history::kNoIndex) {
        to = around.after_stamp;
    }
    return true;
}

template <class Memory>
bool Commit<Memory>::reaches(const CommitScratch::Relation& relation, Cycle& cycle) {
    StampNs from = 0;
    StampNs to = 0;
    if (!holds(relation, from, to)) {
        return false;
    }
    auto& stops = scratch_.stops;
    stops.assign(1, {relation.parent, from, to, 1});
    const std::uint32_t bound = frames_.count() + 1;
    while (!stops.empty()) {
        const auto at = stops.back();
        stops.pop_back();
        if (at.id == relation.child || at.depth > bound) {
            cycle.child = relation.child;
            cycle.parent = relation.parent;
            cycle.item = relation.item;
            return true;
        }
        push_parents(at);
    }
    return false;
}

template <class Memory>
void Commit<Memory>::push_stop(FrameId parent, CommitNumber written, StampNs from, StampNs to,
                               std::uint32_t depth) {
    if (from < to && view().alive_since(parent, written)) {
        scratch_.stops.push_back({parent, from, to, depth});
    }
}

template <class Memory>
void Commit<Memory>::push_parents(const CommitScratch::Stop& at) {
    history::EdgeView<Memory> edge;
    if (!view().open(at.id, edge) || edge.empty())
        return;
    if (edge.is_static()) {
        const std::uint64_t slot = edge.slot_word(edge.static_index());
        push_stop(history::SlotWord::parent(slot), history::SlotWord::commit(slot), at.from, at.to,
                  at.depth + 1);
        return;
    }
    if ((edge.topology() & history::Topology::kMixedParents) != 0) {
        push_mixed_parents(edge, at);
        return;
    }
    std::uint64_t oldest = 0;
    StampNs since = 0;
    if (!edge.oldest(oldest, since) || oldest == history::kNoIndex)
        return;
    const std::uint64_t slot = edge.slot_word(oldest);
    push_stop(history::SlotWord::parent(slot), history::SlotWord::commit(slot),
              std::max(at.from, since), at.to, at.depth + 1);
}

template <class Memory>
void Commit<Memory>::push_mixed_parents(const history::EdgeView<Memory>& edge,
                                        const CommitScratch::Stop& at) {
    StampNs since = 0;
    std::uint64_t index = 0;
    if (!edge.oldest(index, since))
        return;
    while (index != history::kNoIndex) {
        history::Bracket around;
        if (!edge.bracket(since, around))
            return;
        const StampNs until =
            around.after == history::kNoIndex ? detail::kDusk : around.after_stamp;
        const std::uint64_t slot = edge.slot_word(index);
        push_stop(history::SlotWord::parent(slot), history::SlotWord::commit(slot),
                  std::max(at.from, since), std::min(at.to, until), at.depth + 1);
        index = around.after;
        since = around.after_stamp;
    }
}

}  // namespace tfdb::txn
