// One edge in its own region, and the same samples in a plain list that checks its answers.
#pragma once

#include <map>
#include <random>
#include <vector>

#include "tfdb/history/edge_view.hpp"
#include "tfdb/history/edge_writer.hpp"
#include "tfdb/memory/region.hpp"
#include "tfdb/testing/check.hpp"

namespace tfdb::history::fixture {

/// Counts accesses to words.
/// Threads: one. Guarantee: as Region.
struct Memory : memory::Region {
    [[nodiscard]] Word& word(Offset offset) const noexcept {
        ++looks;
        return Region::word(offset);
    }
    mutable std::uint64_t looks = 0;
};
using View = EdgeView<Memory>;

/// Marks a clear among the stamps of a commit.
inline constexpr StampNs kClearMarker = -3;

/// Commits to one edge as a store does, and reads any snapshot.
/// Threads: one. Guarantee: every answer is checked against the plain list.
class Edge : private Readers {
public:
    explicit Edge(StampNs history = kForever) : history_(history) {
        header_ = memory_.allocate(kHeaderBytes);
        for (unsigned w = 0; w < kHeaderWords; ++w)
            memory_.word(header_ + 8 * w).store_relaxed(0);
        word(kTopology).store_relaxed(Topology::kRoot);
    }

    [[nodiscard]] CommitNumber committed() const { return committed_; }
    /// Without retired blocks.
    [[nodiscard]] std::size_t used_bytes() const {
        return memory_.used_bytes() - memory_.retired_bytes(Line::kReplaced) -
               memory_.retired_bytes(Line::kEnded);
    }
    /// The number of words read to compute the extent of a snapshot's samples, which it checks.
    [[nodiscard]] std::uint64_t looks_for_extent(CommitNumber snapshot) {
        View view;
        Extent extent;
        const std::uint64_t before = memory_.looks;
        CHECK(open(snapshot, view) && view.extent(extent) && view.confirm());
        const std::uint64_t looks = memory_.looks - before;
        compare(extent, visible(snapshot));
        return looks;
    }
    /// The number of words read to find a snapshot's samples around a stamp, which it checks.
    [[nodiscard]] std::uint64_t looks_for(CommitNumber snapshot, StampNs stamp) {
        CHECK(check(snapshot, stamp));
        View view;
        Bracket around;
        const std::uint64_t before = memory_.looks;
        CHECK(open(snapshot, view) && view.bracket(stamp, around) && view.confirm());
        CHECK(view.least_commit() <= snapshot);
        return memory_.looks - before;
    }
    [[nodiscard]] std::uint64_t word_value(HeaderWord w) const {
        return memory_.word(header_ + 8 * w).load_relaxed();
    }
    /// Held snapshots keep the samples that they see from now on.
    void hold(bool held) { held_ = held; }

    /// From now on, a commit's samples, in stamp order, are appended in one call.
    void hand_in_together() { together_ = true; }

    void commit(const std::vector<StampNs>& stamps, FrameId parent = 1) {
        append(stamps, parent);
        ++committed_;
        if (cleared_)
            writer().retire_older(context_);
        for (const Entry& entry : pending_)
            entries_.push_back(entry);
        pending_.clear();
    }
    /// Writes the samples and rolls them back.
    void abort(const std::vector<StampNs>& stamps, FrameId parent = 1) {
        append(stamps, parent);
        pending_.clear();
        writer().trim(context_);
    }

    [[nodiscard]] bool open(CommitNumber snapshot, View& view) {
        return view.open(memory_, header_, snapshot, history_, {epoch_, snapshot});
    }

    /// Reads one snapshot around one stamp. False: a writer overtook the read.
    [[nodiscard]] bool check(CommitNumber snapshot, StampNs stamp) {
        View view;
        Bracket around;
        SampleAt oldest;
        Extent extent;
        if (!open(snapshot, view) || !view.bracket(stamp, around) || !view.oldest(oldest) ||
            !view.extent(extent) || !view.confirm()) {
            return false;
        }
        const auto& expected = visible(snapshot);
        const auto after = expected.upper_bound(stamp);
        compare(view, around.after, after == expected.end() ? nullptr : &after->second);
        compare(view, around.before,
                after == expected.begin() ? nullptr : &std::prev(after)->second);
        compare(view, view.newest(), expected.empty() ? nullptr : &expected.rbegin()->second);
        compare(view, oldest, expected.empty() ? nullptr : &expected.begin()->second);
        compare(extent, expected);
        return true;
    }
    /// The newest state always answers, for every stamp near a visible sample.
    void check_newest(StampNs stamp) { CHECK(check(committed_, stamp)); }

    void check_static(CommitNumber snapshot) {
        View view;
        CHECK(open(snapshot, view));
        const Entry* expected = nullptr;
        for (const Entry& entry : entries_) {
            if (entry.commit <= snapshot)
                expected = &entry;
        }
        CHECK_EQ(view.is_static(), expected != nullptr);
        if (expected != nullptr)
            compare(view, view.newest(), expected);
    }

private:
    struct Entry {
        StampNs stamp;
        FrameId parent;
        std::uint64_t value;
        CommitNumber commit;
    };

    [[nodiscard]] Memory::Word& word(HeaderWord w) { return memory_.word(header_ + 8 * w); }
    [[nodiscard]] EdgeWriter<Memory> writer() { return {memory_, header_}; }

    void append(const std::vector<StampNs>& stamps, FrameId parent) {
        context_ = WriteContext(committed_, history_, *this);
        cleared_ = false;
        std::vector<NewSample<Memory>> together;
        for (const StampNs stamp : stamps) {
            if (stamp == kClearMarker) {
                writer().clear(context_);
                cleared_ = true;
            } else {
                NewSample<Memory> sample;
                sample.stamp = stamp;
                sample.parent = parent;
                sample.payload.fill(++value_);
                if (together_) {
                    together.push_back(sample);
                } else {
                    writer().append(context_, sample);
                }
            }
            pending_.push_back({stamp, parent, value_, committed_ + 1});
        }
        if (!together.empty())
            writer().append(context_, std::span<const NewSample<Memory>>(together));
    }
    [[nodiscard]] CommitNumber oldest_read() override { return held_ ? 0 : committed_; }
    [[nodiscard]] std::uint64_t next_epoch() override { return epoch_ + 1; }
    [[nodiscard]] std::uint64_t begin_epoch() override { return ++epoch_; }
    void held(std::uint64_t) override {}

    [[nodiscard]] const std::map<StampNs, Entry>& visible(CommitNumber snapshot) {
        if (seen_snapshot_ == snapshot && seen_entries_ == entries_.size())
            return seen_;
        seen_snapshot_ = snapshot;
        seen_entries_ = entries_.size();
        std::map<StampNs, Entry>& found = seen_;
        found.clear();
        for (const Entry& entry : entries_) {
            if (entry.commit > snapshot)
                break;
            if (entry.stamp == kClearMarker) {
                found.clear();
            } else {
                found.insert_or_assign(entry.stamp, entry);
            }
        }
        if (!found.empty())
            found.erase(found.begin(), found.lower_bound(found.rbegin()->first - history_));
        return found;
    }

    static void compare(const Extent& extent, const std::map<StampNs, Entry>& expected) {
        Extent wanted;
        wanted.samples = expected.size();
        StampNs before = expected.empty() ? kNoStamp : expected.begin()->first;
        wanted.first = before;
        for (const auto& [stamp, entry] : expected) {
            wanted.longest_gap = std::max(wanted.longest_gap, stamp - before);
            before = wanted.last = stamp;
        }
        CHECK(extent == wanted);
    }
    static void compare(const View& view, const SampleAt& sample, const Entry* expected) {
        CHECK_EQ(!sample, expected == nullptr);
        if (!sample || expected == nullptr)
            return;
        const SlotData<Memory> slot = view.read(sample);
        CHECK_EQ(sample.stamp, expected->stamp);
        CHECK_EQ(slot.parent, expected->parent);
        CHECK_EQ(slot.commit, expected->commit);
        CHECK_EQ(slot.payload.front(), expected->value);
        CHECK_EQ(slot.payload.back(), expected->value);
    }

    Memory memory_;
    Offset header_ = 0;
    StampNs history_;
    bool held_ = false;
    bool together_ = false;
    std::uint64_t epoch_ = 0;
    CommitNumber committed_ = 0;
    WriteContext context_{0, history_, *this};
    bool cleared_ = false;
    std::uint64_t value_ = 0;
    std::vector<Entry> entries_;
    std::vector<Entry> pending_;
    std::map<StampNs, Entry> seen_;  // the last result of `visible`
    CommitNumber seen_snapshot_ = 0;
    std::size_t seen_entries_ = 0;
};

}  // namespace tfdb::history::fixture
