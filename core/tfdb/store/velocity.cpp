// Velocity by finite difference, as tf1's lookupTwist and tf2's lookupVelocity define it, with the
// lever arm taken as a cross product (both of those multiply element by element there).
#include <algorithm>
#include <cmath>

#include "tfdb/store/impl.hpp"

namespace tfdb {
namespace {

using geometry::Quat;
using geometry::Vec3;
using lookup::Outcome;

Vec3 cross(const Vec3& a, const Vec3& b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

/// The rotation vector that turns `from` into `to`, in the axes in which both are given.
Vec3 rotation_between(const Quat& from, const Quat& to) {
    Quat turn = geometry::multiply(to, geometry::conjugate(from));
    if (turn.w < 0.0)
        turn = {-turn.x, -turn.y, -turn.z, -turn.w};
    const double sine = std::sqrt(turn.x * turn.x + turn.y * turn.y + turn.z * turn.z);
    // Near zero angle / sin(angle / 2) tends to 2.
    const double scale = sine < 1e-12 ? 2.0 : 2.0 * std::atan2(sine, turn.w) / sine;
    return {turn.x * scale, turn.y * scale, turn.z * scale};
}

struct Frames {
    FrameId tracking;
    FrameId observation;
    FrameId reference;
    FrameId point_frame;
};

Outcome velocity_at(const StoreView& view, const Frames& frames, std::optional<StampNs> stamp,
                    StampNs interval, const Vec3& point, Twist& twist, Answer& answer,
                    Failure& failure) {
    StampNs newest = 0;
    Outcome outcome = lookup::latest_common_time(view, frames.observation, frames.tracking, answer,
                                                 newest, failure);
    if (outcome != Outcome::kOk)
        return outcome;
    const StampNs at = stamp.value_or(newest);
    // A window that would end after the newest data ends there, and keeps its length.
    const StampNs end = std::max(at, std::min(clock::saturating_add(at, interval / 2), newest));
    const StampNs start = end - interval;
    const auto pose_at = [&](FrameId target, FrameId source, StampNs when, Pose& pose) {
        const Outcome found = lookup::lookup(view, target, source, when, Policy{}, answer, failure);
        pose = answer.pose;
        return found;
    };
    Pose first;
    Pose last;
    Pose now;
    Pose point_to_observation;
    Pose to_reference;
    const auto& f = frames;
    if ((outcome = pose_at(f.observation, f.tracking, start, first)) != Outcome::kOk ||
        (outcome = pose_at(f.observation, f.tracking, end, last)) != Outcome::kOk ||
        (outcome = pose_at(f.observation, f.tracking, at, now)) != Outcome::kOk ||
        (outcome = pose_at(f.observation, f.point_frame, at, point_to_observation)) !=
            Outcome::kOk ||
        (outcome = pose_at(f.reference, f.observation, at, to_reference)) != Outcome::kOk) {
        return outcome;
    }
    const double dt = clock::to_seconds(interval);
    const Vec3 turn = rotation_between(first.rotation, last.rotation);
    const Vec3 angular{turn.x / dt, turn.y / dt, turn.z / dt};
    const Vec3 place = geometry::apply(point_to_observation, point);
    const Vec3 lever{place.x - now.translation.x, place.y - now.translation.y,
                     place.z - now.translation.z};
    const Vec3 swing = cross(angular, lever);
    const Vec3 linear{(last.translation.x - first.translation.x) / dt + swing.x,
                      (last.translation.y - first.translation.y) / dt + swing.y,
                      (last.translation.z - first.translation.z) / dt + swing.z};
    twist.linear = geometry::rotate(to_reference.rotation, linear);
    twist.angular = geometry::rotate(to_reference.rotation, angular);
    return Outcome::kOk;
}

}  // namespace

Twist Reads::lookup_velocity(std::string_view tracking, std::string_view observation,
                             std::optional<StampNs> stamp, StampNs interval,
                             std::string_view reference, geometry::Vec3 point,
                             std::string_view point_frame) const {
    if (interval <= 0) {
        throw InvalidArgument("the averaging interval must be positive, not " +
                              std::to_string(interval) + " ns");
    }
    if (reference.empty())
        reference = observation;
    if (point_frame.empty())
        point_frame = tracking;
    Twist twist{};
    Answer answer;
    Failure failure;
    const Outcome outcome = store::read(*impl_, held_, kFresh, [&](const StoreView& view) {
        const auto find = [&](std::string_view name) {
            return impl_->names.find(name, view.commit());
        };
        const Frames frames{find(tracking), find(observation), find(reference), find(point_frame)};
        return velocity_at(view, frames, stamp, interval, point, twist, answer, failure);
    });
    if (outcome == Outcome::kOk)
        return twist;
    if (outcome == Outcome::kLapped)
        store::throw_snapshot_too_old(held_, impl_->committed());
    raise(failure, observation, tracking);
}

}  // namespace tfdb
