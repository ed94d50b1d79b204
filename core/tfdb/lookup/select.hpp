// Selects the samples of an edge that answer for a stamp: all time policies in one place.
#pragma once

#include <cstdint>

#include "tfdb/base/error.hpp"
#include "tfdb/history/edge_view.hpp"
#include "tfdb/lookup/answer.hpp"
#include "tfdb/lookup/policy.hpp"

namespace tfdb::lookup {

using history::SampleAt;

/// The selection for one edge. `anchor` is the sample whose parent is the edge's parent at the
/// stamp, even if the policy then refuses to answer.
struct Selection {
    SampleAt anchor;  // none: the frame has no samples and is a root
    SampleAt second;  // the other sample of an interpolation
    StampNs anchor_stamp = -1;
    StampNs second_stamp = -1;
    Used used = Used::kStatic;
    bool refused = false;  // then `code` is the reason
    ErrorCode code = ErrorCode::kExtrapolation;
    int direction = 0;
};

namespace detail {

template <class Edge>
bool parents_equal(const Edge& view, const SampleAt& a, const SampleAt& b) {
    return ((view.slot_word(a) ^ view.slot_word(b)) & kNoFrame) == 0;
}

inline void refuse(Selection& s, ErrorCode code, int direction) {
    s.refused = true;
    s.code = code;
    s.direction = direction;
}

/// Outside the samples only Extrapolate answers, on the line through the two outermost samples.
template <class Edge>
[[nodiscard]] bool select_outside(const Edge& view, StampNs stamp, const Policy& policy,
                                  int direction, Selection& s) {
    const StampNs beyond = direction > 0 ? stamp - s.anchor_stamp : s.anchor_stamp - stamp;
    if (policy.kind != PolicyKind::kExtrapolate || beyond > policy.limit) {
        refuse(s, ErrorCode::kExtrapolation, direction);
        return true;
    }
    s.used = Used::kExtrapolated;
    history::Bracket next;
    const StampNs probe = direction > 0 ? s.anchor_stamp - 1 : s.anchor_stamp;
    if (!view.bracket(probe, next))
        return false;
    s.second = direction > 0 ? next.before : next.after;
    s.second_stamp = s.second.stamp;
    if (s.second && !parents_equal(view, s.anchor, s.second))
        s.second = {};
    return true;
}

inline void select_nearest(const history::Bracket& around, StampNs stamp, const Policy& policy,
                           Selection& s) {
    const bool later = !around.before ||
                       (around.after && around.after.stamp - stamp < stamp - around.before.stamp);
    s.anchor = later ? around.after : around.before;
    s.anchor_stamp = s.anchor.stamp;
    s.used = s.anchor_stamp == stamp ? Used::kExact : Used::kNearest;
    const StampNs distance = later ? s.anchor_stamp - stamp : stamp - s.anchor_stamp;
    if (distance > policy.limit)
        refuse(s, ErrorCode::kNoSampleNear, 0);
}

template <class Edge>
[[nodiscard]] bool select_between(const Edge& view, StampNs stamp, const Policy& policy,
                                  const history::Bracket& around, Selection& s) {
    if (policy.kind == PolicyKind::kExact) {
        refuse(s, ErrorCode::kNoSampleNear, 0);
        return true;
    }
    if (policy.kind == PolicyKind::kPrevious) {
        s.used = Used::kHeld;
        if (stamp - s.anchor_stamp > policy.limit)
            refuse(s, ErrorCode::kStale, 0);
        return true;
    }
    if (!around.after)
        return select_outside(view, stamp, policy, 1, s);
    s.second_stamp = around.after.stamp;
    const StampNs gap = around.after.stamp - around.before.stamp;
    if (policy.kind == PolicyKind::kInterpolate && gap > policy.limit) {
        refuse(s, ErrorCode::kGapTooLarge, 0);
        return true;
    }
    if (parents_equal(view, around.before, around.after)) {
        s.second = around.after;
        s.used = Used::kInterpolated;
    } else {
        s.used = Used::kHeld;  // the old parent holds until the new one starts
    }
    return true;
}

}  // namespace detail

/// False: a writer overtook the view, which must be opened again.
template <class Edge>
[[nodiscard]] bool select(const Edge& view, StampNs stamp, const Policy& policy, Selection& s) {
    s = Selection{};
    if (view.empty())
        return true;
    if (view.is_static()) {
        s.anchor = view.newest();
        return true;
    }
    if (policy.kind == PolicyKind::kLatest) {
        s.used = Used::kLatest;
        s.anchor = view.newest();
        s.anchor_stamp = s.anchor.stamp;
        return true;
    }
    history::Bracket around;
    if (!view.bracket(stamp, around))
        return false;
    if (!around.before && !around.after)
        return true;
    if (policy.kind == PolicyKind::kNearest) {
        detail::select_nearest(around, stamp, policy, s);
        return true;
    }
    if (!around.before) {
        s.anchor = around.after;
        s.anchor_stamp = around.after.stamp;
        if (policy.kind == PolicyKind::kExact) {
            detail::refuse(s, ErrorCode::kNoSampleNear, 0);
            return true;
        }
        return detail::select_outside(view, stamp, policy, -1, s);
    }
    s.anchor = around.before;
    s.anchor_stamp = around.before.stamp;
    if (around.before.stamp == stamp) {
        s.used = Used::kExact;
        return true;
    }
    return detail::select_between(view, stamp, policy, around, s);
}

}  // namespace tfdb::lookup
