// Samples of commits and states: encoding and decoding are inverse, and bytes of version 0 stay
// readable.
#include "tfdb/wire/commit_sample.hpp"

#include <bit>
#include <cstring>
#include <initializer_list>
#include <random>
#include <string>

#include "tfdb/testing/check.hpp"
#include "tfdb/wire/commit_sample.rewritten.hpp"
#include "tfdb/wire/crc32c.hpp"

namespace tfdb::wire {
namespace {

using Bytes = std::vector<std::byte>;
using Row = CommitSample::Row;
using Edge = CommitSample::Edge;

constexpr Epoch kEpoch{1'700'000'000'000'000'000, 0x0123'4567'89AB'CDEF, 0xFEDC'BA98'7654'3210};

Row row(clock::StampNs stamp, std::uint32_t parent, bool gone, const double (&numbers)[7]) {
    Row made{stamp, parent, gone, {}};
    for (std::size_t i = 0; i < 7; ++i)
        made.numbers[i] = std::bit_cast<std::uint64_t>(numbers[i]);
    return made;
}

/// A sample with everything that commits can do.
Bytes example() {
    SampleWriter writer;
    writer.start();
    const std::uint32_t map = writer.add_name("map");
    const std::uint32_t base = writer.add_name("base");
    const std::uint32_t old = writer.add_name("b\xC3\xA4r");
    const std::uint32_t slam = writer.add_authority("slam");
    const std::uint32_t cleared[] = {base};
    const std::uint32_t removed[] = {old};
    const std::uint32_t passing[] = {map, old};
    const std::uint32_t made[] = {map};
    writer.start_commit(1, {cleared, removed, passing, made}, 2);
    const Row moving[] = {row(1'000'000'000, map, false, {1.5, -2.0, 0.25, 0.0, 0.0, 0.6, 0.8}),
                          row(1'010'000'000, old, true, {1.5, -2.0, 0.25, 0.0, 0.0, -0.8, 0.6})};
    writer.add_edge({.child = base, .authority = slam}, moving);
    const Row fixed[] = {row(0, base, false, {0.0, -0.0, 0.0, 0.0, 0.0, 0.0, 1.0})};
    writer.add_edge({.child = map, .authority = 0, .is_static = true}, fixed);
    writer.start_commit(41, {}, 0);
    return writer.finish(CommitSample::Kind::kCommits, kEpoch, 0x1234'5678, 7, 50);
}

Bytes from_hex(const char* text) {
    Bytes bytes;
    for (; text[0] != '\0'; text += 2) {
        const char digits[] = {text[0], text[1], '\0'};
        bytes.push_back(std::byte(std::stoul(digits, nullptr, 16)));
    }
    return bytes;
}

std::string to_hex(const Bytes& bytes) {
    std::string text;
    for (const std::byte byte : bytes) {
        constexpr const char* kDigits = "0123456789abcdef";
        text += kDigits[std::to_integer<unsigned>(byte) >> 4];
        text += kDigits[std::to_integer<unsigned>(byte) & 15];
    }
    return text;
}

/// `example` in version 0: it must always be readable.
constexpr const char* kVersion0 =
    "544644420001000000002a36fe9c97170123456789abcdeffedcba987654321078563412072b0303"
    "6d617004626173650462c3a4720104736c616d02010f010101020200020100020e0102e70080a8d6"
    "b907000000000000f83f00000000000000c0000000000000d03f333333333333e33f9a9999999999"
    "e93fe00580dac4099a9999999999e9bf333333333333e33f0300c202000000000000008000000000"
    "0000f03f290000afdf4909";

void check_example(const CommitSample& sample) {
    CHECK(sample.kind == CommitSample::Kind::kCommits);
    CHECK_EQ(sample.choice, 0x1234'5678U);
    CHECK(sample.epoch == kEpoch);
    CHECK_EQ(sample.since, CommitNumber{7});
    CHECK_EQ(sample.last, CommitNumber{50});
    CHECK_EQ(sample.names.size(), std::size_t{3});
    CHECK_EQ(sample.names[2], "b\xC3\xA4r");
    CHECK_EQ(sample.authorities.size(), std::size_t{2});
    CHECK_EQ(sample.authorities[1], "slam");
    CHECK_EQ(sample.commits.size(), std::size_t{2});
    const CommitSample::Commit& first = sample.commits[0];
    CHECK_EQ(first.number, CommitNumber{8});
    CHECK_EQ(sample.commits[1].number, CommitNumber{49});
    CHECK_EQ(sample.names_of(first.cleared)[0], 1U);
    CHECK_EQ(sample.names_of(first.removed)[0], 2U);
    CHECK_EQ(sample.names_of(first.passing).size(), std::size_t{2});
    CHECK_EQ(sample.names_of(first.made)[0], 0U);
    const auto edges = sample.edges_of(first);
    CHECK_EQ(edges.size(), std::size_t{2});
    CHECK_EQ(edges[0].authority, 1U);
    CHECK_EQ(edges[1].authority, 0U);
    CHECK(edges[1].is_static && !edges[0].is_static);
    const auto rows = sample.rows_of(edges[0]);
    CHECK_EQ(rows.size(), std::size_t{2});
    CHECK_EQ(rows[1].stamp, clock::StampNs{1'010'000'000});
    CHECK(rows[1].gone && rows[1].parent == 2 && !rows[0].gone);
    CHECK_EQ(std::bit_cast<double>(rows[1].numbers[1]), -2.0);
    CHECK_EQ(std::bit_cast<double>(rows[1].numbers[5]), -0.8);
    const Row& fixed = sample.rows_of(edges[1])[0];
    CHECK(std::signbit(std::bit_cast<double>(fixed.numbers[1])));
    CHECK_EQ(std::bit_cast<double>(fixed.numbers[6]), 1.0);
    CHECK(sample.edges_of(sample.commits[1]).empty());
}

/// Updates the checksum to the current bytes.
void seal(Bytes& bytes) {
    const std::uint32_t sum = crc32c(std::span(bytes).first(bytes.size() - 4));
    store_u32<kCdrLittleLayout>(bytes.data() + bytes.size() - 4, sum);
}

constexpr std::size_t kHead = 36;

/// A sample of kind 1 (commits) or 2 (a state), with these bytes after its head.
Bytes sample_of(unsigned kind, std::initializer_list<unsigned> behind) {
    Bytes bytes(kHead);
    const unsigned head[] = {'T', 'F', 'D', 'B', 0, kind, 0, 0, 1};
    for (std::size_t i = 0; i < std::size(head); ++i)
        bytes[i] = std::byte(head[i]);
    for (const unsigned byte : behind)
        bytes.push_back(std::byte(byte));
    bytes.resize(bytes.size() + 4);
    seal(bytes);
    return bytes;
}

void check_refused(const Bytes& bytes, std::size_t at, const std::string& text) {
    CommitSample sample;
    try {
        sample.decode(bytes);
        CHECK_EQ(text, "was refused");
    } catch (const CorruptMessage& error) {
        CHECK_EQ(error.detail().offset.value_or(0), at);
        if (error.detail().reason.find(text) == std::string::npos)
            CHECK_EQ(error.detail().reason, text);
    }
}

}  // namespace

TFDB_TEST(crc32c_has_the_values_of_its_standard) {
    // RFC 3720, B.4.
    Bytes bytes(32, std::byte{0});
    CHECK_EQ(crc32c(bytes), 0x8A91'36AAU);
    bytes.assign(32, std::byte{0xFF});
    CHECK_EQ(crc32c(bytes), 0x62A8'AB43U);
    for (std::size_t i = 0; i < 32; ++i)
        bytes[i] = std::byte(i);
    CHECK_EQ(crc32c(bytes), 0x46DD'794EU);
    CHECK_EQ(crc32c(std::as_bytes(std::span("123456789", 9))), 0xE306'9283U);
    CHECK_EQ(crc32c({}), 0U);
    std::mt19937_64 random(3);
    bytes.resize(1000);
    for (std::byte& byte : bytes)
        byte = std::byte(random());
    for (std::size_t size = 0; size < bytes.size(); size += 7) {
        const auto part = std::span(bytes).first(size);
        CHECK_EQ(crc32c(part), ~crc32c_by_tables(~std::uint32_t{0}, part));
    }
}

TFDB_TEST(commit_samples_are_read_as_they_were_written) {
    const Bytes bytes = example();
    CommitSample sample;
    sample.decode(bytes);
    check_example(sample);
}

TFDB_TEST(commit_samples_of_version_0_stay_readable) {
    CHECK_EQ(to_hex(example()), std::string(kVersion0));
    const Bytes bytes = from_hex(kVersion0);
    CommitSample sample;
    sample.decode(bytes);
    check_example(sample);
}

TFDB_TEST(commit_samples_that_are_damaged_are_refused) {
    const Bytes whole = example();
    CommitSample sample;
    for (std::size_t size = 0; size < whole.size(); ++size)
        CHECK_THROWS_AS(sample.decode(std::span(whole).first(size)), CorruptMessage);
    for (std::size_t at = 0; at < whole.size(); ++at) {
        for (unsigned bit = 0; bit < 8; ++bit) {
            Bytes broken = whole;
            broken[at] ^= std::byte(1U << bit);
            CHECK_THROWS_AS(sample.decode(broken), CorruptMessage);
        }
    }
    sample.decode(whole);
    check_example(sample);
}

TFDB_TEST(commit_samples_with_a_sound_checksum_lead_nowhere_outside) {
    const Bytes whole = example();
    std::mt19937_64 random(7);
    CommitSample sample;
    std::size_t accepted = 0;
    for (int i = 0; i < 20'000; ++i) {
        Bytes broken = whole;
        for (std::uint64_t changes = 1 + random() % 3; changes > 0; --changes)
            broken[36 + random() % (broken.size() - 40)] = std::byte(random());
        seal(broken);
        try {
            sample.decode(broken);
        } catch (const CorruptMessage&) {
            continue;
        }
        ++accepted;
        CHECK(testing::rewritten(sample) == broken);
        for (const CommitSample::Commit& commit : sample.commits) {
            for (const CommitSample::Edge& edge : sample.edges_of(commit)) {
                CHECK(edge.child < sample.names.size());
                CHECK(edge.authority < sample.authorities.size());
                for (const Row& row : sample.rows_of(edge))
                    CHECK(row.parent < sample.names.size());
            }
        }
    }
    CHECK(accepted > 1000);
}

TFDB_TEST(commit_samples_of_a_state) {
    SampleWriter writer;
    writer.start();
    const std::uint32_t base = writer.add_name("base");
    const std::uint32_t map = writer.add_name("map");
    const Row rows[] = {row(5, map, false, {1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0}),
                        row(9, 0, true, {1.0, 2.0, 3.0, 1.0, 0.0, 0.0, 0.0})};
    writer.add_frame({.child = base, .authority = 0, .late = 3}, rows);
    writer.add_frame({.child = map, .cleared = true}, {});
    const Bytes bytes = writer.finish(CommitSample::Kind::kState, kEpoch, 0, 12, 12, 2);
    CommitSample sample;
    sample.decode(bytes);
    CHECK(sample.kind == CommitSample::Kind::kState);
    CHECK_EQ(sample.last, CommitNumber{12});
    CHECK_EQ(sample.commits.size(), std::size_t{1});
    const auto edges = sample.edges_of(sample.commits[0]);
    CHECK_EQ(edges.size(), std::size_t{2});
    CHECK_EQ(edges[0].late, std::uint64_t{3});
    CHECK(edges[1].cleared && sample.rows_of(edges[1]).empty());
    CHECK(sample.rows_of(edges[0])[1].gone);
}

TFDB_TEST(commit_samples_with_a_bad_head_name_the_byte) {
    const Bytes sound = sample_of(1, {0, 0, 0, 0, 0});
    CommitSample sample;
    sample.decode(sound);
    check_refused(Bytes(kHead + 3), kHead + 3,
                  "commits and states have at least 40 bytes, these are 39");
    struct Case {
        std::size_t at;
        unsigned byte;
        std::size_t named;
        const char* text;
    };
    const Case cases[] = {
        {3, 'C', 0, "begin with the letters TFDB"},
        {4, 1, 4, "version 1: this program reads version 0"},
        {5, 0, 5, "kind 0: commits are 1, a state 2"},
        {5, 3, 5, "kind 3"},
        {6, 1, 6, "unknown flags"},
        {7, 1, 6, "unknown flags"},
        {8, 0, 8, "the epoch is 0"},
    };
    for (const Case& one : cases) {
        Bytes bytes = sound;
        bytes[one.at] = std::byte(one.byte);
        seal(bytes);
        check_refused(bytes, one.named, one.text);
    }
    Bytes damaged = sound;
    damaged.back() ^= std::byte{1};
    check_refused(damaged, sound.size() - 4, "the checksum is wrong");
    // The number of an epoch may be 0 if its id is not.
    Bytes at_zero = sound;
    at_zero[8] = std::byte{0};
    at_zero[31] = std::byte{5};
    seal(at_zero);
    sample.decode(at_zero);
    CHECK_EQ(sample.epoch.low, std::uint64_t{5});
}

TFDB_TEST(commit_samples_with_a_bad_body_name_the_byte) {
    struct Case {
        Bytes bytes;
        std::size_t at;  // offset after the head
        std::string text;
    };
    const Case cases[] = {
        {sample_of(1, {}), 0, "the sample ends where the commit is expected"},
        {sample_of(1, {0, 0, 0, 0, 0, 9}), 5, "1 bytes follow the sample"},
        {sample_of(1, {0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 4, 0, 0, 0, 0}), 0,
         "the commit is 17592186044416, at most 17592186044415"},
        {sample_of(1, {0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 3, 1, 0, 0, 0}), 7,
         "the number of commits is 1, at most 0"},
        {sample_of(1, {0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 1, 0}), 0,
         "the commit is 18446744073709551615"},
        {sample_of(1, {0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 2, 0}), 0,
         "the commit has more than 64 bits"},
        {sample_of(1, {0, 1, 4, 1, 'a'}), 2, "the number of names is 4, at most 3"},
        {sample_of(1, {0, 1, 1, 2, 'a'}), 3, "the size of a name is 2, at most 1"},
        {sample_of(1, {0, 1, 0, 1, 3, 'a', 0}), 4, "the size of an authority is 3, at most 2"},
        {sample_of(1, {0, 9, 0, 0, 2, 1, 0, 0}), 4, "the number of commits is 2, at most 1"},
        {sample_of(1, {0, 1, 1, 1, 'a', 0, 1, 0, 0, 0}), 7, "the number of the one before"},
        {sample_of(1, {0, 1, 1, 1, 'a', 0, 2, 1, 0, 0, 1, 0, 0}), 10, "a commit is 1, at most 0"},
        {sample_of(1, {0, 1, 1, 1, 'a', 0, 1, 1, 16, 0}), 8, "unknown lists of a commit"},
        {sample_of(1, {0, 1, 1, 1, 'a', 0, 1, 1, 1, 1, 1, 0}), 10,
         "a frame is name 1, the sample has 1"},
        {sample_of(1, {0, 1, 1, 1, 'a', 0, 1, 1, 0, 1, 8, 0x80, 0, 0}), 10,
         "an edge is name 1, the sample has 1"},
        {sample_of(1, {0, 1, 1, 1, 'a', 0, 1, 1, 0, 1, 2, 1, 0x80, 0, 0}), 11,
         "an authority is 1, at most 0"},
        {sample_of(1, {0, 1, 1, 1, 'a', 0, 1, 1, 0, 1, 5, 0, 0, 0}), 12,
         "a static edge has one sample, not 0"},
        {sample_of(1, {0, 1, 1, 1, 'a', 0, 1, 1, 0, 1, 5, 2, 0x80, 0}), 11,
         "the number of samples is 2, at most 1"},
        {sample_of(1, {0, 1, 1, 1, 'a', 0, 1, 1, 0, 1, 5, 2, 0x80, 0, 0, 0}), 12,
         "a static edge has one sample, not 2"},
        {sample_of(1, {0, 1, 1, 1, 'a', 0, 1, 1, 0, 1, 4, 2, 0x80, 0, 2, 0, 0}), 15,
         "do not ascend"},
        {sample_of(1, {0, 1, 1, 1, 'a', 0, 1, 1, 0, 1, 4, 2, 0x80, 0, 2, 0, 1}), 15,
         "do not ascend"},
        {sample_of(1, {0, 1, 1, 1, 'a', 0, 1, 1, 0, 1, 0, 0, 0}), 11, "has no parent"},
        {sample_of(1, {0, 1, 1, 1, 'a', 0, 1, 1, 0, 1, 0, 0x80, 2, 0}), 12,
         "a parent is name 1, the sample has 1"},
        {sample_of(1, {0, 1, 1, 1, 'a', 0, 1, 1, 0, 1, 0, 0x81, 0, 0, 1, 2, 3, 4, 5, 6, 7}), 14,
         "the sample ends amid a pose"},
        {sample_of(2, {1, 1, 1, 'a', 0, 2, 4, 0, 4, 0}), 5, "2 frames have 1 names"},
        {sample_of(2, {1, 1, 1, 'a', 0, 1, 32, 0x80, 1, 0}), 6, "unknown properties of a frame"},
        {sample_of(2, {1, 1, 1, 'a', 0, 1, 128, 0x80, 1, 0}), 6, "unknown properties of a frame"},
    };
    for (const Case& one : cases)
        check_refused(one.bytes, kHead + one.at, one.text);
}

TFDB_TEST(commit_samples_have_one_spelling) {
    // A state's and a commit's frames "a" and "b", the smallest valid samples.
    CommitSample sample;
    sample.decode(sample_of(1, {0, 1, 2, 1, 'a', 1, 'b', 0, 1, 1, 0, 0}));
    sample.decode(sample_of(2, {1, 2, 1, 'a', 1, 'b', 0, 2, 4, 0, 4, 0}));
    // The largest commit and number of late samples; a removed parent.
    sample.decode(sample_of(1, {0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 3, 0, 0, 0, 0}));
    sample.decode(
        sample_of(2, {1, 1, 1, 'a', 0, 1, 20, 0, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0x3F}));
    CHECK_EQ(sample.edges[0].late, (std::uint64_t{1} << 48) - 1);
    sample.decode(sample_of(2, {1, 2, 1, 'a', 1, 'b', 0, 1, 0, 0x80, 1, 0}));
    CHECK(sample.rows[0].gone);
    struct Case {
        Bytes bytes;
        std::size_t at;  // offset after the head
        std::string text;
    };
    const Case cases[] = {
        {sample_of(1, {0x80, 0, 1, 0, 0, 0}), 1, "the commit has a byte too many"},
        {sample_of(1, {0, 1, 0x81, 0x80, 0, 1, 'a', 0, 0}), 4, "a byte too many"},
        {sample_of(1, {0, 1, 1, 1, 'a', 0, 1, 1, 1, 0, 0}), 9, "a list has no names"},
        {sample_of(1, {0, 1, 1, 1, 'a', 0, 1, 1, 0, 1, 4, 1, 0x80, 0, 0}), 11,
         "the number of samples is 1"},
        {sample_of(1, {0, 1, 1, 1, 'a', 0, 1, 1, 0, 1, 2, 0, 0x80, 0, 0}), 11,
         "an authority is that of the edge before"},
        {sample_of(1, {0, 1, 1, 1, 'a', 0, 1, 1, 0, 1, 4, 2, 0x80, 0, 2, 0x80, 0, 2}), 16,
         "a parent is that of the sample before"},
        {sample_of(1, {0, 1, 1, 1, 'a', 0, 1, 1, 0, 1, 0, 0x81, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0}), 14,
         "a number is that of the sample before"},
        {sample_of(2, {1, 2, 1, 'a', 1, 'b', 0, 1, 0, 0x80, 3, 0}), 10,
         "a removed parent is 3, in a state 1"},
        {sample_of(2, {1, 2, 1, 'b', 1, 'a', 0, 2, 4, 0, 4, 0}), 5, "are not in order"},
        {sample_of(2, {1, 2, 1, 'a', 1, 'a', 0, 2, 4, 0, 4, 0}), 5, "are not in order"},
        {sample_of(2, {1, 2, 1, 'a', 1, 'a', 0, 1, 4, 0}), 5, "a name stands twice"},
        {sample_of(2, {1, 3, 1, 'b', 1, 'a', 1, 'a', 0, 1, 4, 0}), 7, "a name stands twice"},
        {sample_of(2, {1, 1, 1, 'a', 0, 1, 8, 0x80, 1, 0}), 6, "a cleared edge has samples"},
        {sample_of(2, {1, 1, 1, 'a', 0, 1, 20, 0, 0}), 8, "the number of late samples is 0"},
        {sample_of(2, {1, 1, 1, 'a', 0, 1, 20, 0, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x40}), 8,
         "the number of late samples is 281474976710656, at most 281474976710655"},
    };
    for (const Case& one : cases)
        check_refused(one.bytes, kHead + one.at, one.text);
}

TFDB_TEST(commit_samples_are_cut_at_a_mark) {
    const auto begun = [] {
        SampleWriter writer;
        writer.start();
        const std::uint32_t made[] = {writer.add_name("map")};
        (void)writer.add_authority("slam");
        writer.start_commit(1, {.made = made}, 0);
        return writer;
    };
    const auto finished = [](const SampleWriter& writer) {
        return writer.finish(CommitSample::Kind::kCommits, kEpoch, 0, 7, 9);
    };
    SampleWriter writer = begun();
    const SampleWriter::Mark mark = writer.mark();
    const std::uint32_t made[] = {writer.add_name("base")};
    (void)writer.add_authority("odom");
    writer.start_commit(1, {.made = made}, 0);
    CHECK(finished(writer) != finished(begun()));
    writer.cut(mark);
    CHECK(finished(writer) == finished(begun()));
}

TFDB_TEST(digests_of_names_depend_on_the_names_alone) {
    const std::string_view names[] = {"base", "arm", "base", "map"};
    const std::string_view sorted[] = {"arm", "base", "map"};
    const std::string_view others[] = {"arm", "basemap"};
    // CRC-32C of "arm\0base\0map\0".
    CHECK_EQ(digest_of(names), digest_of(sorted));
    CHECK_EQ(digest_of(sorted), crc32c(std::as_bytes(std::span("arm\0base\0map", 13))));
    CHECK(digest_of(others) != digest_of(sorted));
    CHECK_EQ(digest_of({}), 1U);
}

}  // namespace tfdb::wire
