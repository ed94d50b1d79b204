#include "tf2.hpp"

#include <console_bridge/console.h>
#include <tf2/buffer_core.h>
#include <tf2/exceptions.h>

namespace tfdb::driver {
namespace {

const std::string kAuthority = "driver";

ros::Time ros_time(std::int64_t stamp) {
    ros::Time time;
    time.fromNSec(static_cast<std::uint64_t>(stamp));
    return time;
}

std::int64_t nanos(const ros::Time& time) {
    return static_cast<std::int64_t>(time.toNSec());
}

}  // namespace

struct Tf2::Message::Parts {
    geometry_msgs::TransformStamped message;
};

struct Tf2::Core {
    explicit Core(double seconds) : buffer(ros::Duration(seconds)) {}
    tf2::BufferCore buffer;
};

Tf2::Message::Message() : parts_(std::make_unique<Parts>()) {}
Tf2::Message::~Message() = default;

Tf2::Tf2(double cache_seconds) : core_(std::make_unique<Core>(cache_seconds)) {
    // It logs what it refuses; a measurement has no use for it.
    console_bridge::setLogLevel(console_bridge::CONSOLE_BRIDGE_LOG_NONE);
}
Tf2::~Tf2() = default;

bool Tf2::set(const std::string& parent, const std::string& child, std::int64_t stamp,
              const double* pose, Message& scratch) {
    geometry_msgs::TransformStamped& message = scratch.parts_->message;
    message.header.frame_id = parent;
    message.header.stamp = ros_time(stamp);
    message.child_frame_id = child;
    message.transform.translation.x = pose[0];
    message.transform.translation.y = pose[1];
    message.transform.translation.z = pose[2];
    message.transform.rotation.x = pose[3];
    message.transform.rotation.y = pose[4];
    message.transform.rotation.z = pose[5];
    message.transform.rotation.w = pose[6];
    return core_->buffer.setTransform(message, kAuthority);
}

bool Tf2::lookup(const std::string& target, const std::string& source, std::int64_t& used,
                 Message& scratch) const {
    try {
        scratch.parts_->message = core_->buffer.lookupTransform(target, source, ros::Time(0));
        used = nanos(scratch.parts_->message.header.stamp);
        return true;
    } catch (const tf2::TransformException&) {
        return false;
    }
}

void Tf2::get(const std::string& target, const std::string& source, std::int64_t stamp,
              Numbers7& pose, std::int64_t& used) const {
    const auto found = core_->buffer.lookupTransform(target, source, ros_time(stamp));
    const auto& t = found.transform.translation;
    const auto& q = found.transform.rotation;
    const Numbers7 values{t.x, t.y, t.z, q.x, q.y, q.z, q.w};
    for (int i = 0; i < 7; ++i) {
        pose[i] = values[i];
    }
    used = nanos(found.header.stamp);
}

}  // namespace tfdb::driver
