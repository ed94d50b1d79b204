// One edge of a path: its parent at a stamp, its pose, and the reason for a failure.
#pragma once

#include <bit>
#include <optional>
#include <utility>

#include "tfdb/geometry/slerp.hpp"
#include "tfdb/lookup/select.hpp"
#include "tfdb/lookup/view.hpp"

namespace tfdb::lookup {

/// Whether a walk follows only edges that answer at the stamp, or all edges. Outside its samples an
/// edge has the parent of the nearest sample, so that the error can name the edge.
enum class Edges : std::uint8_t { kAnswering, kAll };

/// A frame's parent at a stamp.
struct NearestParent {
    FrameId parent = kNoFrame;  // kNoFrame: a root
    bool later = false;         // named by a sample after the stamp
};

/// A frame's parent at a stamp according to the view's samples.
template <View V>
[[nodiscard]] Outcome exact_parent(const V& view, FrameId id, StampNs stamp, const Policy& policy,
                                   Edges edges, NearestParent& nearest) {
    nearest = NearestParent{};
    typename V::Edge edge;
    if (!view.open(id, edge))
        return Outcome::kLapped;
    Selection chosen;
    if (!select(edge, stamp, policy, chosen))
        return Outcome::kLapped;
    std::uint64_t slot = 0;
    if (chosen.anchor)
        slot = edge.slot_word(chosen.anchor);
    if (!edge.confirm())
        return Outcome::kLapped;
    if (!chosen.anchor || (chosen.refused && edges == Edges::kAnswering)) {
        return Outcome::kOk;
    }
    const FrameId found = history::SlotWord::parent(slot);
    // A removed frame connects nothing, even if its slot now holds another frame.
    if (view.alive_since(found, history::SlotWord::commit(slot)))
        nearest = {found, chosen.anchor_stamp > stamp && policy.kind != PolicyKind::kLatest};
    return Outcome::kOk;
}

/// A frame's parent at a stamp, or in its newest sample; outside the samples, the nearest sample's
/// parent. These parents may form a cycle although the samples of every state are acyclic: a
/// frame's nearest sample may be a later one. Every such frame of a cycle is a root.
template <View V>
[[nodiscard]] Outcome nearest_parent_at(const V& view, FrameId id, std::optional<StampNs> stamp,
                                        NearestParent& nearest) {
    const Policy policy{stamp ? PolicyKind::kPrevious : PolicyKind::kLatest, kNoLimit};
    return exact_parent(view, id, stamp.value_or(0), policy, Edges::kAll, nearest);
}

/// The result of `nearest_parent_at`, or a root if the frame would be its own ancestor.
template <View V>
[[nodiscard]] Outcome parent_at(const V& view, FrameId id, std::optional<StampNs> stamp,
                                FrameId& parent) {
    NearestParent own;
    Outcome outcome = nearest_parent_at(view, id, stamp, own);
    parent = own.parent;
    NearestParent above = own;
    const FrameId most = own.later ? view.frame_count() : 0;
    for (FrameId steps = 0; steps < most && above.parent != kNoFrame; ++steps) {
        if (above.parent == id) {
            parent = kNoFrame;
            break;
        }
        outcome = nearest_parent_at(view, above.parent, stamp, above);
        if (outcome != Outcome::kOk)
            break;
    }
    return outcome;
}

/// Fills in the fields that an error names.
template <View V>
[[nodiscard]] FrameHandle handle_of(const V& view, FrameId id) {
    return {id, id == kNoFrame ? 0 : view.generation(id)};
}

template <View V>
[[nodiscard]] Outcome describe_refusal(const V& view, FrameId child, FrameId parent, StampNs stamp,
                                       const Policy& policy, const typename V::Edge& edge,
                                       const Selection& chosen, Failure& failure) {
    failure = Failure{};
    failure.code = chosen.code;
    failure.frame = handle_of(view, child);
    failure.other = handle_of(view, parent);
    failure.direction = chosen.direction;
    failure.stamp = stamp;
    failure.limit = policy.limit;
    failure.commit = view.commit();
    history::Bracket around;
    SampleAt oldest;
    if (!edge.oldest(oldest) || !edge.bracket(stamp, around))
        return Outcome::kLapped;
    failure.newest = edge.newest().stamp;
    failure.oldest = oldest.stamp;
    failure.before = around.before.stamp;
    failure.after = around.after.stamp;
    return edge.confirm() ? Outcome::kFailed : Outcome::kLapped;
}

/// Adds to a failure that the stamp is outside the edge's data, which is why this frame has no
/// parent or another one. `noted` is false otherwise.
template <View V>
[[nodiscard]] Outcome note_if_out_of_range(const V& view, FrameId child, StampNs stamp,
                                           const Policy& policy, Failure& failure, bool& noted) {
    noted = false;
    typename V::Edge edge;
    Selection chosen;
    if (!view.open(child, edge) || !select(edge, stamp, policy, chosen))
        return Outcome::kLapped;
    std::uint64_t slot = 0;
    StampNs oldest = history::kNoStamp;
    StampNs newest = history::kNoStamp;
    if (chosen.refused) {
        SampleAt first;
        if (!edge.oldest(first))
            return Outcome::kLapped;
        oldest = first.stamp;
        newest = edge.newest().stamp;
        slot = edge.slot_word(chosen.anchor);
    }
    if (!edge.confirm())
        return Outcome::kLapped;
    noted = chosen.refused && (stamp < oldest || stamp > newest);
    if (!noted)
        return Outcome::kOk;
    failure.edge = handle_of(view, child);
    failure.oldest = oldest;
    failure.newest = newest;
    failure.direction = stamp < oldest ? -1 : 1;
    const FrameId parent = history::SlotWord::parent(slot);
    // A frame that was removed before this state has no name in it, even if its slot was reused.
    const bool known = view.alive_since(parent, history::SlotWord::commit(slot));
    failure.parent = known ? handle_of(view, parent) : FrameHandle{parent, kNoGeneration};
    return Outcome::kOk;
}

/// T[parent<-child] of one edge at a stamp. kMismatch: the samples name another parent. The parent
/// kNoFrame accepts any; kMismatch then means that the edge has none.
template <View V>
[[nodiscard]] Outcome edge_pose(const V& view, FrameId child, FrameId parent, StampNs stamp,
                                const Policy& policy, geometry::Pose& pose, EdgeUse& use,
                                Failure& failure) {
    static_assert(V::Memory::kPayloadWords == 7, "a payload is a pose");
    typename V::Edge edge;
    if (!view.open(child, edge))
        return Outcome::kLapped;
    Selection chosen;
    if (!select(edge, stamp, policy, chosen))
        return Outcome::kLapped;
    if (!chosen.anchor)
        return Outcome::kMismatch;
    const auto anchor = edge.read(chosen.anchor);
    if (parent == kNoFrame)
        parent = anchor.parent;
    pose = std::bit_cast<geometry::Pose>(anchor.payload);
    geometry::Pose other;
    bool mixed = static_cast<bool>(chosen.second);
    if (mixed) {
        const auto second = edge.read(chosen.second);
        other = std::bit_cast<geometry::Pose>(second.payload);
        // The parent's slot may have held another frame when the second sample was written.
        mixed = view.alive_since(parent, second.commit);
        if (!mixed && chosen.used == Used::kInterpolated)
            chosen.used = Used::kHeld;
    }
    if (!edge.confirm())
        return Outcome::kLapped;
    if (anchor.parent != parent || !view.alive_since(parent, anchor.commit)) {
        return Outcome::kMismatch;
    }
    if (chosen.refused) {
        return describe_refusal(view, child, parent, stamp, policy, edge, chosen, failure);
    }
    if (mixed) {
        pose = geometry::interpolate(
            pose, other, geometry::share(chosen.anchor_stamp, chosen.second_stamp, stamp));
    }
    use.child = child;
    use.parent = parent;
    use.generation = view.generation(child);
    use.parent_generation = view.generation(parent);
    use.used = chosen.used;
    use.before = chosen.anchor_stamp;
    use.after = mixed || chosen.second_stamp >= 0 ? chosen.second_stamp : chosen.anchor_stamp;
    if (use.after < use.before)
        std::swap(use.before, use.after);
    return Outcome::kOk;
}

}  // namespace tfdb::lookup
