// Size classes of blocks: thirty-two per power of two, so at most 3 % of a block is lost to
// rounding.
#pragma once

#include <bit>
#include <cstddef>

#include "tfdb/memory/memory.hpp"

namespace tfdb::memory {

inline constexpr unsigned kClassBits = 5;
inline constexpr unsigned kSizeClasses = 32 * 48;

struct BlockClass {
    unsigned index;
    std::size_t bytes;  // actual size of a block of this class
};

/// The class that fits `bytes`: sizes are (32 + m) * 2^k lines for m in 0..31, or up to 32 lines.
constexpr BlockClass block_class(std::size_t bytes) {
    const std::size_t lines = bytes == 0 ? 1 : (bytes + kLineBytes - 1) / kLineBytes;
    if (lines <= 32)
        return {static_cast<unsigned>(lines - 1), lines * kLineBytes};
    const unsigned shift = static_cast<unsigned>(std::bit_width(lines - 1)) - kClassBits - 1;
    const std::size_t step = std::size_t{1} << shift;
    const std::size_t rounded = (lines + step - 1) / step;  // 33..64
    const unsigned mantissa = static_cast<unsigned>(rounded - 33);
    return {32 + shift * 32 + mantissa, rounded * step * kLineBytes};
}

/// Block size of a class.
constexpr std::size_t class_bytes(unsigned index) {
    if (index < 32)
        return (index + std::size_t{1}) * kLineBytes;
    return (33 + std::size_t{index} % 32) * kLineBytes << (index / 32 - 1);
}

/// The greatest number of lines, at most this many and at least one, that fill a block without
/// waste.
constexpr std::size_t whole_block_lines(std::size_t lines) {
    const int spare = static_cast<int>(std::bit_width(lines)) - static_cast<int>(kClassBits) - 1;
    return spare <= 0 ? lines : lines >> spare << spare;
}

}  // namespace tfdb::memory
