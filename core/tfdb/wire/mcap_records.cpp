#include "tfdb/wire/mcap_records.hpp"

#include <algorithm>

namespace tfdb::wire {

namespace {

// A message: channel, sequence, log time, publish time; then the payload.
constexpr std::size_t kChannelAt = McapRecords::kHead;
constexpr std::size_t kLogTimeAt = kChannelAt + 2 + 4;
constexpr std::size_t kPayloadAt = kLogTimeAt + 8 + 8;

}  // namespace

/// Little endian; bytes past the chunk's end count as zeros.
std::uint64_t McapRecords::number(std::size_t offset, std::size_t width) const noexcept {
    const std::size_t from = std::min(at_ + offset, chunk_.size());
    const std::size_t there = std::min(width, chunk_.size() - from);
    std::uint64_t value = 0;
    for (std::size_t i = 0; i < there; ++i)
        value |= std::to_integer<std::uint64_t>(chunk_[from + i]) << (8 * i);
    return value;
}

bool McapRecords::next() noexcept {
    at_ = next_;
    if (at_ >= chunk_.size())
        return false;
    length_ = number(1, 8);
    const std::size_t left = chunk_.size() - at_;
    if (left < kHead || length_ > left - kHead)
        return false;
    next_ = at_ + kHead + static_cast<std::size_t>(length_);
    return true;
}

std::uint8_t McapRecords::kind() const noexcept {
    return static_cast<std::uint8_t>(number(0, 1));
}

std::span<const std::byte> McapRecords::content() const noexcept {
    return chunk_.subspan(at_ + kHead, static_cast<std::size_t>(length_));
}

bool McapRecords::is_message() const noexcept {
    return kind() == kMessage && length_ >= kPayloadAt - kHead;
}

std::uint16_t McapRecords::channel() const noexcept {
    return static_cast<std::uint16_t>(number(kChannelAt, 2));
}

std::uint64_t McapRecords::log_time() const noexcept {
    return number(kLogTimeAt, 8);
}

std::span<const std::byte> McapRecords::payload() const noexcept {
    return chunk_.subspan(at_ + kPayloadAt, next_ - at_ - kPayloadAt);
}

}  // namespace tfdb::wire
