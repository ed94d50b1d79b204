#include "tf2.hpp"

#include <console_bridge/console.h>
#include <tf2/buffer_core.h>
#include <tf2/exceptions.h>
#include <tf2_msgs/TF2Error.h>

#include <utility>

namespace real_tf2 {
namespace {

const std::string kAuthority = "measure";

ros::Time ros_time(StampNs stamp) {
    ros::Time time;
    time.fromNSec(static_cast<std::uint64_t>(stamp));
    return time;
}

StampNs nanos(const ros::Time& time) {
    return static_cast<StampNs>(time.toNSec());
}

void put(const double* pose, geometry_msgs::TransformStamped& message) {
    auto& t = message.transform.translation;
    auto& q = message.transform.rotation;
    for (double* value : {&t.x, &t.y, &t.z, &q.x, &q.y, &q.z, &q.w}) {
        *value = *pose++;
    }
}

Pose7 pose_of(const geometry_msgs::TransformStamped& message) {
    const auto& t = message.transform.translation;
    const auto& q = message.transform.rotation;
    return {{t.x, t.y, t.z, q.x, q.y, q.z, q.w}};
}

Found found(const geometry_msgs::TransformStamped& message) {
    return {pose_of(message), nanos(message.header.stamp)};
}

void fill(geometry_msgs::TransformStamped& message, const std::string& parent,
          const std::string& child, StampNs stamp, const double* pose) {
    message.header.frame_id = parent;
    message.header.stamp = ros_time(stamp);
    message.child_frame_id = child;
    put(pose, message);
}

template <class T>
void keep(const T& value) {
    asm volatile("" : : "r,m"(&value) : "memory");
}

}  // namespace

struct Tf2::Message::Parts {
    geometry_msgs::TransformStamped message;
};

struct Messages::List {
    std::vector<geometry_msgs::TransformStamped> messages;
};

struct Question::Parts {
    std::string target, source;
    std::vector<ros::Time> times;
};

struct Tf2::Core {
    explicit Core(StampNs cache) : buffer(ros::Duration().fromNSec(cache)) {}
    tf2::BufferCore buffer;
};

Tf2::Message::Message() : parts_(std::make_unique<Parts>()) {}
Tf2::Message::~Message() = default;

Messages::Messages() : list_(std::make_unique<List>()) {}
Messages::~Messages() = default;

void Messages::add(const std::string& parent, const std::string& child, StampNs stamp,
                   const Pose7& pose) {
    list_->messages.emplace_back();
    fill(list_->messages.back(), parent, child, stamp, pose.values);
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

Tf2::Tf2(StampNs cache) : core_(std::make_unique<Core>(cache)) {
    console_bridge::setLogLevel(console_bridge::CONSOLE_BRIDGE_LOG_NONE);
}
Tf2::~Tf2() = default;

bool Tf2::set(const std::string& parent, const std::string& child, StampNs stamp,
              const double* pose, Message& message, bool is_static) {
    fill(message.parts_->message, parent, child, stamp, pose);
    return core_->buffer.setTransform(message.parts_->message, kAuthority, is_static);
}

void Tf2::clear() {
    core_->buffer.clear();
}

Found Tf2::get(const std::string& target, const std::string& source, StampNs stamp) const {
    return found(core_->buffer.lookupTransform(target, source, ros_time(stamp)));
}

Found Tf2::get(const TwoTimes& asked) const {
    return found(core_->buffer.lookupTransform(asked.target, ros_time(asked.target_stamp),
                                               asked.source, ros_time(asked.source_stamp),
                                               asked.fixed));
}

bool Tf2::can(const std::string& target, const std::string& source, StampNs stamp) const {
    return core_->buffer.canTransform(target, source, ros_time(stamp));
}

bool Tf2::can(const TwoTimes& asked) const {
    return core_->buffer.canTransform(asked.target, ros_time(asked.target_stamp), asked.source,
                                      ros_time(asked.source_stamp), asked.fixed);
}

StampNs Tf2::latest_common(const std::string& target, const std::string& source) const {
    auto& buffer = core_->buffer;
    ros::Time time;
    std::string text;
    const auto id_of = [&](const std::string& frame) {
        return buffer._validateFrameId("latest", frame);
    };
    const int code = buffer._getLatestCommonTime(id_of(target), id_of(source), time, &text);
    if (code == tf2_msgs::TF2Error::CONNECTIVITY_ERROR) {
        throw tf2::ConnectivityException(text);
    }
    if (code != tf2_msgs::TF2Error::NO_ERROR) {
        throw tf2::TransformException(text);
    }
    return nanos(time);
}

bool Tf2::parent(const std::string& frame, StampNs stamp, std::string& parent) const {
    return core_->buffer._getParent(frame, ros_time(stamp), parent);
}

bool Tf2::newest(const std::string& target, const std::string& source, StampNs& used,
                 Message& message) const {
    try {
        message.parts_->message = core_->buffer.lookupTransform(target, source, ros::Time(0));
        used = nanos(message.parts_->message.header.stamp);
        return true;
    } catch (const tf2::TransformException&) {
        return false;
    }
}

void Tf2::lookups(const Question& question, std::size_t count) const {
    const auto& [target, source, times] = *question.parts_;
    std::size_t which = 0;
    for (std::size_t i = 0; i < count; ++i) {
        keep(core_->buffer.lookupTransform(target, source, times[which]));
        which = which + 1 == times.size() ? 0 : which + 1;
    }
}

void Tf2::lookup_one(const Question& question, std::size_t which) const {
    const auto& [target, source, times] = *question.parts_;
    keep(core_->buffer.lookupTransform(target, source, times[which % times.size()]));
}

void Tf2::latest_lookups(const Question& question, std::size_t count) const {
    const auto& parts = *question.parts_;
    for (std::size_t i = 0; i < count; ++i) {
        keep(core_->buffer.lookupTransform(parts.target, parts.source, ros::Time(0)));
    }
}

void Tf2::can_transforms(const Question& question, std::size_t count) const {
    const auto& [target, source, times] = *question.parts_;
    std::size_t which = 0;
    for (std::size_t i = 0; i < count; ++i) {
        keep(core_->buffer.canTransform(target, source, times[which]));
        which = which + 1 == times.size() ? 0 : which + 1;
    }
}

void Tf2::failed_lookups(const Question& question, std::size_t count) const {
    const auto& parts = *question.parts_;
    for (std::size_t i = 0; i < count; ++i) {
        try {
            keep(core_->buffer.lookupTransform(parts.target, parts.source, parts.times[0]));
        } catch (const tf2::ExtrapolationException& error) {
            keep(error);
        }
    }
}

std::vector<Pose7> Tf2::all_lookups(const Question& question) const {
    const auto& [target, source, times] = *question.parts_;
    std::vector<Pose7> poses;
    poses.reserve(times.size());
    for (const ros::Time& time : times) {
        poses.push_back(pose_of(core_->buffer.lookupTransform(target, source, time)));
    }
    return poses;
}

void Tf2::insert(const Messages& messages) {
    for (const auto& message : messages.list_->messages) {
        core_->buffer.setTransform(message, kAuthority);
    }
}

void Tf2::writes(Messages& messages, StampNs& stamp, StampNs period, std::size_t& turn,
                 const std::vector<Pose7>& poses, std::size_t count) {
    auto& list = messages.list_->messages;
    for (std::size_t i = 0; i < count; ++i) {
        stamp += turn == 0 ? period : 0;
        geometry_msgs::TransformStamped& message = list[turn];
        message.header.stamp = ros_time(stamp);
        put(poses[i & (poses.size() - 1)].values, message);
        core_->buffer.setTransform(message, kAuthority);
        turn = turn + 1 == list.size() ? 0 : turn + 1;
    }
}

const char* kind_of(const std::exception& error) {
    if (dynamic_cast<const tf2::ConnectivityException*>(&error) != nullptr) {
        return "connectivity";
    }
    if (dynamic_cast<const tf2::LookupException*>(&error) != nullptr) {
        return "lookup";
    }
    if (dynamic_cast<const tf2::ExtrapolationException*>(&error) != nullptr) {
        return "extrapolation";
    }
    if (dynamic_cast<const tf2::InvalidArgumentException*>(&error) != nullptr) {
        return "invalid";
    }
    return dynamic_cast<const tf2::TransformException*>(&error) != nullptr ? "transform" : nullptr;
}

}  // namespace real_tf2
