// The real tf2 behind plain types. ROS 1's headers need C++17 and tfdb's C++20, so they never meet
// in one file: the loops that are timed stand in rival.cpp, next to tf2, and pay nothing for this.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace rival {

using StampNs = std::int64_t;

/// [x y z qx qy qz qw]
struct Pose7 {
    double values[7];
};

/// Messages made ahead, as a subscriber's callback would hold them.
class Messages {
public:
    Messages();
    ~Messages();
    Messages(const Messages&) = delete;
    Messages& operator=(const Messages&) = delete;
    void add(const std::string& parent, const std::string& child, StampNs stamp, const Pose7& pose);

    struct List;
    [[nodiscard]] List& list() const { return *list_; }

private:
    std::unique_ptr<List> list_;
};

/// What to look up, with the stamps converted to ros::Time ahead; loops cycle through them.
class Question {
public:
    Question(std::string target, std::string source, const std::vector<StampNs>& stamps);
    ~Question();
    Question(const Question&) = delete;
    Question& operator=(const Question&) = delete;

    struct Parts;
    [[nodiscard]] const Parts& parts() const { return *parts_; }

private:
    std::unique_ptr<Parts> parts_;
};

/// A tf2::BufferCore. Threads: as tf2 allows, any. Guarantee: calls tf2 and adds nothing to it.
class Tf2 {
public:
    explicit Tf2(double cache_seconds);
    ~Tf2();
    Tf2(const Tf2&) = delete;
    Tf2& operator=(const Tf2&) = delete;

    bool set(const std::string& parent, const std::string& child, StampNs stamp, const Pose7& pose,
             bool is_static = false);
    /// T[target<-source] at a stamp; throws what tf2 throws.
    [[nodiscard]] Pose7 get(const std::string& target, const std::string& source,
                            StampNs stamp) const;

    // The loops that are timed.
    void lookups(const Question& question, std::size_t count) const;
    void lookup_one(const Question& question, std::size_t which) const;
    void latest_lookups(const Question& question, std::size_t count) const;
    void can_transforms(const Question& question, std::size_t count) const;
    void failed_lookups(const Question& question, std::size_t count) const;
    [[nodiscard]] std::vector<Pose7> all_lookups(const Question& question) const;
    void insert(const Messages& messages);
    /// Writes one message after the other, round robin; `stamp` grows by `period` each round.
    void writes(Messages& messages, StampNs& stamp, StampNs period, std::size_t& turn,
                const std::vector<Pose7>& poses, std::size_t count);

private:
    struct Core;
    std::unique_ptr<Core> core_;
};

/// tf2 logs what it refuses; a benchmark has no use for it.
void silence();

}  // namespace rival
