#include "tfdb/wire/message_chunk.hpp"

#include <algorithm>
#include <string_view>

#include "tfdb/wire/mcap_records.hpp"

namespace tfdb::wire {
namespace {

constexpr std::uint64_t kNanosPerSecond = 1'000'000'000;

/// Appends little-endian numbers and bytes.
class RecordWriter {
public:
    explicit RecordWriter(std::vector<std::byte>& to) : to_(to) {}

    RecordWriter& number(std::uint64_t value, unsigned width) {
        for (unsigned i = 0; i < width; ++i)
            to_.push_back(static_cast<std::byte>(value >> (8 * i)));
        return *this;
    }
    RecordWriter& text(std::string_view text) { return bytes(std::as_bytes(std::span(text))); }
    RecordWriter& bytes(std::span<const std::byte> bytes) {
        to_.insert(to_.end(), bytes.begin(), bytes.end());
        return *this;
    }
    /// A ROS 1 time: seconds and nanoseconds.
    RecordWriter& time(std::uint64_t time) {
        return number(time / kNanosPerSecond, 4).number(time % kNanosPerSecond, 4);
    }

private:
    std::vector<std::byte>& to_;
};

void write_mcap_message(RecordWriter to, std::uint32_t channel, std::uint64_t time,
                        std::span<const std::byte> data) {
    constexpr std::size_t kHead = 2 + 4 + 8 + 8;
    to.number(McapRecords::kMessage, 1).number(kHead + data.size(), 8);
    // Recorders of tf write no sequence numbers or publish times.
    to.number(channel, 2).number(0, 4).number(time, 8).number(time, 8).bytes(data);
}

void write_bag_message(RecordWriter to, std::uint32_t connection, std::uint64_t time,
                       std::span<const std::byte> data) {
    constexpr std::string_view kOp = "op=\x02";
    constexpr std::string_view kConnection = "conn=";
    constexpr std::string_view kTime = "time=";
    constexpr std::size_t kHeader =
        4 + kOp.size() + 4 + kConnection.size() + 4 + 4 + kTime.size() + 8;
    to.number(kHeader, 4).number(kOp.size(), 4).text(kOp);
    to.number(kConnection.size() + 4, 4).text(kConnection).number(connection, 4);
    to.number(kTime.size() + 8, 4).text(kTime).time(time);
    to.number(data.size(), 4).bytes(data);
}

}  // namespace

void MessageChunk::add_record(std::span<const std::byte> record) {
    RecordWriter(bytes_).bytes(record);
}

void MessageChunk::add_message(std::uint32_t channel, std::uint64_t time,
                               std::span<const std::byte> data) {
    start_ = std::min(start_, time);
    end_ = std::max(end_, time);
    Index& index = indexes_[channel];
    ++index.messages;
    if (format_ == Format::kMcap) {
        RecordWriter(index.entries).number(time, 8).number(bytes_.size(), 8);
        write_mcap_message(RecordWriter(bytes_), channel, time, data);
    } else {
        RecordWriter(index.entries).time(time).number(bytes_.size(), 4);
        write_bag_message(RecordWriter(bytes_), channel, time, data);
    }
}

void MessageChunk::clear() {
    bytes_.clear();
    indexes_.clear();
    start_ = UINT64_MAX;
    end_ = 0;
}

}  // namespace tfdb::wire
