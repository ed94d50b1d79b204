// The differences between the encodings of a TFMessage, as compile-time constants. Private to
// wire/.
#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>

#include "tfdb/clock/stamp.hpp"
#include "tfdb/geometry/pose.hpp"
#include "tfdb/wire/tf_message.hpp"

namespace tfdb::wire {

// Lengths on the wire have 32 bits, so their sums cannot wrap.
static_assert(sizeof(std::size_t) >= 8, "offsets are computed without overflow checks");
static_assert(sizeof(double) == 8 && std::numeric_limits<double>::is_iec559);
static_assert(std::endian::native == std::endian::little || std::endian::native == std::endian::big,
              "no mixed-endian machines");

// The traits of one encoding.
// Threads: a constant. Guarantee: structural, so that each layout gets its own decoder.
struct Layout {
    std::endian order;
    std::size_t max_alignment;  // 1: packed
    std::size_t prefix_bytes;   // of a transform, before its stamp
    std::size_t closing_nul;    // 1 if a string's length counts a NUL
    bool delimited;             // a size in bytes precedes the sequence
    std::size_t max_trailing;   // bytes that may follow the message
    std::uint32_t max_seconds;  // greater values are negative
    std::size_t min_transform;  // bytes of a transform without names
    std::uint8_t header_id;     // second byte of the encapsulation header
};

inline constexpr std::uint32_t kMaxUnsignedSeconds = std::numeric_limits<std::uint32_t>::max();
inline constexpr std::uint32_t kMaxSignedSeconds = std::numeric_limits<std::int32_t>::max();
inline constexpr std::size_t kHeaderBytes = 4;
inline constexpr std::size_t kPoseBytes = 7 * sizeof(double);

constexpr Layout cdr_layout(std::endian order, std::uint8_t header_id) {
    return {
        .order = order,
        .max_alignment = 8,
        .prefix_bytes = 0,
        .closing_nul = 1,
        .delimited = false,
        .max_trailing = 3,
        .max_seconds = kMaxSignedSeconds,
        .min_transform = 80,
        .header_id = header_id,
    };
}

constexpr Layout cdr2_layout(std::endian order, std::uint8_t header_id) {
    Layout layout = cdr_layout(order, header_id);
    layout.max_alignment = 4;
    layout.delimited = true;
    return layout;
}

inline constexpr Layout kRos1Layout{
    .order = std::endian::little,
    .max_alignment = 1,
    .prefix_bytes = 4,
    .closing_nul = 0,
    .delimited = false,
    .max_trailing = 0,
    .max_seconds = kMaxUnsignedSeconds,
    .min_transform = 76,
    .header_id = 0,
};
inline constexpr Layout kCdrBigLayout = cdr_layout(std::endian::big, 0x00);
inline constexpr Layout kCdrLittleLayout = cdr_layout(std::endian::little, 0x01);
inline constexpr Layout kCdr2BigLayout = cdr2_layout(std::endian::big, 0x06);
inline constexpr Layout kCdr2LittleLayout = cdr2_layout(std::endian::little, 0x07);

/// Bytes to skip from `position`, relative to the alignment origin, to a field of `size`.
template <Layout kLayout>
constexpr std::size_t padding(std::size_t position, std::size_t size) noexcept {
    const std::size_t alignment = size < kLayout.max_alignment ? size : kLayout.max_alignment;
    return (0 - position) & (alignment - 1);
}

template <Layout kLayout>
constexpr std::uint32_t in_order(std::uint32_t word) noexcept {
    return kLayout.order == std::endian::native ? word : __builtin_bswap32(word);
}

template <Layout kLayout>
constexpr std::uint64_t in_order(std::uint64_t word) noexcept {
    return kLayout.order == std::endian::native ? word : __builtin_bswap64(word);
}

template <Layout kLayout>
std::uint32_t load_u32(const std::byte* from) noexcept {
    std::uint32_t word = 0;
    std::memcpy(&word, from, sizeof word);
    return in_order<kLayout>(word);
}

template <Layout kLayout>
void store_u32(std::byte* to, std::uint32_t word) noexcept {
    word = in_order<kLayout>(word);
    std::memcpy(to, &word, sizeof word);
}

// A pose has the same layout on the wire and in memory: x y z, then qx qy qz qw.
static_assert(sizeof(geometry::Pose) == kPoseBytes);

template <Layout kLayout>
void load_pose(const std::byte* from, geometry::Pose& pose) noexcept {
    std::array<std::uint64_t, 7> words{};
    std::memcpy(words.data(), from, kPoseBytes);
    for (std::uint64_t& word : words) {
        word = in_order<kLayout>(word);
    }
    std::memcpy(&pose, words.data(), kPoseBytes);
}

template <Layout kLayout>
void store_pose(std::byte* to, const geometry::Pose& pose) noexcept {
    std::array<std::uint64_t, 7> words{};
    std::memcpy(words.data(), &pose, kPoseBytes);
    for (std::uint64_t& word : words) {
        word = in_order<kLayout>(word);
    }
    std::memcpy(to, words.data(), kPoseBytes);
}

}  // namespace tfdb::wire
