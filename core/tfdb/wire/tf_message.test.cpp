#include "tfdb/wire/tf_message.hpp"

#include <bit>
#include <limits>
#include <random>
#include <string>

#include "tfdb/testing/check.hpp"
#include "tfdb/wire/tf_message.golden.hpp"
#include "tfdb/wire/tf_message.samples.hpp"

namespace tfdb::wire {

namespace {

using testing::as_bytes;
using testing::from_hex;
using testing::golden_message;
using testing::kAllEncodings;
using testing::random_message;
using testing::RandomMessage;
using testing::same_bits;

std::vector<TransformView> decoded(std::span<const std::byte> data, Encoding encoding) {
    std::vector<TransformView> out;
    decode_tf_message(data, encoding, out);
    return out;
}

std::vector<std::byte> encoded(std::span<const TransformView> transforms, Encoding encoding) {
    std::vector<std::byte> out;
    encode_tf_message(transforms, encoding, out);
    return out;
}

void check_golden(std::string_view hex, std::initializer_list<Encoding> encodings) {
    const std::vector<std::byte> bytes = from_hex(hex);
    for (const Encoding encoding : encodings) {
        CHECK(same_bits(decoded(bytes, encoding), golden_message()));
        CHECK(encoded(golden_message(), encoding) == bytes);
    }
}

// One transform, built field by field from the format definitions.
const std::string kHandPose = [] {
    const double values[] = {1.0, -2.0, 0.5, 0.0, 0.6, 0.0, 0.8};
    return std::string(reinterpret_cast<const char*>(values), sizeof values);
}();

std::vector<TransformView> hand_message() {
    return {{"ab", "cde", 5'000'000'007, {{1.0, -2.0, 0.5}, {0.0, 0.6, 0.0, 0.8}}}};
}

std::vector<std::byte> bytes_of(std::string_view text) {
    const std::span<const std::byte> bytes = as_bytes(text);
    return {bytes.begin(), bytes.end()};
}

std::vector<std::byte> hand_ros1() {
    using namespace std::string_literals;
    return bytes_of(
        "\x01\0\0\0"s            // one transform
        "\0\0\0\0"s              // seq
        "\x05\0\0\0\x07\0\0\0"s  // stamp
        "\x02\0\0\0"s            // frame_id
        "ab"s
        "\x03\0\0\0"s  // child_frame_id
        "cde"s +
        kHandPose);
}

std::vector<std::byte> hand_cdr_bare() {
    using namespace std::string_literals;
    return bytes_of(
        "\x01\0\0\0"s            // 0: one transform
        "\x05\0\0\0\x07\0\0\0"s  // 4: stamp
        "\x03\0\0\0"s            // 12: frame_id with its NUL
        "ab\0"s
        "?"s           // 19: padding to 4
        "\x04\0\0\0"s  // 20: child_frame_id
        "cde\0"s
        "????"s +  // 28: padding to 8
        kHandPose);
}

std::vector<std::byte> hand_cdr2() {
    using namespace std::string_literals;
    return bytes_of(
        "\0\x07\0\0"s            // plain CDR2, little endian
        "\x54\0\0\0"s            // 0: 84 bytes follow
        "\x01\0\0\0"s            // 4: one transform
        "\x05\0\0\0\x07\0\0\0"s  // 8: stamp
        "\x03\0\0\0"s            // 16: frame_id with its NUL
        "ab\0"s
        "?"s           // 23: padding to 4
        "\x04\0\0\0"s  // 24: child_frame_id
        "cde\0"s +
        kHandPose);  // 32: aligned to 4 already
}

constexpr bool kLittleHost = std::endian::native == std::endian::little;

}  // namespace

TFDB_TEST(wire_reads_bytes_made_by_hand) {
    if (!kLittleHost) {
        CHECK(true);  // the hand-made pose is in host order
        return;
    }
    CHECK(same_bits(decoded(hand_ros1(), Encoding::kRos1), hand_message()));
    CHECK(same_bits(decoded(hand_cdr_bare(), Encoding::kCdrBareLittle), hand_message()));
    CHECK(same_bits(decoded(hand_cdr2(), Encoding::kCdr), hand_message()));
    CHECK(same_bits(decoded(hand_cdr2(), Encoding::kCdr2Little), hand_message()));
    for (const std::byte option : {std::byte{0}, std::byte{3}, std::byte{0xff}}) {
        std::vector<std::byte> headed{std::byte{0}, std::byte{1}, option, option};
        const std::vector<std::byte> payload = hand_cdr_bare();
        headed.insert(headed.end(), payload.begin(), payload.end());
        CHECK(same_bits(decoded(headed, Encoding::kCdr), hand_message()));
    }
}

TFDB_TEST(wire_knows_the_byte_order_of_messages) {
    for (const Encoding encoding : kAllEncodings) {
        const auto data = encoded(golden_message(), encoding);
        const bool big = encoding == Encoding::kCdrBig || encoding == Encoding::kCdr2Big ||
                         encoding == Encoding::kCdrBareBig;
        CHECK_EQ(is_little_endian(data, encoding), !big);
        if (encoding == Encoding::kCdrBig || encoding == Encoding::kCdr2Big ||
            encoding == Encoding::kCdrLittle || encoding == Encoding::kCdr2Little)
            CHECK_EQ(is_little_endian(data, Encoding::kCdr), !big);
    }
}

TFDB_TEST(wire_writes_bytes_made_by_hand) {
    if (!kLittleHost) {
        CHECK(true);
        return;
    }
    CHECK(encoded(hand_message(), Encoding::kRos1) == hand_ros1());
    std::vector<std::byte> zero_padded = hand_cdr_bare();
    for (const std::size_t at : {19U, 28U, 29U, 30U, 31U}) {
        zero_padded[at] = std::byte{0};
    }
    CHECK(encoded(hand_message(), Encoding::kCdrBareLittle) == zero_padded);
    zero_padded.insert(zero_padded.begin(), 4, std::byte{0});
    zero_padded[1] = std::byte{1};
    CHECK(encoded(hand_message(), Encoding::kCdr) == zero_padded);
    std::vector<std::byte> delimited = hand_cdr2();
    delimited[4 + 23] = std::byte{0};
    CHECK(encoded(hand_message(), Encoding::kCdr2Little) == delimited);
}

TFDB_TEST(wire_reads_and_writes_what_other_software_writes) {
    check_golden(testing::kGoldenRos1, {Encoding::kRos1});
    check_golden(testing::kGoldenCdrLittle, {Encoding::kCdr, Encoding::kCdrLittle});
    check_golden(testing::kGoldenCdrBig, {Encoding::kCdrBig});
    check_golden(testing::kGoldenCdr2Little, {Encoding::kCdr2Little});
    check_golden(testing::kGoldenCdr2Big, {Encoding::kCdr2Big});
    check_golden(testing::kGoldenCdrLittle.substr(8), {Encoding::kCdrBareLittle});
    check_golden(testing::kGoldenCdrBig.substr(8), {Encoding::kCdrBareBig});
    for (const std::string_view hex :
         {testing::kGoldenCdrBig, testing::kGoldenCdr2Little, testing::kGoldenCdr2Big}) {
        CHECK(same_bits(decoded(from_hex(hex), Encoding::kCdr), golden_message()));
    }
}

TFDB_TEST(wire_round_trip_is_exact) {
    constexpr unsigned kSeed = 20240607;
    std::mt19937 random(kSeed);
    for (int round = 0; round < 400; ++round) {
        const RandomMessage message = random_message(random);
        for (const Encoding encoding : kAllEncodings) {
            const std::vector<std::byte> bytes = encoded(message.transforms, encoding);
            if (!same_bits(decoded(bytes, encoding), message.transforms)) {
                CHECK_EQ(round, -1);  // reports the round
            }
        }
    }
    CHECK(true);
}

TFDB_TEST(wire_empty_message) {
    for (const Encoding encoding : kAllEncodings) {
        CHECK(decoded(encoded({}, encoding), encoding).empty());
    }
    CHECK_EQ(encoded({}, Encoding::kRos1).size(), 4U);
    CHECK_EQ(encoded({}, Encoding::kCdr).size(), 8U);
    CHECK_EQ(encoded({}, Encoding::kCdr2Little).size(), 12U);
}

TFDB_TEST(wire_shortest_transforms_fit) {
    const std::vector<TransformView> nameless(100, TransformView{"", "", 7, {{1, 2, 3}, {}}});
    for (const Encoding encoding : kAllEncodings) {
        CHECK(same_bits(decoded(encoded(nameless, encoding), encoding), nameless));
    }
}

TFDB_TEST(wire_views_point_into_the_bytes) {
    const std::vector<std::byte> bytes = from_hex(testing::kGoldenCdrLittle);
    const char* const begin = reinterpret_cast<const char*>(bytes.data());
    for (const TransformView& transform : decoded(bytes, Encoding::kCdr)) {
        for (const std::string_view name : {transform.parent, transform.child}) {
            CHECK(name.data() >= begin && name.data() + name.size() <= begin + bytes.size());
        }
    }
}

TFDB_TEST(wire_output_is_reused) {
    const std::vector<std::byte> six = from_hex(testing::kGoldenCdrLittle);
    const std::vector<std::byte> one = encoded(hand_message(), Encoding::kCdr);
    std::vector<TransformView> out;
    decode_tf_message(six, Encoding::kCdr, out);
    const TransformView* const storage = out.data();
    decode_tf_message(one, Encoding::kCdr, out);
    CHECK(same_bits(out, hand_message()));
    decode_tf_message(six, Encoding::kCdr, out);
    CHECK(same_bits(out, golden_message()));
    CHECK(out.data() == storage);

    std::vector<std::byte> written;
    encode_tf_message(golden_message(), Encoding::kCdr, written);
    const std::byte* const bytes = written.data();
    encode_tf_message(hand_message(), Encoding::kCdr, written);
    CHECK(written == one);
    CHECK(written.data() == bytes);
}

TFDB_TEST(wire_reading_drops_one_leading_slash) {
    std::vector<std::byte> bytes = hand_ros1();
    bytes[20] = std::byte{'/'};  // "/b"
    bytes[26] = bytes[27] = bytes[28] = std::byte{'/'};
    const std::vector<TransformView> read = decoded(bytes, Encoding::kRos1);
    CHECK(read[0].parent == "b");
    CHECK(read[0].child == "//");
}

TFDB_TEST(wire_writing_keeps_leading_slashes) {
    const std::vector<TransformView> slashed{{"/a", "//b", 1, {{1, 2, 3}, {0, 0.6, 0, 0.8}}},
                                             {"/", "a/b", 2, {{3, 2, 1}, {0.6, 0, 0.8, 0}}}};
    for (const Encoding encoding : kAllEncodings) {
        const std::vector<std::byte> bytes = encoded(slashed, encoding);
        CHECK(same_bits(decoded(bytes, encoding), slashed));
    }
}

TFDB_TEST(wire_the_sequence_number_of_ros1_is_ignored) {
    std::vector<std::byte> bytes = hand_ros1();
    bytes[4] = bytes[5] = bytes[6] = bytes[7] = std::byte{0xff};
    CHECK(same_bits(decoded(bytes, Encoding::kRos1), hand_message()));
}

TFDB_TEST(wire_stamps_to_the_end_of_each_format) {
    constexpr clock::StampNs kLastNano = clock::kNanosPerSecond - 1;
    constexpr clock::StampNs kRos1Last = 4294967295 * clock::kNanosPerSecond + kLastNano;
    constexpr clock::StampNs kCdrLast = 2147483647 * clock::kNanosPerSecond + kLastNano;
    for (const Encoding encoding : kAllEncodings) {
        const clock::StampNs last = encoding == Encoding::kRos1 ? kRos1Last : kCdrLast;
        std::vector<TransformView> message = hand_message();
        for (const clock::StampNs stamp : {clock::StampNs{0}, kLastNano, last}) {
            message[0].stamp = stamp;
            CHECK(same_bits(decoded(encoded(message, encoding), encoding), message));
        }
        for (const clock::StampNs stamp :
             {last + 1, clock::StampNs{-1}, std::numeric_limits<clock::StampNs>::max(),
              std::numeric_limits<clock::StampNs>::min()}) {
            message[0].stamp = stamp;
            CHECK_THROWS_AS(encoded(message, encoding), InvalidStamp);
        }
    }
}

TFDB_TEST(wire_refused_writes_leave_the_output_alone) {
    using namespace std::string_view_literals;
    const std::vector<std::byte> before = hand_cdr2();
    std::vector<std::byte> out = before;
    std::vector<TransformView> message = golden_message();
    message[3].child = "a\0b"sv;
    for (const Encoding encoding : kAllEncodings) {
        try {
            encode_tf_message(message, encoding, out);
            CHECK(false);
        } catch (const InvalidName& error) {
            CHECK_EQ(error.detail().index.value_or(99), 3U);
        }
        CHECK(out == before);
    }
    message[3].child = "child";
    message[2].stamp = -5;
    try {
        encode_tf_message(message, Encoding::kCdr, out);
        CHECK(false);
    } catch (const InvalidStamp& error) {
        CHECK_EQ(error.detail().index.value_or(99), 2U);
        CHECK_EQ(error.detail().stamp.value_or(0), -5);
        CHECK(error.detail().edge == "a");
    }
    CHECK(out == before);
}

TFDB_TEST(wire_refuses_to_write_four_gibibytes) {
    const std::string name(std::size_t{16} << 20, 'x');
    const std::vector<TransformView> message(130, TransformView{name, name, 1, {}});
    for (const Encoding encoding : {Encoding::kRos1, Encoding::kCdr, Encoding::kCdr2Big}) {
        CHECK_THROWS_AS(encoded(message, encoding), InvalidArgument);
    }
}

TFDB_TEST(wire_encodings_have_names) {
    CHECK(encoding_from_name("ros1") == Encoding::kRos1);
    CHECK(encoding_from_name("cdr") == Encoding::kCdr);
    CHECK(encoding_from_name("cdr_bare_be") == Encoding::kCdrBareBig);
    for (const std::string_view name : {"", "CDR", "cdr_", "protobuf"}) {
        CHECK(!encoding_from_name(name).has_value());
    }
    const auto unknown = static_cast<Encoding>(99);
    CHECK_THROWS_AS(encoded({}, unknown), InvalidArgument);
    CHECK_THROWS_AS(decoded({}, unknown), InvalidArgument);
}

}  // namespace tfdb::wire
