// The stamps that a path covers: at each of them every edge has data and the same parent.
#pragma once

#include <algorithm>

#include "tfdb/lookup/edge.hpp"

namespace tfdb::lookup {

namespace detail {

template <View V>
[[nodiscard]] bool names_parent(const V& view, const typename V::Edge& edge, const SampleAt& sample,
                                FrameId parent) {
    const std::uint64_t slot = edge.slot_word(sample);
    return history::SlotWord::parent(slot) == parent &&
           view.alive_since(parent, history::SlotWord::commit(slot));
}

/// Visits samples backward from the one at or before `stamp`, then forward from there, while they
/// name the parent and lie within [from, to].
template <View V>
[[nodiscard]] Outcome narrow_step_by_step(const V& view, const typename V::Edge& edge,
                                          FrameId parent, history::Bracket around, StampNs& from,
                                          StampNs& to) {
    history::Bracket at = around;
    StampNs first = around.before.stamp;
    while (first > from) {
        if (!edge.bracket(first - 1, at))
            return Outcome::kLapped;
        if (!at.before || !names_parent(view, edge, at.before, parent))
            break;
        first = at.before.stamp;
    }
    from = std::max(from, first);
    StampNs last = around.before.stamp;
    while (last < to) {
        if (!around.after) {
            to = last;
        } else if (!names_parent(view, edge, around.after, parent)) {
            to = std::min(to, around.after.stamp - 1);  // until then the previous sample is held
        } else {
            last = around.after.stamp;
            if (!edge.bracket(last, around))
                return Outcome::kLapped;
            continue;
        }
        break;
    }
    return Outcome::kOk;
}

}  // namespace detail

/// Narrows [from, to] to the stamps around `stamp` at which an edge has data and this parent.
/// kMismatch: not even `stamp` qualifies.
template <View V>
[[nodiscard]] Outcome narrow_to_edge(const V& view, FrameId child, FrameId parent, StampNs stamp,
                                     StampNs& from, StampNs& to) {
    typename V::Edge edge;
    if (!view.open(child, edge))
        return Outcome::kLapped;
    if (edge.empty() || edge.is_static())
        return edge.confirm() ? Outcome::kOk : Outcome::kLapped;
    history::Bracket around;
    SampleAt oldest;
    if (!edge.bracket(stamp, around) || !edge.oldest(oldest))
        return Outcome::kLapped;
    Outcome outcome = Outcome::kOk;
    if (!around.before || !detail::names_parent(view, edge, around.before, parent)) {
        outcome = Outcome::kMismatch;
    } else if (edge.one_parent() &&
               (view.generation(parent) == 0 || view.alive_since(parent, edge.least_commit()))) {
        // The parent's slot held no other frame before, or no sample was written in that frame's
        // time.
        from = std::max(from, oldest.stamp);
        to = std::min(to, edge.newest().stamp);
    } else {
        outcome = detail::narrow_step_by_step(view, edge, parent, around, from, to);
    }
    return edge.confirm() ? outcome : Outcome::kLapped;
}

}  // namespace tfdb::lookup
