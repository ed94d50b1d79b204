// CRC-32C (Castagnoli), as in iSCSI (RFC 3720, appendix B.4): polynomial 0x1EDC6F41, reflected.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>

#include "tfdb/wire/layout.hpp"

namespace tfdb::wire {

namespace crc32c_tables {

constexpr std::uint32_t kReflected = 0x82F6'3B78;

/// Table i is for bytes `kSlices - 1 - i` positions before the end.
inline constexpr std::size_t kSlices = 8;
using Tables = std::array<std::array<std::uint32_t, 256>, kSlices>;

constexpr Tables make() {
    Tables tables{};
    for (std::uint32_t byte = 0; byte < 256; ++byte) {
        std::uint32_t sum = byte;
        for (int bit = 0; bit < 8; ++bit)
            sum = sum >> 1 ^ ((sum & 1) != 0 ? kReflected : 0);
        tables[0][byte] = sum;
    }
    for (std::size_t slice = 1; slice < kSlices; ++slice) {
        for (std::size_t byte = 0; byte < 256; ++byte) {
            const std::uint32_t before = tables[slice - 1][byte];
            tables[slice][byte] = before >> 8 ^ tables[0][before & 0xFF];
        }
    }
    return tables;
}

inline constexpr Tables kTables = make();

}  // namespace crc32c_tables

/// Continues a checksum over more bytes, eight at a time ("slicing-by-8", Kounavis and Berry 2005).
[[nodiscard]] inline std::uint32_t crc32c_by_tables(std::uint32_t sum,
                                                    std::span<const std::byte> data) noexcept {
    using crc32c_tables::kSlices;
    using crc32c_tables::kTables;
    while (data.size() >= kSlices) {
        const std::uint32_t low = sum ^ load_u32<kCdrLittleLayout>(data.data());
        const std::uint32_t high = load_u32<kCdrLittleLayout>(data.data() + 4);
        sum = kTables[7][low & 0xFF] ^ kTables[6][low >> 8 & 0xFF] ^ kTables[5][low >> 16 & 0xFF] ^
              kTables[4][low >> 24] ^ kTables[3][high & 0xFF] ^ kTables[2][high >> 8 & 0xFF] ^
              kTables[1][high >> 16 & 0xFF] ^ kTables[0][high >> 24];
        data = data.subspan(kSlices);
    }
    for (const std::byte byte : data)
        sum = sum >> 8 ^ kTables[0][(sum ^ std::to_integer<std::uint32_t>(byte)) & 0xFF];
    return sum;
}

#ifdef __x86_64__
/// The same with the processor's own instruction.
[[nodiscard, gnu::target("sse4.2")]] inline std::uint32_t crc32c_by_sse42(
    std::uint32_t sum, std::span<const std::byte> data) noexcept {
    std::uint64_t wide = sum;
    for (; data.size() >= 8; data = data.subspan(8)) {
        std::uint64_t word = 0;
        std::memcpy(&word, data.data(), sizeof word);
        wide = __builtin_ia32_crc32di(wide, word);
    }
    sum = static_cast<std::uint32_t>(wide);
    for (const std::byte byte : data)
        sum = __builtin_ia32_crc32qi(sum, std::to_integer<unsigned char>(byte));
    return sum;
}
#endif

/// The checksum of all bytes.
[[nodiscard]] inline std::uint32_t crc32c(std::span<const std::byte> data) noexcept {
    constexpr std::uint32_t kStart = ~std::uint32_t{0};
#ifdef __x86_64__
    if (__builtin_cpu_supports("sse4.2"))
        return ~crc32c_by_sse42(kStart, data);
#endif
    return ~crc32c_by_tables(kStart, data);
}

}  // namespace tfdb::wire
