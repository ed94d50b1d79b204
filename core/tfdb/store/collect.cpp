#include "tfdb/store/collect.hpp"

#include <algorithm>
#include <bit>
#include <limits>
#include <utility>

namespace tfdb::store {
namespace {

using lookup::Outcome;

void push(const StoreEdge& edge, std::uint64_t index, Track& track) {
    const auto slot = edge.read(index);
    track.poses.push_back(std::bit_cast<Pose>(slot.payload));
    track.parents.push_back(slot.parent);
    track.commits.push_back(slot.commit);
}

void reserve(Track& track, std::size_t count) {
    track.stamps.reserve(count);
    track.poses.reserve(count);
    track.parents.reserve(count);
    track.commits.reserve(count);
}

/// Stamps rise strictly: the window is a range of indices.
Outcome collect_ordered(const StoreEdge& edge, StampNs first, StampNs last, std::size_t most,
                        Track& track) {
    const StampNs cutoff = edge.cutoff();
    const std::uint64_t retained = edge.upper_bound(cutoff - 1);
    std::uint64_t from = edge.upper_bound(first);
    const std::uint64_t end = edge.upper_bound(last);
    from = std::max(retained, from > edge.lo() + 2 ? from - 2 : edge.lo());
    const std::uint64_t to = std::min(edge.hi(), end + 2);
    if (from == edge.lo() && edge.may_miss())
        return Outcome::kLapped;
    // Only a search that was misled by overwritten stamps ends below the retained ones.
    if (from < edge.hi() && edge.stamp_at(from) < cutoff)
        return Outcome::kLapped;
    if (to > from && to - from > most)
        return Outcome::kFailed;
    if (to > from)
        reserve(track, to - from);
    for (std::uint64_t i = from; i < to; ++i) {
        track.stamps.push_back(edge.stamp_at(i));
        push(edge, i, track);
    }
    // A search for the end that overwritten stamps misled ends below those that are left.
    return edge.confirm(std::min(from, end)) ? Outcome::kOk : Outcome::kLapped;
}

/// Late or repeated samples: take all that is visible, sort, keep the newest commit of each stamp.
Outcome collect_sorted(const StoreEdge& edge, StampNs first, StampNs last, std::size_t most,
                       Track& track) {
    if (edge.may_miss())
        return Outcome::kLapped;
    std::vector<std::pair<StampNs, std::uint64_t>> order;
    for (std::uint64_t i = edge.lo(); i < edge.hi(); ++i) {
        if (edge.visible(i))
            order.emplace_back(edge.stamp_at(i), i);
    }
    std::sort(order.begin(), order.end());
    const StampNs cutoff = edge.cutoff();
    std::size_t kept = 0;
    for (std::size_t i = 0; i < order.size(); ++i) {
        const bool superseded = i + 1 < order.size() && order[i + 1].first == order[i].first;
        if (!superseded && order[i].first >= cutoff)
            order[kept++] = order[i];
    }
    order.resize(kept);
    const auto at = [&](StampNs stamp) {
        return static_cast<std::size_t>(
            std::upper_bound(order.begin(), order.end(),
                             std::pair{stamp, std::numeric_limits<std::uint64_t>::max()}) -
            order.begin());
    };
    std::size_t from = at(first);
    from = from > 2 ? from - 2 : 0;
    const std::size_t to = std::min(order.size(), at(last) + 2);
    if (to > from && to - from > most)
        return Outcome::kFailed;
    for (std::size_t i = from; i < to; ++i) {
        track.stamps.push_back(order[i].first);
        push(edge, order[i].second, track);
    }
    return edge.confirm(edge.lo()) ? Outcome::kOk : Outcome::kLapped;
}

}  // namespace

Outcome collect_window(const StoreView& view, FrameId id, StampNs first, StampNs last,
                       std::size_t most, Track& track) {
    track.stamps.clear();
    track.poses.clear();
    track.parents.clear();
    track.commits.clear();
    track.is_static = false;
    StoreEdge edge;
    if (!view.open(id, edge))
        return Outcome::kLapped;
    if (edge.empty())
        return edge.confirm(edge.lo()) ? Outcome::kOk : Outcome::kLapped;
    if (edge.is_static()) {
        track.is_static = true;
        const std::uint64_t index = edge.static_index();
        push(edge, index, track);
        return edge.confirm(edge.ordered() ? index : edge.lo()) ? Outcome::kOk : Outcome::kLapped;
    }
    if (edge.ordered())
        return collect_ordered(edge, first, last, most, track);
    return collect_sorted(edge, first, last, most, track);
}

namespace {

/// Of stamps that rise.
template <class StampAt>
void take_stamps(std::uint64_t from, std::uint64_t to, StampAt stamp_at, Outline& out) {
    if (from == to)
        return;
    out.oldest = out.newest = stamp_at(from);
    for (std::uint64_t i = from + 1; i < to; ++i) {
        const StampNs stamp = stamp_at(i);
        out.longest_gap = std::max(out.longest_gap, stamp - out.newest);
        out.newest = stamp;
    }
}

Outcome outline_ordered(const StoreEdge& edge, Outline& out) {
    const StampNs cutoff = edge.cutoff();
    const std::uint64_t from = edge.upper_bound(cutoff - 1);
    if (from == edge.lo() && edge.may_miss())
        return Outcome::kLapped;
    // Only a search that was misled by overwritten stamps ends below the retained ones.
    if (from == edge.hi() || edge.stamp_at(from) < cutoff)
        return Outcome::kLapped;
    out.samples = edge.hi() - from;
    take_stamps(
        from, edge.hi(), [&](std::uint64_t i) { return edge.stamp_at(i); }, out);
    const std::uint64_t newest = edge.slot_word(edge.hi() - 1);
    out.parent = history::SlotWord::parent(newest);
    out.named = history::SlotWord::commit(newest);
    return edge.confirm(from) ? Outcome::kOk : Outcome::kLapped;
}

}  // namespace

Outcome outline(const StoreView& view, FrameId id, Outline& out) {
    out = Outline{};
    StoreEdge edge;
    if (!view.open(id, edge))
        return Outcome::kLapped;
    if (!edge.empty() && !edge.is_static() && edge.ordered())
        return outline_ordered(edge, out);
    Track track;
    const Outcome outcome = collect_all(view, id, track);
    if (outcome != Outcome::kOk)
        return outcome;
    out.samples = track.poses.size();
    out.is_static = track.is_static;
    take_stamps(
        0, track.stamps.size(), [&](std::uint64_t i) { return track.stamps[i]; }, out);
    if (!track.parents.empty()) {
        out.parent = track.parents.back();
        out.named = track.commits.back();
    }
    return outcome;
}

Outcome collect_all(const StoreView& view, FrameId id, Track& track) {
    return collect_window(view, id, std::numeric_limits<StampNs>::min() / 2, history::kForever,
                          std::numeric_limits<std::size_t>::max(), track);
}

}  // namespace tfdb::store
