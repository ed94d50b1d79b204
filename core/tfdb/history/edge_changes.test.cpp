// The changes since a commit, checked by a plain list of the samples.
#include "tfdb/history/edge_changes.hpp"

#include <cstdio>
#include <random>
#include <vector>

#include "tfdb/history/edge_writer.hpp"
#include "tfdb/memory/region.hpp"
#include "tfdb/testing/check.hpp"

namespace tfdb::history {
namespace {

using Memory = memory::Region;

constexpr StampNs kClearMarker = -3;  // marks a clear

/// Commits of one sample each to one edge.
class Edge : private Readers {
public:
    explicit Edge(StampNs history) : history_(history) {
        header_ = memory_.allocate(kHeaderBytes);
        for (unsigned w = 0; w < kHeaderWords; ++w)
            memory_.word(header_ + 8 * w).store_relaxed(0);
        memory_.word(header_ + 8 * kTopology).store_relaxed(Topology::kRoot);
    }

    /// kClearMarker clears; stamps that are already too old are skipped.
    void commit(StampNs stamp, FrameId parent = 1) {
        EdgeWriter<Memory> writer(memory_, header_);
        if (stamp >= 0 && stamp < writer.newest() - history_)
            return;
        NewSample<Memory> sample;
        sample.stamp = stamp;
        sample.parent = parent;
        const WriteContext context(committed_, history_, *this);
        if (stamp == kClearMarker)
            writer.clear(context);
        else
            writer.append(context, sample);
        stamps_.push_back({stamp, ++committed_});
    }
    [[nodiscard]] EdgeChange since(CommitNumber commit, const std::vector<StampRange>& ranges,
                                   StampNs lowest = kNoStamp) {
        return EdgeChanges<Memory>(memory_, header_, commit, history_).find(ranges, lowest);
    }
    [[nodiscard]] CommitNumber committed() const { return committed_; }
    [[nodiscard]] StampNs newest_stamp() { return EdgeWriter<Memory>(memory_, header_).newest(); }
    /// Whether a reader with these dependencies must be notified, by the list.
    [[nodiscard]] bool expected(CommitNumber commit, const std::vector<StampRange>& ranges,
                                StampNs lowest) {
        for (const Stored& stored : stamps_) {
            if (stored.commit <= commit)
                continue;
            if (stored.stamp == kClearMarker)
                return true;
            for (const StampRange& range : ranges) {
                // No state shows an evicted sample.
                if (range.from <= stored.stamp && stored.stamp <= range.to &&
                    stored.stamp >= newest_stamp() - history_) {
                    return true;
                }
            }
        }
        return lowest >= 0 && committed_ > commit && lowest < newest_stamp() - history_;
    }

private:
    [[nodiscard]] CommitNumber oldest_read() override { return committed_; }
    [[nodiscard]] std::uint64_t next_epoch() override { return epoch_ + 1; }
    [[nodiscard]] std::uint64_t begin_epoch() override { return ++epoch_; }
    void held(std::uint64_t) override {}

    struct Stored {
        StampNs stamp;
        CommitNumber commit;
    };
    Memory memory_;
    Offset header_ = 0;
    StampNs history_;
    CommitNumber committed_ = 0;
    std::uint64_t epoch_ = 0;
    std::vector<Stored> stamps_;
};

Change what(const EdgeChange& change) {
    return change.change;
}

}  // namespace

TFDB_TEST(edge_changes_say_what_happened) {
    Edge edge(kForever);
    for (const StampNs stamp : {10, 20, 30})
        edge.commit(stamp);
    const CommitNumber since = edge.committed();
    CHECK(!edge.since(since, {{}}));
    edge.commit(40);
    CHECK_EQ(what(edge.since(since, {{30, 100}})), Change::kNewer);
    CHECK_EQ(edge.since(since, {{30, 100}}).stamp, 40);
    CHECK_EQ(what(edge.since(since, {{40, 40}})), Change::kNewer);
    CHECK(!edge.since(since, {{10, 20}, {25, 39}, {41, 50}}));
    CHECK(!edge.since(edge.committed(), {{}}));
    edge.commit(15);
    CHECK_EQ(what(edge.since(since, {{10, 20}})), Change::kLate);
    CHECK_EQ(what(edge.since(since, {{15, 15}})), Change::kLate);
    CHECK(!edge.since(since, {{16, 20}}));
    CHECK(!edge.since(since, {}));
    edge.commit(50, 2);
    CHECK_EQ(what(edge.since(since, {{50, 60}})), Change::kReparent);
    edge.commit(kClearMarker);
    CHECK_EQ(what(edge.since(since, {})), Change::kCleared);
    const CommitNumber cleared = edge.committed();
    edge.commit(kStaticStamp);
    CHECK_EQ(what(edge.since(cleared, {{}})), Change::kStatic);
    CHECK_EQ(what(edge.since(since, {{}})), Change::kCleared);
    CHECK(!edge.since(edge.committed(), {{}}));
}

TFDB_TEST(edge_changes_mind_what_is_forgotten) {
    Edge edge(100);
    edge.commit(10);
    edge.commit(20);
    const CommitNumber since = edge.committed();
    edge.commit(110);
    CHECK(!edge.since(since, {{10, 20}}, 10));
    edge.commit(111);
    CHECK_EQ(what(edge.since(since, {{10, 20}}, 10)), Change::kForgotten);
    CHECK(!edge.since(since, {{10, 20}}, 20));
    CHECK(!edge.since(since, {{10, 20}}, kNoStamp));
}

TFDB_TEST(edge_changes_are_those_of_a_plain_list) {
    int found = 0;
    int asked = 0;
    for (unsigned seed = 1; seed <= 60; ++seed) {
        std::mt19937 random(seed);
        const auto below = [&](int n) {
            return static_cast<StampNs>(random() % static_cast<unsigned>(n));
        };
        Edge edge(seed % 3 == 0 ? kForever : 40);
        const int spread = seed % 2 == 0 ? 5 : 60;
        for (int i = 0; i < 300; ++i) {
            const bool clear = below(200) == 0;
            edge.commit(clear ? kClearMarker : i + below(spread),
                        static_cast<FrameId>(1 + below(20) / 19));
            const CommitNumber since =
                edge.committed() -
                std::min<CommitNumber>(edge.committed(), static_cast<CommitNumber>(below(12)));
            std::vector<StampRange> ranges;
            StampNs from = i - 40 + below(30);
            for (int k = 0; k < 3; ++k) {
                const StampNs to = from + below(8);
                // Samples older than all retained ones were not part of any answer.
                if (from >= edge.newest_stamp() - (seed % 3 == 0 ? kForever : 40))
                    ranges.push_back({from, to});
                from = to + 1 + below(8);
            }
            const StampNs lowest = ranges.empty() ? kNoStamp : ranges.front().from;
            const EdgeChange change = edge.since(since, ranges, lowest);
            const bool expected = edge.expected(since, ranges, lowest);
            CHECK_EQ(static_cast<bool>(change), expected);
            ++asked;
            found += expected ? 1 : 0;
        }
    }
    std::printf("  edge changes: seeds 1..60, %d of %d changed\n", found, asked);
    CHECK(found > asked / 20);
}

}  // namespace tfdb::history
