// Lookups in one state of the forest: at a stamp, at the latest common time, in the newest samples.
#pragma once

#include <algorithm>
#include <optional>

#include "tfdb/lookup/path_coverage.hpp"
#include "tfdb/lookup/quick.hpp"
#include "tfdb/lookup/walk.hpp"

namespace tfdb::lookup {

namespace detail {

/// T[meeting point<-first of the chain]; appends an EdgeUse for each edge.
template <View V>
[[nodiscard]] Outcome chain_pose(const V& view, const std::vector<FrameId>& chain, StampNs stamp,
                                 const Policy& policy, bool inverted, geometry::Pose& pose,
                                 std::vector<EdgeUse>& uses, Failure& failure) {
    for (std::size_t i = 0; i + 1 < chain.size(); ++i) {
        geometry::Pose edge;
        EdgeUse& use = uses.emplace_back();
        use.inverted = inverted;
        const Outcome outcome =
            edge_pose(view, chain[i], chain[i + 1], stamp, policy, edge, use, failure);
        if (outcome != Outcome::kOk)
            return outcome;
        pose = i == 0 ? edge : geometry::compose(edge, pose);
    }
    return Outcome::kOk;
}

/// Translations that are finite edge by edge may overflow when they are composed.
template <View V>
[[nodiscard]] Outcome check_finite(const V& view, StampNs stamp, const geometry::Pose& pose,
                                   Failure& failure) {
    if (geometry::is_finite(pose)) [[likely]]
        return Outcome::kOk;
    failure = Failure{};
    failure.code = ErrorCode::kInvalidTransform;
    failure.stamp = stamp;
    failure.commit = view.commit();
    return Outcome::kFailed;
}

template <View V>
[[nodiscard]] Outcome lookup_once(const V& view, FrameId target, FrameId source, StampNs stamp,
                                  const Policy& policy, WalkMode mode, Answer& answer,
                                  Failure& failure) {
    const Outcome walked = walk(view, target, source, stamp, policy, mode, answer, failure);
    if (walked != Outcome::kOk)
        return walked;
    geometry::Pose from_source = geometry::identity();
    geometry::Pose from_target = geometry::identity();
    Outcome outcome = chain_pose(view, answer.source_chain, stamp, policy, false, from_source,
                                 answer.edges, failure);
    if (outcome != Outcome::kOk)
        return outcome;
    outcome = chain_pose(view, answer.target_chain, stamp, policy, true, from_target, answer.edges,
                         failure);
    if (outcome != Outcome::kOk)
        return outcome;
    if (answer.target_chain.size() == 1) {
        answer.pose = from_source;
    } else if (answer.source_chain.size() == 1) {
        answer.pose = geometry::inverse(from_target);
    } else {
        answer.pose = geometry::compose(geometry::inverse(from_target), from_source);
    }
    const bool at_stamp = policy.kind != PolicyKind::kLatest;
    return check_finite(view, at_stamp ? stamp : -1, answer.pose, failure);
}

/// Runs an attempt with hints. If the hints misled or it failed, it runs again by the samples: only
/// the samples determine the error.
template <class Attempt>
[[nodiscard]] Outcome hints_then_samples(Answer& answer, Attempt attempt) {
    const std::size_t edges = answer.edges.size();
    const Outcome fast = attempt(WalkMode::kHints);
    if (fast == Outcome::kOk || fast == Outcome::kLapped)
        return fast;
    answer.edges.resize(edges);
    const Outcome exact = attempt(WalkMode::kSamples);
    // With the view's own samples, a mismatch means that they changed during the read.
    return exact == Outcome::kMismatch ? Outcome::kLapped : exact;
}

template <View V>
[[nodiscard]] bool check_frame(const V& view, FrameId id, int argument, Failure& failure) {
    if (id != kNoFrame && view.alive(id))
        return true;
    failure = Failure{};
    failure.code = ErrorCode::kUnknownFrame;
    failure.argument = argument;
    failure.commit = view.commit();
    return false;
}

/// Newest stamp of one edge and its parent there; kNoStamp if the edge is static.
template <View V>
[[nodiscard]] Outcome newest_stamp(const V& view, FrameId id, StampNs& stamp, FrameId& parent) {
    stamp = history::kNoStamp;
    parent = kNoFrame;
    typename V::Edge edge;
    if (!view.open(id, edge)) {
        return Outcome::kLapped;
    }
    const history::SampleAt newest = edge.newest();
    if (!edge.is_static())
        stamp = newest.stamp;
    if (newest)
        parent = history::SlotWord::parent(edge.slot_word(newest));
    return edge.confirm() ? Outcome::kOk : Outcome::kLapped;
}

/// The required ends of the common times in the newest tree.
enum class Common : std::uint8_t { kNewest, kOldestToo };

template <View V>
[[nodiscard]] Outcome common_time_once(const V& view, FrameId target, FrameId source, Common wanted,
                                       WalkMode mode, Answer& answer, Failure& failure) {
    const Policy newest{PolicyKind::kLatest, kNoLimit};
    const Outcome walked = walk(view, target, source, 0, newest, mode, answer, failure);
    if (walked != Outcome::kOk)
        return walked;
    StampNs& stamp = answer.stamp;
    stamp = history::kNoStamp;
    answer.oldest = 0;
    for (const auto* chain : {&answer.source_chain, &answer.target_chain}) {
        for (std::size_t i = 0; i + 1 < chain->size(); ++i) {
            StampNs newest_of_edge = history::kNoStamp;
            FrameId parent = kNoFrame;
            Outcome outcome = newest_stamp(view, (*chain)[i], newest_of_edge, parent);
            if (outcome != Outcome::kOk)
                return outcome;
            if (parent != (*chain)[i + 1])
                return Outcome::kMismatch;
            if (newest_of_edge < 0)
                continue;
            stamp = stamp < 0 ? newest_of_edge : std::min(stamp, newest_of_edge);
            StampNs to = newest_of_edge;
            if (wanted == Common::kOldestToo)
                outcome = narrow_to_edge(view, (*chain)[i], parent, to, answer.oldest, to);
            if (outcome != Outcome::kOk)
                return outcome;
        }
    }
    if (stamp < 0)
        stamp = 0;
    return Outcome::kOk;
}

}  // namespace detail

namespace detail {

template <View V>
[[nodiscard]] Outcome common_times(const V& view, FrameId target, FrameId source, Common wanted,
                                   Answer& answer, Failure& failure) {
    if (!check_frame(view, target, 0, failure) || !check_frame(view, source, 1, failure))
        return Outcome::kFailed;
    answer.commit = view.commit();
    if (target != source) {
        return hints_then_samples(answer, [&](WalkMode mode) {
            return common_time_once(view, target, source, wanted, mode, answer, failure);
        });
    }
    typename V::Edge edge;
    history::SampleAt oldest;
    if (!view.open(target, edge) || !edge.oldest(oldest))
        return Outcome::kLapped;
    const bool moves = !edge.empty() && !edge.is_static();
    answer.oldest = moves ? oldest.stamp : 0;
    answer.stamp = moves ? edge.newest().stamp : 0;
    // A slot that was reused meanwhile looks like a frame without samples.
    return edge.confirm() && view.alive(target) ? Outcome::kOk : Outcome::kLapped;
}

}  // namespace detail

/// Sets `answer.stamp` to the latest common time, and the chains to those of the newest tree.
template <View V>
[[nodiscard]] Outcome latest_common_path(const V& view, FrameId target, FrameId source,
                                         Answer& answer, Failure& failure) {
    return detail::common_times(view, target, source, detail::Common::kNewest, answer, failure);
}

/// The newest stamp at which every moving edge between two frames has data; 0 if none moves. As in
/// tf2, a frame and itself have the frame's own edge.
template <View V>
[[nodiscard]] Outcome latest_common_time(const V& view, FrameId target, FrameId source,
                                         Answer& answer, Failure& failure) {
    if constexpr (InPlaceView<V>) {
        QuickLookup<V> quick(view, {}, answer);
        if (quick.common_time(target, source, answer.stamp))
            return Outcome::kOk;
    }
    return latest_common_path(view, target, source, answer, failure);
}

/// The stamps at which every moving edge of the newest tree's path has data and its newest parent:
/// from `answer.oldest` to `answer.stamp`, the latest common time. Both are 0 if no edge moves.
template <View V>
[[nodiscard]] Outcome covered_stamps(const V& view, FrameId target, FrameId source, Answer& answer,
                                     Failure& failure) {
    return detail::common_times(view, target, source, detail::Common::kOldestToo, answer, failure);
}

/// T[parent<-child] of one edge, in constant time: it reads no frame above. kFailed with
/// kDisconnected: the samples name another parent at the stamp.
template <View V>
[[nodiscard]] Outcome lookup_edge(const V& view, FrameId parent, FrameId child, StampNs stamp,
                                  const Policy& policy, Answer& answer, Failure& failure) {
    if (!detail::check_frame(view, parent, 0, failure) ||
        !detail::check_frame(view, child, 1, failure)) {
        return Outcome::kFailed;
    }
    answer.stamp = stamp;
    answer.commit = view.commit();
    answer.edges.clear();
    EdgeUse& use = answer.edges.emplace_back();
    const Outcome outcome =
        edge_pose(view, child, parent, stamp, policy, answer.pose, use, failure);
    if (outcome == Outcome::kOk || outcome == Outcome::kLapped)
        return outcome;
    if (outcome == Outcome::kMismatch) {
        failure = Failure{};
        failure.code = ErrorCode::kDisconnected;
        failure.frame = handle_of(view, parent);
        failure.other = handle_of(view, child);
        failure.stamp = stamp;
        failure.commit = view.commit();
    }
    return Outcome::kFailed;
}

/// T[parent<-child] of the edge from a frame to its parent at a stamp, or in its newest sample. It
/// equals `lookup` of the two. kFailed with kDisconnected: the frame has no parent then.
template <View V>
[[nodiscard]] Outcome lookup_own_edge(const V& view, FrameId child, std::optional<StampNs> stamp,
                                      const Policy& policy, Answer& answer, Failure& failure) {
    const Policy newest{PolicyKind::kLatest, kNoLimit};
    const Policy& how = stamp ? policy : newest;
    if constexpr (InPlaceView<V>) {
        QuickLookup<V> quick(view, how, answer);
        if (quick_policy(how) && quick.edge(child, stamp.value_or(0))) {
            answer.stamp = stamp.value_or(answer.edges.front().before);
            return Outcome::kOk;
        }
    }
    if (!detail::check_frame(view, child, 1, failure))
        return Outcome::kFailed;
    answer.commit = view.commit();
    answer.edges.clear();
    EdgeUse& use = answer.edges.emplace_back();
    Outcome outcome =
        edge_pose(view, child, kNoFrame, stamp.value_or(0), how, answer.pose, use, failure);
    answer.stamp = stamp.value_or(use.before);
    if (outcome == Outcome::kOk)
        outcome = detail::check_finite(view, answer.stamp, answer.pose, failure);
    if (outcome == Outcome::kMismatch) {
        failure = Failure{};
        failure.code = ErrorCode::kDisconnected;
        failure.stamp = stamp.value_or(-1);
        failure.commit = view.commit();
        return Outcome::kFailed;
    }
    if (outcome == Outcome::kFailed && failure.code == ErrorCode::kInvalidTransform)
        failure.other = {use.parent, use.parent_generation};
    return outcome;
}

/// Sets the pose T[target<-source] at one stamp, and appends to `answer.edges`.
template <View V>
[[nodiscard]] Outcome lookup_at(const V& view, FrameId target, FrameId source, StampNs stamp,
                                const Policy& policy, Answer& answer, Failure& failure) {
    if (!detail::check_frame(view, target, 0, failure) ||
        !detail::check_frame(view, source, 1, failure)) {
        return Outcome::kFailed;
    }
    answer.stamp = stamp;
    answer.commit = view.commit();
    if (target == source) {
        answer.pose = geometry::identity();
        return Outcome::kOk;
    }
    return detail::hints_then_samples(answer, [&](WalkMode mode) {
        return detail::lookup_once(view, target, source, stamp, policy, mode, answer, failure);
    });
}

namespace detail {

/// Looks up at a stamp, or at the latest common time without one: `quick(lookup, stamp)` in the
/// common case, otherwise the general code.
template <View V, class Quick>
[[nodiscard]] Outcome quick_or_general(const V& view, FrameId target, FrameId source,
                                       std::optional<StampNs> stamp, const Policy& policy,
                                       Answer& answer, Failure& failure, Quick quick) {
    answer.edges.clear();
    StampNs at = 0;
    if (stamp) {
        at = *stamp;
    } else {
        const Outcome outcome = latest_common_time(view, target, source, answer, failure);
        if (outcome != Outcome::kOk)
            return outcome;
        at = answer.stamp;
    }
    if constexpr (InPlaceView<V>) {
        QuickLookup<V> lookup(view, policy, answer);
        if (quick_policy(policy) && quick(lookup, at)) {
            return Outcome::kOk;
        }
        answer.edges.clear();
    }
    return lookup_at(view, target, source, at, policy, answer, failure);
}

}  // namespace detail

/// T[target<-source] at a stamp, or at the latest common time without one.
template <View V>
[[nodiscard]] Outcome lookup(const V& view, FrameId target, FrameId source,
                             std::optional<StampNs> stamp, const Policy& policy, Answer& answer,
                             Failure& failure) {
    return detail::quick_or_general(
        view, target, source, stamp, policy, answer, failure,
        [&](auto& quick, StampNs at) { return quick.at(target, source, at); });
}

/// Whether `lookup` succeeds: kOk, or the failure. The answer is unspecified.
template <View V>
[[nodiscard]] Outcome can_lookup(const V& view, FrameId target, FrameId source,
                                 std::optional<StampNs> stamp, const Policy& policy, Answer& answer,
                                 Failure& failure) {
    return detail::quick_or_general(
        view, target, source, stamp, policy, answer, failure,
        [&](auto& quick, StampNs at) { return quick.covers(target, source, at); });
}

/// Each edge's own newest sample, without interpolation: the paper's lookupLatestTransform. The
/// answer's stamp is the oldest of those used. With `max_age`, an older edge is refused.
template <View V>
[[nodiscard]] Outcome lookup_latest(const V& view, FrameId target, FrameId source,
                                    std::optional<StampNs> max_age, StampNs now, Answer& answer,
                                    Failure& failure) {
    const Policy newest{PolicyKind::kLatest, kNoLimit};
    const Outcome outcome = lookup(view, target, source, StampNs{0}, newest, answer, failure);
    if (outcome != Outcome::kOk)
        return outcome;
    StampNs oldest = history::kNoStamp;
    for (const EdgeUse& use : answer.edges) {
        if (use.before < 0)
            continue;
        if (oldest < 0 || use.before < oldest)
            oldest = use.before;
        if (max_age && use.before < clock::saturating_sub(now, *max_age)) {
            failure = Failure{};
            failure.code = ErrorCode::kStale;
            failure.frame = {use.child, use.generation};
            failure.other = {use.parent, use.parent_generation};
            failure.stamp = now;
            failure.newest = use.before;
            failure.before = use.before;
            failure.limit = *max_age;
            failure.commit = view.commit();
            return Outcome::kFailed;
        }
    }
    answer.stamp = oldest < 0 ? 0 : oldest;
    return Outcome::kOk;
}

namespace detail {

/// One half of a lookup through a fixed frame; without a stamp, at its own latest common time.
template <View V>
[[nodiscard]] Outcome lookup_half(const V& view, FrameId target, FrameId source,
                                  std::optional<StampNs> stamp, const Policy& policy, Half half,
                                  Answer& answer, Failure& failure) {
    if (!stamp) {
        const Outcome found = latest_common_path(view, target, source, answer, failure);
        failure.half = half;
        if (found != Outcome::kOk)
            return found;
        stamp = answer.stamp;
    }
    const Outcome outcome = lookup_at(view, target, source, *stamp, policy, answer, failure);
    failure.half = half;
    return outcome;
}

}  // namespace detail

/// T[target at target_stamp <- source at source_stamp], through a frame that did not move. A side
/// without a stamp is taken at its latest common time with the fixed frame.
template <View V>
[[nodiscard]] Outcome lookup_full(const V& view, FrameId target,
                                  std::optional<StampNs> target_stamp, FrameId source,
                                  std::optional<StampNs> source_stamp, FrameId fixed,
                                  const Policy& policy, Answer& answer, Failure& failure) {
    answer.edges.clear();
    if (!detail::check_frame(view, target, 0, failure) ||
        !detail::check_frame(view, source, 1, failure) ||
        !detail::check_frame(view, fixed, 2, failure)) {
        return Outcome::kFailed;
    }
    Outcome outcome = detail::lookup_half(view, fixed, source, source_stamp, policy, Half::kSource,
                                          answer, failure);
    if (outcome != Outcome::kOk)
        return outcome;
    const geometry::Pose fixed_from_source = answer.pose;
    outcome = detail::lookup_half(view, target, fixed, target_stamp, policy, Half::kTarget, answer,
                                  failure);
    if (outcome != Outcome::kOk)
        return outcome;
    answer.pose = geometry::compose(answer.pose, fixed_from_source);
    return detail::check_finite(view, target_stamp.value_or(answer.stamp), answer.pose, failure);
}

}  // namespace tfdb::lookup
