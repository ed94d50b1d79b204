// One edge in a region of its own, and the same samples in a plain list that judges it.
#pragma once

#include <map>
#include <random>
#include <vector>

#include "tfdb/history/edge_view.hpp"
#include "tfdb/history/edge_writer.hpp"
#include "tfdb/memory/private_memory.hpp"
#include "tfdb/testing/check.hpp"

namespace tfdb::history::fixture {

using Memory = memory::PrivateMemory;
using View = EdgeView<Memory>;

/// Commits to one edge, as a store makes them, and asks any snapshot.
/// Threads: one. Guarantee: every answer is judged by the plain list.
class Edge {
public:
    explicit Edge(StampNs history = kForever) : history_(history) {
        header_ = memory_.allocate(kHeaderBytes);
        for (unsigned w = 0; w < kHeaderWords; ++w)
            memory_.word(header_ + 8 * w).store_relaxed(0);
        word(kNewest).store_relaxed(as_word(kNoStamp));
        word(kTopology).store_relaxed(Topology::kRoot);
    }

    [[nodiscard]] CommitNumber committed() const { return committed_; }
    [[nodiscard]] std::size_t used_bytes() const { return memory_.used_bytes(); }
    [[nodiscard]] std::uint64_t word_value(HeaderWord w) const {
        return memory_.word(header_ + 8 * w).load_relaxed();
    }
    /// From now on held snapshots keep what they see.
    void hold(bool held) { held_ = held; }

    void commit(const std::vector<StampNs>& stamps, FrameId parent = 1) {
        append(stamps, parent);
        ++committed_;
        for (const Entry& entry : pending_)
            entries_.push_back(entry);
        pending_.clear();
    }
    /// Writes the same and takes it back.
    void abort(const std::vector<StampNs>& stamps, FrameId parent = 1) {
        const EdgeUndo saved = writer().save();
        append(stamps, parent);
        pending_.clear();
        writer().undo(saved);
    }

    [[nodiscard]] bool open(CommitNumber snapshot, View& view) {
        return view.open(memory_, header_, snapshot, history_);
    }

    /// Asks one snapshot around one stamp. False: it said that it was overtaken.
    [[nodiscard]] bool check(CommitNumber snapshot, StampNs stamp) {
        View view;
        Bracket around;
        std::uint64_t newest = 0;
        std::uint64_t oldest = 0;
        StampNs newest_stamp = kNoStamp;
        StampNs oldest_stamp = kNoStamp;
        if (!open(snapshot, view) || !view.bracket(stamp, around) ||
            !view.newest(newest, newest_stamp) || !view.oldest(oldest, oldest_stamp) ||
            !view.confirm(around.lowest)) {
            return false;
        }
        const auto& expected = visible(snapshot);
        const auto after = expected.upper_bound(stamp);
        judge(view, around.after, after == expected.end() ? nullptr : &after->second);
        judge(view, around.before, after == expected.begin() ? nullptr : &std::prev(after)->second);
        judge(view, newest, expected.empty() ? nullptr : &expected.rbegin()->second);
        judge(view, oldest, expected.empty() ? nullptr : &expected.begin()->second);
        return true;
    }
    /// The newest state always answers, for every stamp near a visible one.
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
            judge(view, view.static_index(), expected);
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
        const WriteContext context{committed_, history_, !held_};
        for (const StampNs stamp : stamps) {
            NewSample<Memory> sample;
            sample.stamp = stamp;
            sample.parent = parent;
            sample.payload.fill(++value_);
            writer().append(context, sample);
            pending_.push_back({stamp, parent, value_, committed_ + 1});
        }
    }

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

    static void judge(const View& view, std::uint64_t index, const Entry* expected) {
        CHECK_EQ(index == kNoIndex, expected == nullptr);
        if (index == kNoIndex || expected == nullptr)
            return;
        const SlotData<Memory> slot = view.read(index);
        CHECK_EQ(view.stamp_at(index), expected->stamp);
        CHECK_EQ(slot.parent, expected->parent);
        CHECK_EQ(slot.commit, expected->commit);
        CHECK_EQ(slot.payload.front(), expected->value);
        CHECK_EQ(slot.payload.back(), expected->value);
    }

    Memory memory_;
    Offset header_ = 0;
    StampNs history_;
    bool held_ = false;
    CommitNumber committed_ = 0;
    std::uint64_t value_ = 0;
    std::vector<Entry> entries_;
    std::vector<Entry> pending_;
    std::map<StampNs, Entry> seen_;  // what `visible` found last
    CommitNumber seen_snapshot_ = 0;
    std::size_t seen_entries_ = 0;
};

}  // namespace tfdb::history::fixture
