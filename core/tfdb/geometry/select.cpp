#include "tfdb/geometry/select.hpp"

#include <algorithm>

#include "tfdb/geometry/slerp.hpp"

namespace tfdb::geometry {

namespace {

using clock::saturating_sub;

constexpr Selected kRefused{0, 0.0, true};

Selected of_lone_sample(const Rule& rule, StampNs sample, StampNs stamp) noexcept {
    const StampNs age = saturating_sub(stamp, sample);
    const StampNs distance = std::max(age, saturating_sub(sample, stamp));
    switch (rule.selection) {
        case Selection::kInterpolate:
        case Selection::kExact:
            return distance == 0 ? Selected{} : kRefused;
        case Selection::kPrevious:
            return age >= 0 && age <= rule.limit ? Selected{} : kRefused;
        case Selection::kNearest:
        case Selection::kExtrapolate:
            return distance <= rule.limit ? Selected{} : kRefused;
    }
    return kRefused;
}

/// The stamps around a query: `before` is the sample at the query's index.
struct Around {
    StampNs before, after, stamp;
    bool held;  // the parent changes in between

    [[nodiscard]] double held_fraction() const noexcept { return stamp >= after ? 1.0 : 0.0; }
};

Selected previous(const Rule& rule, const Around& at, std::size_t index) noexcept {
    const bool second = at.stamp >= at.after;
    const StampNs age = saturating_sub(at.stamp, second ? at.after : at.before);
    return age >= 0 && age <= rule.limit ? Selected{index, second ? 1.0 : 0.0} : kRefused;
}

Selected nearest(const Rule& rule, const Around& at, std::size_t index) noexcept {
    const StampNs to_before =
        std::max(saturating_sub(at.stamp, at.before), saturating_sub(at.before, at.stamp));
    const StampNs to_after =
        std::max(saturating_sub(at.stamp, at.after), saturating_sub(at.after, at.stamp));
    const bool second = to_after < to_before;
    return std::min(to_before, to_after) <= rule.limit ? Selected{index, second ? 1.0 : 0.0}
                                                       : kRefused;
}

Selected interpolated(const Rule& rule, const Around& at, std::size_t index) noexcept {
    const bool extrapolates = rule.selection == Selection::kExtrapolate;
    const StampNs limit = rule.limit;
    const StampNs outside =
        std::max(saturating_sub(at.before, at.stamp), saturating_sub(at.stamp, at.after));
    if (outside > (extrapolates ? limit : 0)) {
        return kRefused;
    }
    const StampNs stamp = at.stamp;
    const bool stored = stamp == at.before || stamp == at.after;
    if (!extrapolates && !stored && at.after - at.before > limit) {
        return kRefused;
    }
    if (at.held) {
        return Selected{index, at.held_fraction()};
    }
    return Selected{index, share(at.before, at.after, stamp), false, outside > 0};
}

}  // namespace

Selected select_at(const TrackView& track, const Rule& rule, StampNs stamp,
                   std::size_t index) noexcept {
    if (track.size == 1) {
        return of_lone_sample(rule, track.stamps[0], stamp);
    }
    const Around at{track.stamps[index], track.stamps[index + 1], stamp,
                    track.parents != nullptr && track.parents[index] != track.parents[index + 1]};
    switch (rule.selection) {
        case Selection::kInterpolate:
        case Selection::kExtrapolate:
            return interpolated(rule, at, index);
        case Selection::kPrevious:
            return previous(rule, at, index);
        case Selection::kNearest:
            return nearest(rule, at, index);
        case Selection::kExact:
            if (stamp == at.before || stamp == at.after) {
                return Selected{index, at.held_fraction()};
            }
            return kRefused;
    }
    return kRefused;
}

Selected select_sample(const TrackView& track, const Rule& rule, StampNs stamp) noexcept {
    if (track.is_static) {
        return Selected{};
    }
    if (track.size == 0) {
        return kRefused;
    }
    const std::size_t before = sample_before(track.stamps, track.size, stamp);
    return select_at(track, rule, stamp, track.size == 1 ? 0 : std::min(before, track.size - 2));
}

Pose pose_at(const TrackView& track, const Selected& selected, StampNs stamp) noexcept {
    if (track.is_static || track.size == 1) {
        return track.poses[0];
    }
    const StampNs* stamps = track.stamps + selected.index;
    const Pose* segment = track.poses + selected.index;
    if (selected.outside && stamp > stamps[1]) {
        return interpolate(segment[1], segment[0], share(stamps[1], stamps[0], stamp));
    }
    return interpolate(segment[0], segment[1], selected.u);
}

BlockSelection select_block(const TrackView& track, const Rule& rule, const StampNs* queries,
                            const std::uint32_t* index, std::size_t count, double* weights,
                            std::uint8_t* refused) noexcept {
    BlockSelection result;
    for (std::size_t i = 0; i < count; ++i) {
        const Selected selected = select_at(track, rule, queries[i], index[i]);
        weights[i] = selected.u;
        refused[i] |= static_cast<std::uint8_t>(selected.refused);
        result.refused += selected.refused ? 1 : 0;
        result.outside |= selected.outside;
    }
    return result;
}

bool is_plain(const TrackView& track, const Rule& rule, const QueryRange& queries, std::size_t low,
              std::size_t high) noexcept {
    const bool interpolates = rule.selection == Selection::kInterpolate;
    if (!interpolates && rule.selection != Selection::kExtrapolate) {
        return false;
    }
    if (queries.least < track.stamps[low] || queries.greatest > track.stamps[high]) {
        return false;
    }
    const StampNs greatest_gap = interpolates ? rule.limit : kNoLimit;
    for (std::size_t i = low; i < high && greatest_gap != kNoLimit; ++i) {
        if (track.stamps[i + 1] - track.stamps[i] > greatest_gap) {
            return false;
        }
    }
    for (std::size_t i = low; i < high && track.parents != nullptr; ++i) {
        if (track.parents[i] != track.parents[i + 1]) {
            return false;
        }
    }
    return true;
}

}  // namespace tfdb::geometry
