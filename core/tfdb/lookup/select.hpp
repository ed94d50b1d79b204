// Which of an edge's samples answer for a stamp: the time policies, in one place.
#pragma once

#include <cstdint>

#include "tfdb/base/error.hpp"
#include "tfdb/history/edge_view.hpp"
#include "tfdb/lookup/answer.hpp"
#include "tfdb/lookup/policy.hpp"

namespace tfdb::lookup {

/// The choice for one edge. `anchor` is the sample whose parent is the edge's parent at the stamp,
/// also where the policy then refuses to answer.
struct Selection {
    std::uint64_t anchor = history::kNoIndex;  // kNoIndex: the frame has no samples, it is a root
    std::uint64_t second = history::kNoIndex;  // the other sample of an interpolation
    std::uint64_t lowest = 0;
    StampNs anchor_stamp = -1;
    StampNs second_stamp = -1;
    Used used = Used::kStatic;
    bool refused = false;  // then `code` says why
    ErrorCode code = ErrorCode::kExtrapolation;
    int direction = 0;
};

namespace detail {

template <class Edge>
bool parents_equal(const Edge& view, std::uint64_t a, std::uint64_t b) {
    return ((view.slot_word(a) ^ view.slot_word(b)) & kNoFrame) == 0;
}

inline void refuse(Selection& s, ErrorCode code, int direction) {
    s.refused = true;
    s.code = code;
    s.direction = direction;
}

/// Outside the samples: only Extrapolate goes on, on the line through the two outermost samples.
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
    s.lowest = next.lowest < s.lowest ? next.lowest : s.lowest;
    s.second = direction > 0 ? next.before : next.after;
    s.second_stamp = direction > 0 ? next.before_stamp : next.after_stamp;
    if (s.second != history::kNoIndex && !parents_equal(view, s.anchor, s.second)) {
        s.second = history::kNoIndex;
    }
    return true;
}

inline void select_nearest(const history::Bracket& around, StampNs stamp, const Policy& policy,
                           Selection& s) {
    const bool later = around.before == history::kNoIndex ||
                       (around.after != history::kNoIndex &&
                        around.after_stamp - stamp < stamp - around.before_stamp);
    s.anchor = later ? around.after : around.before;
    s.anchor_stamp = later ? around.after_stamp : around.before_stamp;
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
    if (around.after == history::kNoIndex)
        return select_outside(view, stamp, policy, 1, s);
    s.second_stamp = around.after_stamp;
    const StampNs gap = around.after_stamp - around.before_stamp;
    if (policy.kind == PolicyKind::kInterpolate && gap > policy.limit) {
        refuse(s, ErrorCode::kGapTooLarge, 0);
        return true;
    }
    if (parents_equal(view, around.before, around.after)) {
        s.second = around.after;
        s.used = Used::kInterpolated;
    } else {
        s.used = Used::kHeld;  // the old parent holds until the new one begins
    }
    return true;
}

}  // namespace detail

/// False if the view was overtaken and must be opened again.
template <class Edge>
[[nodiscard]] bool select(const Edge& view, StampNs stamp, const Policy& policy, Selection& s) {
    s = Selection{};
    s.lowest = view.lo();
    if (view.empty())
        return true;
    if (view.is_static()) {
        s.anchor = view.static_index();
        s.lowest = view.ordered() ? s.anchor : view.lo();
        return true;
    }
    if (policy.kind == PolicyKind::kLatest) {
        s.used = Used::kLatest;
        if (!view.newest(s.anchor, s.anchor_stamp))
            return false;
        if (view.ordered())
            s.lowest = s.anchor;
        return true;
    }
    history::Bracket around;
    if (!view.bracket(stamp, around))
        return false;
    s.lowest = around.lowest;
    if (around.before == history::kNoIndex && around.after == history::kNoIndex)
        return true;
    if (policy.kind == PolicyKind::kNearest) {
        detail::select_nearest(around, stamp, policy, s);
        return true;
    }
    if (around.before == history::kNoIndex) {
        s.anchor = around.after;
        s.anchor_stamp = around.after_stamp;
        if (policy.kind == PolicyKind::kExact) {
            detail::refuse(s, ErrorCode::kNoSampleNear, 0);
            return true;
        }
        return detail::select_outside(view, stamp, policy, -1, s);
    }
    s.anchor = around.before;
    s.anchor_stamp = around.before_stamp;
    if (around.before_stamp == stamp) {
        s.used = Used::kExact;
        return true;
    }
    return detail::select_between(view, stamp, policy, around, s);
}

}  // namespace tfdb::lookup
