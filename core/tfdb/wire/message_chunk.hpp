// A chunk of a recording that is written: of an MCAP file (https://mcap.dev/spec) or of a ROS 1 bag
// (https://wiki.ros.org/Bags/Format/2.0). Both hold records of messages, and an index of these.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <span>
#include <vector>

namespace tfdb::wire {

/// The records of one chunk and where its messages lie.
/// Threads: one. Guarantee: where memory runs out, what was added last is there in part.
class MessageChunk {
public:
    enum class Format : std::uint8_t { kMcap, kBag };
    struct Index {
        std::uint32_t messages = 0;
        std::vector<std::byte> entries;  // as the format has them: time and offset of each
    };
    /// By channel of an MCAP file, or connection of a bag.
    using Indexes = std::map<std::uint32_t, Index>;

    explicit MessageChunk(Format format) : format_(format) {}

    /// Adds a record as it is.
    void add_record(std::span<const std::byte> record);
    /// Adds a message that was received at `time`, nanoseconds. A bag's times have 32 bits of
    /// seconds, an MCAP file's channels have 16 bits; higher bits are dropped.
    void add_message(std::uint32_t channel, std::uint64_t time, std::span<const std::byte> data);
    void clear();

    [[nodiscard]] const std::vector<std::byte>& bytes() const { return bytes_; }
    [[nodiscard]] const Indexes& indexes() const { return indexes_; }
    /// When the first and the last message were received; without messages, the last is the
    /// earlier.
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
