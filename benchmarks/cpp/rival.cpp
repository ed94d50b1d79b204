#include "rival.hpp"

#include <console_bridge/console.h>
#include <tf2/buffer_core.h>
#include <tf2/exceptions.h>

#include <utility>

namespace rival {
namespace {

const std::string kAuthority = "bench";

ros::Time ros_time(StampNs stamp) {
    ros::Time time;
    time.fromNSec(static_cast<std::uint64_t>(stamp));
    return time;
}

void put(const Pose7& pose, geometry_msgs::TransformStamped& message) {
    auto& t = message.transform.translation;
    auto& q = message.transform.rotation;
    std::size_t i = 0;
    for (double* value : {&t.x, &t.y, &t.z, &q.x, &q.y, &q.z, &q.w}) {
        *value = pose.values[i++];
    }
}

Pose7 pose_of(const geometry_msgs::TransformStamped& message) {
    const auto& t = message.transform.translation;
    const auto& q = message.transform.rotation;
    return {{t.x, t.y, t.z, q.x, q.y, q.z, q.w}};
}

geometry_msgs::TransformStamped make(const std::string& parent, const std::string& child,
                                     StampNs stamp, const Pose7& pose) {
    geometry_msgs::TransformStamped message;
    message.header.frame_id = parent;
    message.header.stamp = ros_time(stamp);
    message.child_frame_id = child;
    put(pose, message);
    return message;
}

template <class T>
void keep(const T& value) {
    asm volatile("" : : "r,m"(&value) : "memory");
}

}  // namespace

struct Messages::List {
    std::vector<geometry_msgs::TransformStamped> messages;
};

struct Question::Parts {
    std::string target, source;
    std::vector<ros::Time> times;
};

struct Tf2::Core {
    explicit Core(double seconds) : buffer(ros::Duration(seconds)) {}
    tf2::BufferCore buffer;
};

Messages::Messages() : list_(std::make_unique<List>()) {}
Messages::~Messages() = default;

void Messages::add(const std::string& parent, const std::string& child, StampNs stamp,
                   const Pose7& pose) {
    list_->messages.push_back(make(parent, child, stamp, pose));
}

Question::Question(std::string target, std::string source, const std::vector<StampNs>& stamps)
    : parts_(std::make_unique<Parts>()) {
    parts_->target = std::move(target);
    parts_->source = std::move(source);
    for (const StampNs stamp : stamps) {
        parts_->times.push_back(ros_time(stamp));
    }
}

Question::~Question() = default;

Tf2::Tf2(double cache_seconds) : core_(std::make_unique<Core>(cache_seconds)) {}
Tf2::~Tf2() = default;

bool Tf2::set(const std::string& parent, const std::string& child, StampNs stamp, const Pose7& pose,
              bool is_static) {
    return core_->buffer.setTransform(make(parent, child, stamp, pose), kAuthority, is_static);
}

Pose7 Tf2::get(const std::string& target, const std::string& source, StampNs stamp) const {
    return pose_of(core_->buffer.lookupTransform(target, source, ros_time(stamp)));
}

void Tf2::lookups(const Question& question, std::size_t count) const {
    const auto& [target, source, times] = question.parts();
    std::size_t which = 0;
    for (std::size_t i = 0; i < count; ++i) {
        keep(core_->buffer.lookupTransform(target, source, times[which]));
        which = which + 1 == times.size() ? 0 : which + 1;
    }
}

void Tf2::lookup_one(const Question& question, std::size_t which) const {
    const auto& [target, source, times] = question.parts();
    keep(core_->buffer.lookupTransform(target, source, times[which % times.size()]));
}

void Tf2::latest_lookups(const Question& question, std::size_t count) const {
    const auto& parts = question.parts();
    for (std::size_t i = 0; i < count; ++i) {
        keep(core_->buffer.lookupTransform(parts.target, parts.source, ros::Time(0)));
    }
}

void Tf2::can_transforms(const Question& question, std::size_t count) const {
    const auto& [target, source, times] = question.parts();
    std::size_t which = 0;
    for (std::size_t i = 0; i < count; ++i) {
        keep(core_->buffer.canTransform(target, source, times[which]));
        which = which + 1 == times.size() ? 0 : which + 1;
    }
}

void Tf2::failed_lookups(const Question& question, std::size_t count) const {
    const auto& parts = question.parts();
    for (std::size_t i = 0; i < count; ++i) {
        try {
            keep(core_->buffer.lookupTransform(parts.target, parts.source, parts.times[0]));
        } catch (const tf2::ExtrapolationException& error) {
            keep(error);
        }
    }
}

std::vector<Pose7> Tf2::all_lookups(const Question& question) const {
    const auto& [target, source, times] = question.parts();
    std::vector<Pose7> poses;
    poses.reserve(times.size());
    for (const ros::Time& time : times) {
        poses.push_back(pose_of(core_->buffer.lookupTransform(target, source, time)));
    }
    return poses;
}

void Tf2::insert(const Messages& messages) {
    for (const auto& message : messages.list().messages) {
        core_->buffer.setTransform(message, kAuthority);
    }
}

void Tf2::writes(Messages& messages, StampNs& stamp, StampNs period, std::size_t& turn,
                 const std::vector<Pose7>& poses, std::size_t count) {
    auto& list = messages.list().messages;
    for (std::size_t i = 0; i < count; ++i) {
        stamp += turn == 0 ? period : 0;
        geometry_msgs::TransformStamped& message = list[turn];
        message.header.stamp = ros_time(stamp);
        put(poses[i & (poses.size() - 1)], message);
        core_->buffer.setTransform(message, kAuthority);
        turn = turn + 1 == list.size() ? 0 : turn + 1;
    }
}

void silence() {
    console_bridge::setLogLevel(console_bridge::CONSOLE_BRIDGE_LOG_NONE);
}

}  // namespace rival
