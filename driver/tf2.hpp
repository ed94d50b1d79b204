// The real tf2 (ROS 1, libtf2-dev) behind plain types: its headers need C++17 and the driver C++20,
// so they never meet in one file. A call through this costs two nanoseconds, tf2's own hundreds.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

namespace tfdb::driver {

using Numbers7 = double[7];  // x y z, qx qy qz qw

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

    explicit Tf2(double cache_seconds);
    ~Tf2();
    Tf2(const Tf2&) = delete;
    Tf2& operator=(const Tf2&) = delete;

    /// False where tf2 refuses.
    bool set(const std::string& parent, const std::string& child, std::int64_t stamp,
             const double* pose, Message& message);
    /// At time 0: the latest common time, which `used` then says. False where tf2 throws.
    bool lookup(const std::string& target, const std::string& source, std::int64_t& used,
                Message& message) const;
    /// At a stamp, 0 for the latest common time; throws what tf2 throws.
    void get(const std::string& target, const std::string& source, std::int64_t stamp,
             Numbers7& pose, std::int64_t& used) const;

private:
    struct Core;
    std::unique_ptr<Core> core_;
};

}  // namespace tfdb::driver
