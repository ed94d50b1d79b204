// Velocity by finite difference, as in tf1's lookupTwist and tf2's lookupVelocity, but with the
// lever arm as a cross product (both of those multiply element by element there).
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <string_view>

#include "tfdb/lookup/lookup.hpp"
#include "tfdb/store/buffer.hpp"
#include "tfdb/store/question.hpp"

namespace tfdb::store {

using geometry::Quat;
using geometry::Vec3;

inline Vec3 cross(const Vec3& a, const Vec3& b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

/// The rotation vector from `from` to `to`, in their common axes.
inline Vec3 rotation_between(const Quat& from, const Quat& to) {
    Quat turn = geometry::multiply(to, geometry::conjugate(from));
    if (turn.w < 0.0)
        turn = {-turn.x, -turn.y, -turn.z, -turn.w};
    const double sine = std::sqrt(turn.x * turn.x + turn.y * turn.y + turn.z * turn.z);
    // Near zero, angle / sin(angle / 2) tends to 2.
    const double scale = sine < 1e-12 ? 2.0 : 2.0 * std::atan2(sine, turn.w) / sine;
    return {turn.x * scale, turn.y * scale, turn.z * scale};
}

enum Role : std::size_t { kTarget, kSource, kReference, kPointFrame, kRoles };

using Frames = std::array<FrameId, kRoles>;

/// The arguments of StoreReader::lookup_velocity, with defaults filled in.
struct VelocityQuestion {
    std::array<std::string_view, kRoles> names;  // by role
    std::optional<StampNs> stamp;
    StampNs interval;
    Vec3 point;
};

/// The two frames looked up last: errors name them.
struct Asked {
    Role target = kTarget;
    Role source = kSource;

    [[nodiscard]] Question about(const VelocityQuestion& question) const {
        return by_name(Question::kAt, question.names[target], question.names[source]);
    }
};

/// Throws InvalidArgument. Empty names: reference = target, point_frame = source.
[[nodiscard]] VelocityQuestion velocity_question(std::string_view target, std::string_view source,
                                                 std::optional<StampNs> stamp, StampNs interval,
                                                 std::string_view reference, const Vec3& point,
                                                 std::string_view point_frame);

/// The interval of the difference: as long as requested if the data around the stamp suffice, and
/// moved to lie inside the data.
struct Window {
    StampNs start = 0;
    StampNs end = 0;
};

/// kFailed if the data have only one stamp.
template <lookup::View V>
[[nodiscard]] lookup::Outcome find_window(const V& view, const Answer& path, StampNs stamp,
                                          StampNs interval, Window& window, Failure& failure) {
    using lookup::Outcome;
    StampNs from = std::max<StampNs>(0, stamp - interval);
    StampNs to = clock::saturating_add(stamp, interval);
    FrameHandle child;
    FrameHandle parent;
    for (const lookup::EdgeUse& use : path.edges) {
        const StampNs length = to - from;
        const Outcome outcome =
            lookup::narrow_to_edge(view, use.child, use.parent, stamp, from, to);
        // The interval's data were evicted in between.
        if (outcome != Outcome::kOk)
            return Outcome::kLapped;
        if (to - from == length)
            continue;
        child = {use.child, use.generation};
        parent = {use.parent, use.parent_generation};
    }
    window.start = std::max(from, stamp - interval / 2);
    window.end = std::min(to, clock::saturating_add(window.start, interval));
    window.start = std::max(from, window.end - interval);
    if (window.start < window.end)
        return Outcome::kOk;
    failure = Failure{};
    failure.code = ErrorCode::kExtrapolation;
    failure.frame = child;
    failure.other = parent;
    failure.stamp = failure.oldest = failure.newest = stamp;
    failure.commit = view.commit();
    return Outcome::kFailed;
}

/// `find(name)`: the frame of that name in the view. `check(target, source)`: kOk, or why an answer
/// over the path between the two is refused.
template <lookup::View V, class Find, class Check>
[[nodiscard]] lookup::Outcome velocity_at(const V& view, Find find, Check check,
                                          const VelocityQuestion& question, Twist& twist,
                                          Asked& asked, Failure& failure) {
    using lookup::Outcome;
    Frames frames{};
    for (std::size_t i = 0; i < kRoles; ++i)
        frames[i] = find(question.names[i]);
    Answer answer;
    const auto pose_at = [&](Role target, Role source, std::optional<StampNs> when, Pose& pose) {
        asked = {target, source};
        const Outcome found =
            lookup::lookup(view, frames[target], frames[source], when, Policy{}, answer, failure);
        pose = answer.pose;
        return found == Outcome::kOk ? check(frames[target], frames[source]) : found;
    };
    Pose first;
    Pose last;
    Pose now;
    Pose point_to_target;
    Pose to_reference;
    Window window;
    Outcome outcome = pose_at(kTarget, kSource, question.stamp, now);
    if (outcome != Outcome::kOk)
        return outcome;
    const StampNs at = answer.stamp;
    if ((outcome = find_window(view, answer, at, question.interval, window, failure)) !=
            Outcome::kOk ||
        (outcome = pose_at(kTarget, kSource, window.start, first)) != Outcome::kOk ||
        (outcome = pose_at(kTarget, kSource, window.end, last)) != Outcome::kOk ||
        (outcome = pose_at(kTarget, kPointFrame, at, point_to_target)) != Outcome::kOk ||
        (outcome = pose_at(kReference, kTarget, at, to_reference)) != Outcome::kOk) {
        return outcome;
    }
    const double dt = clock::to_seconds(window.end - window.start);
    const Vec3 turn = rotation_between(first.rotation, last.rotation);
    const Vec3 angular{turn.x / dt, turn.y / dt, turn.z / dt};
    const Vec3 place = geometry::apply(point_to_target, question.point);
    const Vec3 lever{place.x - now.translation.x, place.y - now.translation.y,
                     place.z - now.translation.z};
    const Vec3 swing = cross(angular, lever);
    const Vec3 linear{(last.translation.x - first.translation.x) / dt + swing.x,
                      (last.translation.y - first.translation.y) / dt + swing.y,
                      (last.translation.z - first.translation.z) / dt + swing.z};
    twist.linear = geometry::rotate(to_reference.rotation, linear);
    twist.angular = geometry::rotate(to_reference.rotation, angular);
    asked = Asked{};
    const Pose moved{twist.linear, geometry::identity().rotation};
    return lookup::detail::check_finite(view, at, moved, failure);
}

}  // namespace tfdb::store
