// Random tracks and paths for tests, and the scalar loop that the batch functions must agree with.
#pragma once

#include <algorithm>
#include <memory>
#include <vector>

#include "tfdb/geometry/batch.hpp"
#include "tfdb/geometry/random_pose.hpp"

namespace tfdb::geometry::testing {

struct TrackShape {
    std::size_t size = 200;
    StampNs start = 1'700'000'000'000'000'000;
    StampNs least_gap = 1'000;
    StampNs greatest_gap = 2'000'000;
    double turn = 0.01;       // greatest angle of the sphere from sample to sample
    double flip = 0.0;        // share of samples stored as -q
    double new_parent = 0.0;  // share of samples after which the parent is another
};

/// Owns what a TrackView shows.
struct RandomTrack {
    std::vector<StampNs> stamps;
    std::vector<Pose> poses;
    std::vector<std::uint32_t> parents;
    bool is_static = false;

    [[nodiscard]] TrackView view() const {
        return TrackView{stamps.data(), poses.data(), parents.empty() ? nullptr : parents.data(),
                         poses.size(), is_static};
    }
};

inline RandomTrack make_track(RandomPoses& random, const TrackShape& shape) {
    RandomTrack track;
    StampNs stamp = shape.start + random.stamp(0, shape.greatest_gap);
    Pose pose = random.pose();
    std::uint32_t parent = 7;
    for (std::size_t i = 0; i < shape.size; ++i) {
        track.stamps.push_back(stamp);
        track.poses.push_back(pose);
        if (shape.new_parent > 0.0) {
            track.parents.push_back(parent);
            parent += random.uniform(0.0, 1.0) < shape.new_parent ? 1U : 0U;
        }
        stamp += random.stamp(shape.least_gap, shape.greatest_gap);
        const Vec3 move = random.point(0.1);
        pose.translation = {pose.translation.x + move.x, pose.translation.y + move.y,
                            pose.translation.z + move.z};
        pose.rotation = random.apart(pose.rotation, random.uniform(0.0, shape.turn));
        if (random.uniform(0.0, 1.0) < shape.flip) {
            const Quat& q = pose.rotation;
            pose.rotation = {-q.x, -q.y, -q.z, -q.w};
        }
    }
    return track;
}

inline RandomTrack make_static(RandomPoses& random) {
    RandomTrack track;
    track.poses.push_back(random.pose());
    track.is_static = true;
    return track;
}

/// Stamps between `low` and `high`, some of them at samples, sorted or not.
inline std::vector<StampNs> make_stamps(RandomPoses& random, const RandomTrack& track, StampNs low,
                                        StampNs high, std::size_t count, bool sorted) {
    std::vector<StampNs> stamps;
    while (stamps.size() < count) {
        const bool stored = !track.stamps.empty() && random.uniform(0.0, 1.0) < 0.1;
        const StampNs last = static_cast<StampNs>(track.stamps.size()) - 1;
        const StampNs stamp = stored ? track.stamps[static_cast<std::size_t>(random.stamp(0, last))]
                                     : random.stamp(low, high);
        stamps.push_back(std::clamp(stamp, low, high));
    }
    if (sorted) {
        std::sort(stamps.begin(), stamps.end());
    }
    return stamps;
}

struct ScalarAnswer {
    Pose pose = identity();
    bool refused = false;
};

/// The poses of one side, composed upward; false where one is refused.
inline bool evaluate_side(std::span<const TrackView> side, const Rule& rule, StampNs stamp,
                          Pose& pose) {
    for (std::size_t i = 0; i < side.size(); ++i) {
        const Selected at = select_sample(side[i], rule, stamp);
        if (at.refused) {
            return false;
        }
        const Pose here = pose_at(side[i], at, stamp);
        pose = i == 0 ? here : compose(here, pose);
    }
    return true;
}

/// One stamp through pose.hpp, slerp.hpp and select_sample alone.
inline ScalarAnswer evaluate_one(const Path& path, const Rule& rule, StampNs stamp) {
    ScalarAnswer answer;
    Pose from_target = identity();
    answer.refused = !evaluate_side(path.source_side, rule, stamp, answer.pose) ||
                     !evaluate_side(path.target_side, rule, stamp, from_target);
    if (path.source_side.empty() && !path.target_side.empty()) {
        answer.pose = inverse(from_target);
    } else if (!path.target_side.empty()) {
        answer.pose = compose(inverse(from_target), answer.pose);
    }
    return answer;
}

}  // namespace tfdb::geometry::testing
