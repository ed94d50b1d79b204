// Chunks of MCAP files, intact ones and ones with wrong lengths.
#include "tfdb/wire/mcap_records.hpp"

#include <limits>
#include <vector>

#include "tfdb/testing/check.hpp"

namespace tfdb::wire {
namespace {

/// The bytes of a chunk, record by record.
class Chunk {
public:
    Chunk& number(std::uint64_t value, unsigned width) {
        for (unsigned i = 0; i < width; ++i)
            bytes.push_back(static_cast<std::byte>(value >> (8 * i)));
        return *this;
    }
    Chunk& head(std::uint8_t kind, std::uint64_t length) {
        return number(kind, 1).number(length, 8);
    }
    Chunk& message(std::uint16_t channel, std::uint64_t log_time, std::size_t payload) {
        head(McapRecords::kMessage, 22 + payload);
        number(channel, 2).number(77, 4).number(log_time, 8).number(78, 8);
        for (std::size_t i = 0; i < payload; ++i)
            number(i + 1, 1);
        return *this;
    }

    std::vector<std::byte> bytes;
};

}  // namespace

TFDB_TEST(mcap_records_are_given_as_they_lie) {
    Chunk chunk;
    chunk.head(McapRecords::kSchema, 3).number(0x030201, 3);
    chunk.message(0x1234, 0xFEDCBA9876543210, 5).message(2, 9, 0).head(0x99, 0);
    McapRecords records(chunk.bytes);
    CHECK(records.next());
    CHECK_EQ(records.kind(), McapRecords::kSchema);
    CHECK(!records.is_message());
    CHECK_EQ(records.content().size(), 3U);
    CHECK(records.content()[2] == std::byte{3});
    CHECK(records.next());
    CHECK_EQ(records.kind(), McapRecords::kMessage);
    CHECK_EQ(records.at(), 12U);
    CHECK_EQ(records.channel(), 0x1234);
    CHECK_EQ(records.log_time(), 0xFEDCBA9876543210U);
    CHECK_EQ(records.payload().size(), 5U);
    CHECK(records.payload()[0] == std::byte{1});
    CHECK(records.next());
    CHECK_EQ(records.channel(), 2);
    CHECK_EQ(records.log_time(), 9U);
    CHECK(records.payload().empty());
    CHECK(records.next());
    CHECK_EQ(records.kind(), 0x99);
    CHECK(!records.next());
    CHECK(!records.is_broken());
    McapRecords none({});
    CHECK(!none.next());
    CHECK(!none.is_broken());
}

TFDB_TEST(mcap_records_that_go_beyond_the_chunk_end_the_walk) {
    Chunk whole;
    whole.message(1, 2, 30);
    const std::size_t size = whole.bytes.size();
    constexpr std::uint64_t kMost = std::numeric_limits<std::uint64_t>::max();
    for (const std::uint64_t length : {kMost, kMost - 8, kMost - size - 8, std::uint64_t{1} << 63,
                                       std::uint64_t{size}, std::uint64_t{size - 8}}) {
        Chunk chunk = whole;
        chunk.head(McapRecords::kMessage, length);
        chunk.number(0, 8);
        McapRecords records(chunk.bytes);
        CHECK(records.next());
        const bool fits = length <= 8;
        CHECK_EQ(records.next(), fits);
        CHECK_EQ(records.is_broken(), !fits);
        CHECK_EQ(records.at(), size);
        CHECK_EQ(records.length(), length);
    }
    for (std::size_t cut = 1; cut < size; ++cut) {
        McapRecords records(std::span(whole.bytes).first(cut));
        CHECK(!records.next());
        CHECK(records.is_broken());
        CHECK_EQ(records.at(), 0U);
    }
}

TFDB_TEST(mcap_messages_too_short_for_their_head_are_none) {
    for (std::uint64_t length = 0; length <= 22; ++length) {
        Chunk chunk;
        chunk.head(McapRecords::kMessage, length);
        for (std::uint64_t i = 0; i < length; ++i)
            chunk.number(0xFF, 1);
        chunk.message(7, 8, 9);
        McapRecords records(chunk.bytes);
        CHECK(records.next());
        CHECK_EQ(records.kind(), McapRecords::kMessage);
        CHECK_EQ(records.content().size(), length);
        CHECK_EQ(records.is_message(), length == 22);
        CHECK(records.next());
        CHECK(records.is_message());
        CHECK_EQ(records.log_time(), 8U);
        CHECK(!records.next());
        CHECK(!records.is_broken());
    }
}

}  // namespace tfdb::wire
