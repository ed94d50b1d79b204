// The real tf2 (ROS 1, libtf2-dev) behind plain types: ROS 1's headers need C++17 and tfdb's C++20,
// so they never meet in one file. Loops that are timed stand in tf2.cpp, next to tf2, and pay
// nothing for this; a single call through it costs two nanoseconds, tf2's own hundreds.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace real_tf2 {

using StampNs = std::int64_t;  // 0 asks for the latest common time

/// [x y z qx qy qz qw]
struct Pose7 {
    double values[7];
};

/// An answer and the stamp that tf2 gives it.
struct Found {
    Pose7 pose{};
    StampNs stamp = 0;
};

/// tf2's "advanced" lookup: through a frame that does not move between two times.
struct TwoTimes {
    std::string target;
    StampNs target_stamp = 0;
    std::string source;
    StampNs source_stamp = 0;
    std::string fixed;
};

// Messages made ahead, as a subscriber's callback would hold them. Threads: one. Guarantee: none.
class Messages {
public:
    Messages();
    ~Messages();
    Messages(const Messages&) = delete;
    Messages& operator=(const Messages&) = delete;
    void add(const std::string& parent, const std::string& child, StampNs stamp, const Pose7& pose);

private:
    friend class Tf2;
    struct List;
    std::unique_ptr<List> list_;
};

// What to look up, with the stamps converted to ros::Time ahead; loops cycle through them.
// Threads: any, once made. Guarantee: none.
class Question {
public:
    Question(std::string target, std::string source, const std::vector<StampNs>& stamps);
    ~Question();
    Question(const Question&) = delete;
    Question& operator=(const Question&) = delete;

private:
    friend class Tf2;
    struct Parts;
    std::unique_ptr<Parts> parts_;
};

// A tf2::BufferCore. Threads: as tf2 allows, any. Guarantee: calls tf2 and adds nothing to it.
class Tf2 {
public:
    // Where one thread keeps its message. Threads: one. Guarantee: none.
    class Message {
    public:
        Message();
        ~Message();
        Message(const Message&) = delete;
        Message& operator=(const Message&) = delete;

    private:
        friend class Tf2;
        struct Parts;
        std::unique_ptr<Parts> parts_;
    };

    /// Refusals are not logged: it would be measured.
    explicit Tf2(StampNs cache);
    ~Tf2();
    Tf2(const Tf2&) = delete;
    Tf2& operator=(const Tf2&) = delete;

    /// False where tf2 refuses. `pose` has seven numbers.
    bool set(const std::string& parent, const std::string& child, StampNs stamp, const double* pose,
             Message& message, bool is_static = false);
    void clear();

    /// T[target<-source]; throws what tf2 throws, which `kind_of` tells apart.
    [[nodiscard]] Found get(const std::string& target, const std::string& source,
                            StampNs stamp) const;
    [[nodiscard]] Found get(const TwoTimes& asked) const;
    [[nodiscard]] bool can(const std::string& target, const std::string& source,
                           StampNs stamp) const;
    [[nodiscard]] bool can(const TwoTimes& asked) const;
    [[nodiscard]] StampNs latest_common(const std::string& target, const std::string& source) const;
    /// False where the frame has no parent at the stamp.
    [[nodiscard]] bool parent(const std::string& frame, StampNs stamp, std::string& parent) const;
    /// At the latest common time, which `used` then says. False where tf2 throws.
    bool newest(const std::string& target, const std::string& source, StampNs& used,
                Message& message) const;

    // The loops that are timed.
    void lookups(const Question& question, std::size_t count) const;
    void lookup_one(const Question& question, std::size_t which) const;
    void latest_lookups(const Question& question, std::size_t count) const;
    void can_transforms(const Question& question, std::size_t count) const;
    void failed_lookups(const Question& question, std::size_t count) const;
    [[nodiscard]] std::vector<Pose7> all_lookups(const Question& question) const;
    void insert(const Messages& messages);
    /// Writes one message after the other, in turns; `stamp` grows by `period` after each turn.
    void writes(Messages& messages, StampNs& stamp, StampNs period, std::size_t& turn,
                const std::vector<Pose7>& poses, std::size_t count);

private:
    struct Core;
    std::unique_ptr<Core> core_;
};

/// The class of an error that tf2 throws: connectivity, lookup, extrapolation, invalid or
/// transform; null for any other error.
const char* kind_of(const std::exception& error);

}  // namespace real_tf2
