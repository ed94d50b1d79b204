// A chunk of a recording being written: of an MCAP file (https://mcap.dev/spec) or of a ROS 1 bag
// (https://wiki.ros.org/Bags/Format/2.0). Both hold records of messages and an index.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <span>
#include <vector>

namespace tfdb::wire {

/// The records of one chunk, and the offsets of its messages.
/// Threads: one. Guarantee: if memory runs out, the last addition may be incomplete.
class MessageChunk {
public:
    enum class Format : std::uint8_t { kMcap, kBag };
    struct Index {
        std::uint32_t messages = 0;
        std::vector<std::byte> entries;  // in the file's format: time and offset of each message
    };
    /// By channel of an MCAP file, or by connection of a bag.
    using Indexes = std::map<std::uint32_t, Index>;

    explicit MessageChunk(Format format) : format_(format) {}

    /// Adds a record unchanged.
    void add_record(std::span<const std::byte> record);
    /// Adds a message received at `time`, in nanoseconds. A bag's times have 32 bits of seconds, an
    /// MCAP file's channels have 16 bits; higher bits are dropped.
    void add_message(std::uint32_t channel, std::uint64_t time, std::span<const std::byte> data);
    void clear();

    [[nodiscard]] const std::vector<std::byte>& bytes() const { return bytes_; }
    [[nodiscard]] const Indexes& indexes() const { return indexes_; }
    /// Receive times of the first and last message. Without messages, the last is before the first.
    [[nodiscard]] std::uint64_t start() const { return start_; }
    [[nodiscard]] std::uint64_t end() const { return end_; }

private:
    Format format_;
    std::vector<std::byte> bytes_;
    Indexes indexes_;
    std::uint64_t start_ = UINT64_MAX;
    std::uint64_t end_ = 0;
};

}  // namespace tfdb::wire
