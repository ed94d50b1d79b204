// The records of an MCAP chunk (https://mcap.dev/spec) in its uncompressed bytes. A record is one
// byte of kind, eight bytes of length, and its content.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace tfdb::wire {

/// Iterates over the records of one chunk. It trusts no number in the chunk: every result lies
/// inside the chunk.
/// Threads: one. Guarantee: allocates nothing, throws nothing; ends after at most one step per 9
/// bytes. The chunk outlives it.
class McapRecords {
public:
    static constexpr std::uint8_t kSchema = 3;
    static constexpr std::uint8_t kMessage = 5;
    /// The last kind that the format defines; later kinds must be ignored.
    static constexpr std::uint8_t kLastKnown = 0x0F;
    static constexpr std::size_t kHead = 9;

    explicit McapRecords(std::span<const std::byte> chunk) : chunk_(chunk) {}

    /// Moves to the next record. False: the chunk ends, or is truncated (`is_broken`).
    [[nodiscard]] bool next() noexcept;
    /// Whether the record at `at` exceeds the chunk's end.
    [[nodiscard]] bool is_broken() const noexcept { return at_ < chunk_.size(); }
    /// The record's start, and the length in its header.
    [[nodiscard]] std::size_t at() const noexcept { return at_; }
    [[nodiscard]] std::uint64_t length() const noexcept { return length_; }

    [[nodiscard]] std::uint8_t kind() const noexcept;
    [[nodiscard]] std::span<const std::byte> content() const noexcept;
    /// Whether it is a message of sufficient length.
    [[nodiscard]] bool is_message() const noexcept;
    /// Requires `is_message`.
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
