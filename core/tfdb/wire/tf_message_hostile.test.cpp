#include <optional>
#include <random>
#include <string>

#include "tfdb/testing/check.hpp"
#include "tfdb/wire/tf_message.golden.hpp"
#include "tfdb/wire/tf_message.hpp"
#include "tfdb/wire/tf_message.samples.hpp"

namespace tfdb::wire {

namespace {

using testing::as_bytes;
using testing::kAllEncodings;
using testing::same_bits;

struct Refusal {
    std::size_t offset;
    std::string reason;
};

// Decodes from a heap block of exactly that size, so that AddressSanitizer detects a read past the
// end, into a non-empty output, and checks the promises of a rejection.
std::optional<Refusal> refusal_of(std::span<const std::byte> data, Encoding encoding) {
    const std::vector<std::byte> exact(data.begin(), data.end());
    std::vector<TransformView> out(3);
    try {
        decode_tf_message({exact.data(), exact.size()}, encoding, out);
        return std::nullopt;
    } catch (const CorruptMessage& error) {
        CHECK(out.empty());
        CHECK(error.detail().offset.has_value() && *error.detail().offset <= data.size());
        CHECK(!error.detail().reason.empty());
        return Refusal{error.detail().offset.value_or(0), error.detail().reason};
    }
}

void check_refused(std::span<const std::byte> data, Encoding encoding, std::size_t offset,
                   std::string_view reason) {
    const std::optional<Refusal> refusal = refusal_of(data, encoding);
    CHECK(refusal.has_value());
    if (refusal) {
        CHECK_EQ(refusal->offset, offset);
        CHECK_EQ(refusal->reason, reason);
    }
}

std::vector<std::byte> two_transforms(Encoding encoding) {
    const std::vector<TransformView> transforms{
        {"ab", "cde", 5'000'000'007, {{1.0, -2.0, 0.5}, {0.0, 0.6, 0.0, 0.8}}},
        {"cde", "f", 6'000'000'008, {{-1.0, 3.0, 0.25}, {0.6, 0.0, 0.8, 0.0}}}};
    std::vector<std::byte> bytes;
    encode_tf_message(transforms, encoding, bytes);
    return bytes;
}

std::vector<std::byte> changed(std::vector<std::byte> bytes, std::size_t at,
                               std::string_view replacement) {
    const std::span<const std::byte> source = as_bytes(replacement);
    std::copy(source.begin(), source.end(), bytes.begin() + static_cast<std::ptrdiff_t>(at));
    return bytes;
}

}  // namespace

TFDB_TEST(wire_every_truncation_is_refused) {
    // With long names, the count alone does not reveal a truncation.
    const std::string longer(300, 'l');
    std::vector<TransformView> long_names = testing::golden_message();
    long_names.resize(2);
    long_names[0].parent = longer;
    std::vector<TransformView> long_last = long_names;
    long_last[1].parent = long_last[1].child = longer;
    std::vector<std::byte> bytes;
    for (const Encoding encoding : kAllEncodings) {
        for (const auto& message : {testing::golden_message(), long_names, long_last}) {
            encode_tf_message(message, encoding, bytes);
            for (std::size_t size = 0; size < bytes.size(); ++size) {
                CHECK(refusal_of(std::span(bytes).first(size), encoding).has_value());
            }
            CHECK(!refusal_of(bytes, encoding).has_value());
        }
    }
}

TFDB_TEST(wire_every_single_byte_change_is_refused_or_round_trips) {
    for (const Encoding encoding : kAllEncodings) {
        const std::vector<std::byte> golden = two_transforms(encoding);
        for (std::size_t at = 0; at < golden.size(); ++at) {
            for (unsigned value = 0; value < 256; ++value) {
                std::vector<std::byte> bytes = golden;
                bytes[at] = static_cast<std::byte>(value);
                if (refusal_of(bytes, encoding)) {
                    continue;
                }
                std::vector<TransformView> first;
                std::vector<TransformView> second;
                std::vector<std::byte> again;
                decode_tf_message(bytes, encoding, first);
                std::erase_if(first, testing::is_bad);
                encode_tf_message(first, encoding, again);
                decode_tf_message(again, encoding, second);
                CHECK(same_bits(first, second));
            }
        }
    }
}

TFDB_TEST(wire_random_bytes_never_crash) {
    constexpr unsigned kSeed = 7;
    std::mt19937 random(kSeed);
    for (int round = 0; round < 5000; ++round) {
        std::vector<std::byte> bytes(random() % 200);
        for (std::byte& byte : bytes) {
            // Mostly small numbers: lengths and counts that are nearly plausible.
            byte = static_cast<std::byte>(random() % 4 != 0 ? random() % 3 : random() % 256);
        }
        for (const Encoding encoding : kAllEncodings) {
            static_cast<void>(refusal_of(bytes, encoding));
        }
    }
    CHECK(true);
}

TFDB_TEST(wire_hostile_counts_allocate_nothing) {
    using namespace std::string_view_literals;
    const auto bytes = as_bytes("\xff\xff\xff\xff____________"sv);
    std::vector<TransformView> out;
    for (const Encoding encoding :
         {Encoding::kRos1, Encoding::kCdrBareLittle, Encoding::kCdrBareBig}) {
        CHECK_THROWS_AS(decode_tf_message(bytes, encoding, out), CorruptMessage);
        CHECK_EQ(out.capacity(), 0U);
        check_refused(bytes, encoding, 0, "4294967295 transforms cannot fit into 12 bytes");
    }
}

TFDB_TEST(wire_says_where_and_why) {
    using namespace std::string_view_literals;
    const std::vector<std::byte> ros1 = two_transforms(Encoding::kRos1);
    const std::vector<std::byte> cdr = two_transforms(Encoding::kCdr);
    const std::span<const std::byte> whole(cdr);
    check_refused({}, Encoding::kRos1, 0, "truncated in the count of transforms");
    check_refused({}, Encoding::kCdr, 0, "truncated in the encapsulation header");
    check_refused(whole.first(3), Encoding::kCdr, 3, "truncated in the encapsulation header");
    check_refused(whole.first(6), Encoding::kCdr, 4, "truncated in the count of transforms");
    // ROS 1: count 0, seq 4, stamp 8, frame_id 16 and 20, child_frame_id 22 and 26, numbers 29.
    check_refused(changed(ros1, 16, "\xff\xff\xff\xff"sv), Encoding::kRos1, 16,
                  "transforms[0].header.frame_id: length 4294967295, 145 bytes are left");
    // CDR: count 4, stamp 8, frame_id 16 and 20, child_frame_id 24 and 28, numbers 36.
    check_refused(changed(cdr, 22, "x"sv), Encoding::kCdr, 20,
                  "transforms[0].header.frame_id: no closing NUL");
    check_refused(changed(cdr, 16, "\0"sv), Encoding::kCdr, 20,
                  "transforms[0].header.frame_id: no closing NUL");
    check_refused(whole.first(40), Encoding::kCdr, 4, "2 transforms cannot fit into 32 bytes");
    check_refused(whole.first(cdr.size() - 1), Encoding::kCdr, 116,
                  "transforms[1].transform: truncated");
}

TFDB_TEST(wire_values_that_no_store_takes_are_passed_on) {
    using namespace std::string_view_literals;
    constexpr clock::StampNs kSecond = clock::kNanosPerSecond;
    std::vector<TransformView> good;
    std::vector<TransformView> out;
    std::vector<std::byte> bytes;  // the names in `out` lie there
    const std::vector<std::byte> ros1 = two_transforms(Encoding::kRos1);
    const std::vector<std::byte> cdr = two_transforms(Encoding::kCdr);
    decode_tf_message(cdr, Encoding::kCdr, good);
    const clock::StampNs nanos = good[0].stamp % kSecond;
    const auto decode = [&](const std::vector<std::byte>& from, Encoding encoding, std::size_t at,
                            std::string_view word) {
        bytes = changed(from, at, word);
        decode_tf_message(bytes, encoding, out);
        CHECK(same_bits(std::span(out).subspan(1), std::span(good).subspan(1)));
        return out[0];
    };
    CHECK_EQ(decode(cdr, Encoding::kCdr, 8, "\xff\xff\xff\xff"sv).stamp, nanos - kSecond);
    CHECK_EQ(decode(cdr, Encoding::kCdr, 8, "\0\0\0\x80"sv).stamp,
             nanos - (std::int64_t{1} << 31) * kSecond);
    // In ROS 1 the same word is not negative.
    CHECK_EQ(decode(ros1, Encoding::kRos1, 8, "\0\0\0\x80"sv).stamp,
             nanos + (std::int64_t{1} << 31) * kSecond);
    for (const auto& [from, encoding] :
         {std::pair(&ros1, Encoding::kRos1), {&cdr, Encoding::kCdr}}) {
        CHECK_EQ(clock::excess_of(decode(*from, encoding, 12, "\x00\xca\x9a\x3b"sv).stamp).value(),
                 kSecond);
        CHECK_EQ(clock::excess_of(decode(*from, encoding, 12, "\xff\xff\xff\xff"sv).stamp).value(),
                 0xffffffff);
        CHECK(!clock::excess_of(decode(*from, encoding, 12, "\xff\xc9\x9a\x3b"sv).stamp));
    }
    std::string child(good[0].child);
    child[1] = '\0';
    CHECK_EQ(decode(ros1, Encoding::kRos1, 27, "\0"sv).child, child);
    CHECK_EQ(decode(cdr, Encoding::kCdr, 29, "\0"sv).child, child);
}

TFDB_TEST(wire_foreign_encapsulation_headers_are_refused) {
    using namespace std::string_view_literals;
    const std::vector<std::byte> cdr = two_transforms(Encoding::kCdr);
    for (const unsigned id : {0x02U, 0x03U, 0x04U, 0x05U, 0x08U, 0x09U, 0x0aU, 0x0bU, 0xffU}) {
        std::vector<std::byte> bytes = cdr;
        bytes[1] = static_cast<std::byte>(id);
        CHECK(refusal_of(bytes, Encoding::kCdr).has_value());
    }
    check_refused(changed(cdr, 0, "\x01\x03"sv), Encoding::kCdr, 0,
                  "representation 01 03 is neither plain CDR (00 00, 00 01) nor plain CDR2 (00 06, "
                  "00 07)");
    check_refused(cdr, Encoding::kCdrBig, 0, "the encapsulation header names another encoding");
    check_refused(two_transforms(Encoding::kCdr2Big), Encoding::kCdr2Little, 0,
                  "the encapsulation header names another encoding");
}

TFDB_TEST(wire_a_wrong_byte_order_is_noticed) {
    std::vector<std::byte> bytes = two_transforms(Encoding::kCdrLittle);
    CHECK(refusal_of(std::span(bytes).subspan(4), Encoding::kCdrBareBig).has_value());
    CHECK(refusal_of(bytes, Encoding::kRos1).has_value());
    CHECK(refusal_of(bytes, Encoding::kCdrBareLittle).has_value());
    CHECK(refusal_of(two_transforms(Encoding::kRos1), Encoding::kCdrBareLittle).has_value());
}

TFDB_TEST(wire_trailing_bytes_up_to_the_padding_of_the_transport) {
    for (const Encoding encoding : kAllEncodings) {
        const std::size_t allowed = encoding == Encoding::kRos1 ? 0 : 3;
        std::vector<std::byte> bytes = two_transforms(encoding);
        const std::size_t size = bytes.size();
        for (std::size_t extra = 1; extra <= 8; ++extra) {
            bytes.push_back(std::byte{0xcd});
            if (extra <= allowed) {
                CHECK(!refusal_of(bytes, encoding).has_value());
            } else {
                check_refused(bytes, encoding, size,
                              std::to_string(extra) + " bytes follow the message");
            }
        }
    }
}

TFDB_TEST(wire_the_delimiter_header_must_be_exact) {
    using namespace std::string_view_literals;
    const std::vector<std::byte> cdr2 = two_transforms(Encoding::kCdr2Little);
    const std::size_t payload = cdr2.size() - 8;
    const auto with_size = [&](std::size_t size) {
        const char text[] = {static_cast<char>(size & 0xff), static_cast<char>(size >> 8)};
        return changed(cdr2, 4, {text, 2});
    };
    CHECK(!refusal_of(with_size(payload), Encoding::kCdr).has_value());
    check_refused(with_size(payload + 1), Encoding::kCdr, 4,
                  "the delimiter header says " + std::to_string(payload + 1) + " bytes, " +
                      std::to_string(payload) + " are left");
    CHECK(refusal_of(with_size(payload - 1), Encoding::kCdr).has_value());
    std::vector<std::byte> longer = with_size(payload + 2);
    longer.resize(longer.size() + 2);
    check_refused(longer, Encoding::kCdr, cdr2.size(),
                  "the sequence ends before its delimiter header says");
    // The delimiter's size includes the count.
    check_refused(as_bytes("\0\x07\0\0\x02\0\0\0\0\0\0\0"sv), Encoding::kCdr, 8,
                  "truncated in the count of transforms");
}

}  // namespace tfdb::wire
