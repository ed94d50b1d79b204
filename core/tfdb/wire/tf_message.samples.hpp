// Messages for this room's tests, fuzzer and benchmark.
#pragma once

#include <cstddef>
#include <cstring>
#include <deque>
#include <random>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "tfdb/wire/tf_message.hpp"

namespace tfdb::wire::testing {

inline constexpr Encoding kAllEncodings[] = {
    Encoding::kRos1,       Encoding::kCdr,     Encoding::kCdrLittle,     Encoding::kCdrBig,
    Encoding::kCdr2Little, Encoding::kCdr2Big, Encoding::kCdrBareLittle, Encoding::kCdrBareBig,
};

/// Bitwise equality: -0.0 differs from 0.0, and a NaN equals itself.
inline bool same_bits(std::span<const TransformView> a, std::span<const TransformView> b) {
    if (a.size() != b.size()) {
        return false;
    }
    for (std::size_t i = 0; i < a.size(); ++i) {
        if (a[i].parent != b[i].parent || a[i].child != b[i].child || a[i].stamp != b[i].stamp ||
            std::memcmp(&a[i].pose, &b[i].pose, sizeof a[i].pose) != 0) {
            return false;
        }
    }
    return true;
}

inline std::span<const std::byte> as_bytes(std::string_view text) {
    return std::as_bytes(std::span<const char>(text.data(), text.size()));
}

inline std::vector<std::byte> from_hex(std::string_view hex) {
    const auto digit = [](char c) { return c <= '9' ? c - '0' : c - 'a' + 10; };
    std::vector<std::byte> bytes;
    for (std::size_t i = 0; i + 1 < hex.size(); i += 2) {
        bytes.push_back(static_cast<std::byte>(digit(hex[i]) * 16 + digit(hex[i + 1])));
    }
    return bytes;
}

/// Whether a decoder passes it on although the store refuses it and no encoder accepts it.
inline bool is_bad(const TransformView& transform) {
    return transform.stamp < 0 || transform.parent.find('\0') != std::string_view::npos ||
           transform.child.find('\0') != std::string_view::npos;
}

// A message that owns the names of its views.
struct RandomMessage {
    std::deque<std::string> names;  // a deque never moves its members
    std::vector<TransformView> transforms;
};

/// Up to five transforms. The names have 0 to 20 bytes, including slashes; stamps fit all formats;
/// doubles are any 64 bits.
template <typename Random>
RandomMessage random_message(Random& random) {
    const auto below = [&](std::uint64_t limit) {
        return std::uniform_int_distribution<std::uint64_t>(0, limit - 1)(random);
    };
    RandomMessage message;
    const auto name = [&]() -> std::string_view {
        constexpr std::string_view kAlphabet = "/ab_\xc3\xa4\x7f\x01";
        std::string& text = message.names.emplace_back(below(21), ' ');
        for (char& c : text) {
            c = kAlphabet[below(kAlphabet.size())];
        }
        return text;
    };
    message.transforms.resize(below(6));
    for (TransformView& transform : message.transforms) {
        transform.parent = name();
        transform.child = name();
        transform.stamp = static_cast<clock::StampNs>(
            below(std::uint64_t{1} << 31) * 1'000'000'000 + below(1'000'000'000));
        std::uint64_t words[7];
        for (std::uint64_t& word : words) {
            word = std::uniform_int_distribution<std::uint64_t>()(random);
        }
        std::memcpy(&transform.pose, words, sizeof words);
    }
    return message;
}

}  // namespace tfdb::wire::testing
