// libFuzzer over samples of commits and states: decoded indices stay inside the sample, and
// encoding it again gives the same bytes.
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <vector>

#include "tfdb/wire/commit_sample.hpp"
#include "tfdb/wire/commit_sample.rewritten.hpp"
#include "tfdb/wire/crc32c.hpp"

// NOLINTBEGIN(readability-identifier-naming): libFuzzer chose these names.

namespace {

using tfdb::wire::CommitSample;

void require(bool holds, const char* what) {
    if (!holds) {
        std::fprintf(stderr, "violated: %s\n", what);
        std::abort();
    }
}

void check(const CommitSample& sample, std::span<const std::byte> bytes) {
    const auto* const begin = reinterpret_cast<const char*>(bytes.data());
    for (const auto* texts : {&sample.names, &sample.authorities}) {
        for (const std::string_view text : *texts)
            require(text.empty() ||
                        (text.data() >= begin && text.data() + text.size() <= begin + bytes.size()),
                    "names lie in the sample");
    }
    const bool is_state = sample.kind == CommitSample::Kind::kState;
    tfdb::CommitNumber before = sample.since;
    for (const CommitSample::Commit& commit : sample.commits) {
        require(is_state || commit.number > before, "commits ascend");
        require(commit.number <= sample.last, "no commit comes behind the last one");
        before = commit.number;
        for (const auto& list : {commit.cleared, commit.removed, commit.passing, commit.made}) {
            for (const std::uint32_t name : sample.names_of(list))
                require(name < sample.names.size(), "lists hold names");
        }
        for (const CommitSample::Edge& edge : sample.edges_of(commit)) {
            require(edge.child < sample.names.size(), "an edge has a child");
            require(edge.authority < sample.authorities.size(), "an edge has an authority");
            require(!edge.is_static || edge.rows.count == 1, "a static edge has one sample");
            for (const CommitSample::Row& row : sample.rows_of(edge))
                require((is_state && row.gone) || row.parent < sample.names.size(),
                        "a sample has a parent");
        }
    }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    const auto* const begin = reinterpret_cast<const std::byte*>(data);
    std::vector<std::byte> bytes(begin, begin + size);
    if (size >= 4) {
        // Otherwise hardly any input would get past the checksum.
        const std::uint32_t sum = tfdb::wire::crc32c(std::span(bytes).first(size - 4));
        for (std::size_t i = 0; i < 4; ++i)
            bytes[size - 4 + i] = std::byte(sum >> (8 * i));
    }
    static CommitSample sample;
    try {
        sample.decode(bytes);
    } catch (const tfdb::CorruptMessage&) {
        return 0;
    }
    check(sample, bytes);
    require(tfdb::wire::testing::rewritten(sample) == bytes, "a sample has one spelling");
    return 0;
}

// NOLINTEND(readability-identifier-naming)
