// The records of an MCAP chunk (https://mcap.dev/spec), as they lie in its unpacked bytes. A record
// is one byte of kind, eight of length, and its content.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace tfdb::wire {

/// Walks over the records of one chunk. No number in it is trusted: what is given out lies in the
/// chunk, whatever the chunk says.
/// Threads: one. Guarantee: allocates nothing, throws nothing; ends after at most one step for
/// every 9 bytes. The chunk outlives it.
class McapRecords {
public:
    static constexpr std::uint8_t kSchema = 3;
    static constexpr std::uint8_t kMessage = 5;
    /// The last kind that the format has given a meaning; those behind it are to be ignored.
    static constexpr std::uint8_t kLastKnown = 0x0F;
    static constexpr std::size_t kHead = 9;

    explicit McapRecords(std::span<const std::byte> chunk) : chunk_(chunk) {}

    /// Goes to the next record. False: the chunk ends, or it breaks off (`is_broken`).
    [[nodiscard]] bool next() noexcept;
    /// Whether the record at `at` goes beyond the chunk's end.
    [[nodiscard]] bool is_broken() const noexcept { return at_ < chunk_.size(); }
    /// The record's begin, and the length in its header.
    [[nodiscard]] std::size_t at() const noexcept { return at_; }
    [[nodiscard]] std::uint64_t length() const noexcept { return length_; }

    [[nodiscard]] std::uint8_t kind() const noexcept;
    [[nodiscard]] std::span<const std::byte> content() const noexcept;
    /// Whether it is a message, and long enough to be one.
    [[nodiscard]] bool is_message() const noexcept;
    /// Of a message (`is_message`).
    [[nodiscard]] std::uint16_t channel() const noexcept;
    [[nodiscard]] std::uint64_t log_time() const noexcept;
    [[nodiscard]] std::span<const std::byte> payload() const noexcept;

private:
    [[nodiscard]] std::uint64_t number(std::size_t offset, std::size_t width) const noexcept;

    std::span<const std::byte> chunk_;
    std::size_t at_ = 0;
    std::size_t next_ = 0;
    std::uint64_t length_ = 0;
};

}  // namespace tfdb::wire
