// Detects changes of an edge since a commit, on which a read of that commit depends.
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>
#include <span>

#include "tfdb/history/segment.hpp"

namespace tfdb::history {

/// A range of stamps, both ends included. A new sample inside changes an answer.
struct StampRange {
    StampNs from = std::numeric_limits<StampNs>::min();
    StampNs to = std::numeric_limits<StampNs>::max();
};

/// The kind of a change to an edge.
enum class Change : std::uint8_t {
    kNone,
    kNewer,     // a sample after all others
    kLate,      // a sample among or before the others
    kReparent,  // a sample that names another parent
    kStatic,    // a static pose was stored
    kCleared,
    kForgotten,  // the retained history ends above a used sample
};

/// A change and its position.
struct EdgeChange {
    Change change = Change::kNone;
    StampNs stamp = kNoStamp;  // of the new sample, or the end of the retained history

    [[nodiscard]] explicit operator bool() const { return change != Change::kNone; }
};

/// The samples that an edge got after commit `since`.
/// Threads: one that holds the commit lock, so that the edge has no other writer.
/// Guarantee: wait-free. Never misses a change; may report one that was rolled back.
template <class Memory>
class EdgeChanges : private EdgeSegments<Memory> {
public:
    EdgeChanges(Memory& memory, Offset header, CommitNumber since, StampNs history)
        : Base(memory, header), since_(since), history_(history) {}

    /// Whether anything was stored; one load.
    [[nodiscard]] bool any() const { return word(kChanged).load_relaxed() > since_; }

    /// The newest change that affects `ranges` (sorted, disjoint) or the sample at `lowest`, the
    /// oldest one used; kNoStamp if none was used.
    [[nodiscard]] EdgeChange find(std::span<const StampRange> ranges, StampNs lowest) const {
        if (!any())
            return {};
        if (Base::began() > since_)
            return {Change::kCleared, kNoStamp};
        EdgeChange found;
        CommitNumber newest = since_;
        for (const StampRange& range : ranges)
            look_in(range, found, newest);
        return found ? found : forgotten(lowest);
    }

private:
    using Base = EdgeSegments<Memory>;
    using Base::segment;
    using Base::word;
    using Base::word_of;

    void look_in(const StampRange& range, EdgeChange& found, CommitNumber& newest) const {
        for (std::uint64_t k = Base::segment_of(range.from); k <= Base::end(); ++k) {
            const Segment<Memory> in = segment(word_of(k));
            if (in.empty())
                continue;
            if (in.stamp(in.begin()) > range.to)
                return;
            if (k < Base::end() && in.meta(kGreatest).load_relaxed() <= since_)
                continue;
            std::uint64_t i = in.begin();
            if (range.from > std::numeric_limits<StampNs>::min())
                i = in.upper_bound(range.from - 1);
            for (; i < in.end() && in.stamp(i) <= range.to; ++i) {
                const CommitNumber commit = in.commit(i);
                if (commit > since_ && commit >= newest && commit != SlotWord::kNever) {
                    newest = commit;
                    found = describe(in, k, i);
                }
            }
        }
    }

    [[nodiscard]] EdgeChange describe(const Segment<Memory>& in, std::uint64_t k,
                                      std::uint64_t index) const {
        const StampNs stamp = in.stamp(index);
        if (stamp == kStaticStamp)
            return {Change::kStatic, kNoStamp};
        const SampleAt before = sample_before(in, k, index);
        if (before && SlotWord::parent(Base::memory_.word(before.slot).load_relaxed()) !=
                          SlotWord::parent(in.slot_word(index)))
            return {Change::kReparent, stamp};
        return {stamp >= Base::newest() ? Change::kNewer : Change::kLate, stamp};
    }
    [[nodiscard]] SampleAt sample_before(Segment<Memory> in, std::uint64_t k,
                                         std::uint64_t index) const {
        while (index == in.begin()) {
            if (k == Base::begin())
                return {};
            in = segment(word_of(--k));
            index = in.end();
        }
        return {in.slot(index - 1), in.stamp(index - 1)};
    }

    [[nodiscard]] EdgeChange forgotten(StampNs lowest) const {
        const StampNs newest = Base::newest();
        if (lowest >= 0 && newest >= 0 && lowest < newest - history_)
            return {Change::kForgotten, newest - history_};
        return {};
    }

    CommitNumber since_;
    StampNs history_;
};

}  // namespace tfdb::history
