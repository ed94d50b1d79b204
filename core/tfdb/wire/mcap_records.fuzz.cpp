// libFuzzer over the records of a chunk: all that is given out lies in the chunk, and the walk
// ends.
#include <cstdint>
#include <cstdio>
#include <cstdlib>

#include "tfdb/wire/mcap_records.hpp"

// NOLINTBEGIN(readability-identifier-naming): libFuzzer chose these names.

namespace {

void require(bool holds, const char* what) {
    if (!holds) {
        std::fprintf(stderr, "violated: %s\n", what);
        std::abort();
    }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    const std::span<const std::byte> chunk(reinterpret_cast<const std::byte*>(data), size);
    const auto lies_in_it = [&](std::span<const std::byte> part) {
        return part.empty() || (part.data() >= chunk.data() &&
                                part.data() + part.size() <= chunk.data() + chunk.size());
    };
    tfdb::wire::McapRecords records(chunk);
    std::size_t end = 0;
    std::uint64_t sum = 0;
    while (records.next()) {
        require(records.at() == end, "a record begins where the last one ended");
        end = records.at() + tfdb::wire::McapRecords::kHead + records.content().size();
        require(end <= size, "records end within the chunk");
        require(lies_in_it(records.content()), "what is given out lies in the chunk");
        sum += records.kind();
        if (!records.is_message())
            continue;
        require(lies_in_it(records.payload()), "what is given out lies in the chunk");
        require(records.payload().size() < records.content().size(), "payloads are contents");
        for (const std::byte byte : records.payload())
            sum += std::to_integer<std::uint64_t>(byte);
        sum += records.channel() + records.log_time();
    }
    require(records.at() == end, "the walk ends behind the last whole record");
    require(records.is_broken() == (end < size), "it is broken unless that is the chunk's end");
    static volatile std::uint64_t sink;
    sink = sum;
    return 0;
}

// NOLINTEND(readability-identifier-naming)
