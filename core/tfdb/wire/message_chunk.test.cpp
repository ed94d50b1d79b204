// Written chunks: of MCAP files as the chunk reader reads them, of bags byte for byte.
#include "tfdb/wire/message_chunk.hpp"

#include <cstring>
#include <string>
#include <string_view>

#include "tfdb/testing/check.hpp"
#include "tfdb/wire/mcap_records.hpp"

namespace tfdb::wire {
namespace {

using namespace std::string_view_literals;

std::span<const std::byte> bytes(std::string_view text) {
    return std::as_bytes(std::span(text));
}

std::string text_of(std::span<const std::byte> bytes) {
    return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

std::uint64_t number_at(std::span<const std::byte> from, std::size_t at) {
    std::uint64_t number = 0;
    std::memcpy(&number, from.data() + at, sizeof number);
    return number;
}

}  // namespace

TFDB_TEST(message_chunk_of_mcap_is_read_as_it_was_written) {
    MessageChunk chunk(MessageChunk::Format::kMcap);
    chunk.add_record(bytes("\x63\x02\0\0\0\0\0\0\0ab"sv));
    chunk.add_message(7, 50, bytes("first"));
    chunk.add_message(3, 0xFEDCBA9876543210, {});
    chunk.add_message(7, 40, bytes("third"));
    McapRecords records(chunk.bytes());
    CHECK(records.next());
    CHECK_EQ(records.kind(), 0x63U);
    CHECK_EQ(text_of(records.content()), "ab");
    struct Expected {
        std::uint16_t channel;
        std::uint64_t time;
        std::string data;
    };
    std::vector<std::size_t> places;
    for (const Expected& each :
         {Expected{7, 50, "first"}, {3, 0xFEDCBA9876543210, ""}, {7, 40, "third"}}) {
        CHECK(records.next());
        CHECK(records.is_message());
        CHECK_EQ(records.channel(), each.channel);
        CHECK_EQ(records.log_time(), each.time);
        CHECK_EQ(text_of(records.payload()), each.data);
        places.push_back(records.at());
    }
    CHECK(!records.next());
    CHECK(!records.is_broken());
    CHECK_EQ(chunk.start(), 40U);
    CHECK_EQ(chunk.end(), 0xFEDCBA9876543210);
    CHECK_EQ(chunk.indexes().size(), 2U);
    const MessageChunk::Index& index = chunk.indexes().at(7);
    CHECK_EQ(index.messages, 2U);
    CHECK_EQ(index.entries.size(), 32U);
    CHECK_EQ(number_at(index.entries, 0), 50U);
    CHECK_EQ(number_at(index.entries, 8), places[0]);
    CHECK_EQ(number_at(index.entries, 16), 40U);
    CHECK_EQ(number_at(index.entries, 24), places[2]);
}

TFDB_TEST(message_chunk_of_a_bag_has_the_records_of_the_format) {
    MessageChunk chunk(MessageChunk::Format::kBag);
    chunk.add_record(bytes("xyz"));
    chunk.add_message(258, 3'000'000'004, bytes("data"));
    const auto record =
        "\x26\0\0\0"
        "\x04\0\0\0op=\x02"
        "\x09\0\0\0conn=\x02\x01\0\0"
        "\x0d\0\0\0time=\x03\0\0\0\x04\0\0\0"
        "\x04\0\0\0"
        "data"sv;
    CHECK_EQ(text_of(chunk.bytes()), "xyz" + std::string(record));
    const MessageChunk::Index& index = chunk.indexes().at(258);
    CHECK_EQ(index.messages, 1U);
    CHECK_EQ(text_of(index.entries), std::string("\x03\0\0\0\x04\0\0\0\x03\0\0\0"sv));
}

TFDB_TEST(message_chunk_starts_again_when_cleared) {
    MessageChunk chunk(MessageChunk::Format::kMcap);
    chunk.add_message(1, 5, bytes("a"));
    chunk.clear();
    CHECK(chunk.bytes().empty());
    CHECK(chunk.indexes().empty());
    CHECK(chunk.start() > chunk.end());
    chunk.add_message(1, 9, bytes("b"));
    CHECK_EQ(chunk.start(), 9U);
    CHECK_EQ(chunk.end(), 9U);
    CHECK_EQ(number_at(chunk.indexes().at(1).entries, 8), 0U);
}

}  // namespace tfdb::wire
