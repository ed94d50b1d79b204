// Commits and states of a store as bytes, which one store sends and another applies. docs/wire.md
// describes the format byte by byte.
//
// A sample is self-contained: it has all names that it uses, and none of its numbers depends on
// another sample or on the receiver's store.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <tuple>
#include <vector>

#include "tfdb/base/error.hpp"
#include "tfdb/base/types.hpp"
#include "tfdb/clock/stamp.hpp"

namespace tfdb::wire {

/// One life of a store, which numbers its commits. The greater of two epochs is the later one.
struct Epoch {
    std::uint64_t number = 0;
    std::uint64_t high = 0;  // of its random id
    std::uint64_t low = 0;

    [[nodiscard]] bool operator==(const Epoch&) const = default;
    [[nodiscard]] bool operator<(const Epoch& other) const {
        return std::tie(number, high, low) < std::tie(other.number, other.high, other.low);
    }
};

/// A digest of names, independent of their order; never 0.
[[nodiscard]] std::uint32_t digest_of(std::span<const std::string_view> names);

/// The content of a sample.
/// Threads: a value; the names are views into the bytes. Guarantee: `decode` fills it.
struct CommitSample {
    enum class Kind : std::uint8_t { kCommits = 1, kState = 2 };

    /// A range of the names, or of the edges.
    struct Range {
        std::uint32_t first = 0;
        std::uint32_t count = 0;
    };
    /// A sample T[parent<-child] of an edge.
    struct Row {
        clock::StampNs stamp = 0;  // 0 for a static edge
        std::uint32_t parent = 0;  // index of a name; 0 for a frame that is gone in a state
        bool gone = false;  // the parent is the frame that the commit removed, not a living one
        std::array<std::uint64_t, 7> numbers{};  // bits of x, y, z, qx, qy, qz, qw
    };
    /// Samples of one edge, in stamp order.
    struct Edge {
        std::uint32_t child = 0;      // index of a name
        std::uint32_t authority = 0;  // index of an authority
        bool is_static = false;
        bool cleared = false;    // for a state: a clear removed its samples, and it has none since
        std::uint64_t late = 0;  // for a state: number of out-of-order samples
        Range rows{};
    };
    struct Commit {
        CommitNumber number = 0;
        Range cleared{};  // of `refs`, as are the next three
        Range removed{};
        Range passing{};
        Range made{};
        Range edges{};
    };

    Kind kind = Kind::kCommits;
    Epoch epoch{};
    std::uint32_t choice = 0;  // digest of the chosen frames' names; 0: all frames
    CommitNumber since = 0;    // for a state: its own commit, as `last`
    CommitNumber last = 0;
    std::vector<std::string_view> names;
    std::vector<std::string_view> authorities;  // the first one is empty
    std::vector<std::uint32_t> refs;            // indices of names
    std::vector<Commit> commits;  // a state has one, which lists its frames as created
    std::vector<Edge> edges;
    std::vector<Row> rows;

    [[nodiscard]] std::span<const std::uint32_t> names_of(Range range) const {
        return std::span(refs).subspan(range.first, range.count);
    }
    [[nodiscard]] std::span<const Edge> edges_of(const Commit& commit) const {
        return std::span(edges).subspan(commit.edges.first, commit.edges.count);
    }
    [[nodiscard]] std::span<const Row> rows_of(const Edge& edge) const {
        return std::span(rows).subspan(edge.rows.first, edge.rows.count);
    }

    /// Whether it is worth keeping for the next sample.
    [[nodiscard]] bool is_small() const { return rows.capacity() <= kMostKept; }
    void clear();

    /// Replaces the content by that of the bytes; the vectors keep their capacity. Throws
    /// CorruptMessage, which names the byte; the content is then unspecified.
    void decode(std::span<const std::byte> data);

private:
    static constexpr std::size_t kMostKept = 4096;
};

/// Writes a sample step by step.
/// Threads: one. Guarantee: the vectors keep their capacity for the next sample.
class SampleWriter {
public:
    using Row = CommitSample::Row;
    using Edge = CommitSample::Edge;

    /// Begins another sample.
    void start();
    /// Each adds a name that this sample does not have yet, and returns its index.
    std::uint32_t add_name(std::string_view name);
    std::uint32_t add_authority(std::string_view name);

    struct Lists {
        std::span<const std::uint32_t> cleared{};
        std::span<const std::uint32_t> removed{};
        std::span<const std::uint32_t> passing{};
        std::span<const std::uint32_t> made{};
    };
    /// Begins a commit, `after` commits after the previous one or after `since`; `edges` edges
    /// follow.
    void start_commit(std::uint64_t after, const Lists& lists, std::size_t edges);
    /// Adds an edge of a commit.
    void add_edge(const Edge& edge, std::span<const Row> rows);
    /// Adds a frame of a state: the next one of the names. Names of parents come after those of all
    /// frames.
    void add_frame(const Edge& edge, std::span<const Row> rows);

    /// A position in the sample.
    struct Mark {
        std::size_t body = 0;
        std::size_t names = 0;  // their bytes
        std::size_t authorities = 0;
        std::uint32_t name_count = 0;
        std::uint32_t authority_count = 0;
        std::uint64_t commits = 0;
    };
    [[nodiscard]] Mark mark() const;
    /// Discards everything after the mark; then the sample can only be finished.
    void cut(const Mark& mark);
    [[nodiscard]] std::uint64_t commits() const { return commits_; }
    /// Size of the whole sample now, or a few bytes less.
    [[nodiscard]] std::size_t size() const;

    /// Returns the whole sample. `frames`: number of a state's frames.
    [[nodiscard]] std::vector<std::byte> finish(CommitSample::Kind kind, const Epoch& epoch,
                                                std::uint32_t choice, CommitNumber since,
                                                CommitNumber last, std::uint64_t frames = 0) const;

private:
    /// An edge's last row in this sample.
    struct Before {
        bool any = false;
        std::uint32_t parent = 0;
        std::array<std::uint64_t, 7> numbers{};
    };
    void write_rows(const Edge& edge, std::span<const Row> rows);
    void write_row(const Edge& edge, const Row& row);

    std::vector<std::byte> body_;
    std::vector<std::byte> names_;
    std::vector<std::byte> authorities_;
    std::uint32_t name_count_ = 0;
    std::uint32_t authority_count_ = 0;
    std::uint64_t commits_ = 0;
    std::vector<Before> before_;   // by name
    clock::StampNs stamp_ = 0;     // of the previous row
    std::uint32_t authority_ = 0;  // of the previous edge
};

}  // namespace tfdb::wire
