// Has an edge changed since a commit, as far as somebody who read it then could notice?
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>
#include <span>

#include "tfdb/history/layout.hpp"

namespace tfdb::history {

/// Stamps, both ends included. A new sample at one of them changes an answer.
struct StampRange {
    StampNs from = std::numeric_limits<StampNs>::min();
    StampNs to = std::numeric_limits<StampNs>::max();
};

/// What happened to an edge.
enum class Change : std::uint8_t {
    kNone,
    kNewer,     // a sample after all others
    kLate,      // a sample among or before the others
    kReparent,  // a sample that names another parent
    kStatic,    // a static pose was stored
    kCleared,
    kForgotten,  // the retained history ends above a sample that was used
    kUnknown,    // so many new samples that what came first is gone
};

/// Where and what.
struct EdgeChange {
    Change change = Change::kNone;
    StampNs stamp = kNoStamp;  // of the new sample, or the end of what is retained

    [[nodiscard]] explicit operator bool() const { return change != Change::kNone; }
};

/// The samples that an edge got after commit `since`. A ring keeps commit order, so they lie at its
/// end; after a rebuild all of it is looked at.
/// Threads: only while nobody else writes to the edge: the commit lock is held.
/// Guarantee: wait-free. Never misses a change; one that cannot be told any more counts as one.
template <class Memory>
class EdgeChanges {
public:
    EdgeChanges(Memory& memory, Offset header, CommitNumber since, StampNs history)
        : memory_(memory), header_(header), since_(since), history_(history) {}

    /// True if anything was stored at all; a load.
    [[nodiscard]] bool any() const { return word(kHeadCommit).load_relaxed() > since_; }

    /// The newest change that concerns `ranges` (sorted, apart) or the sample at `lowest`, the
    /// oldest one that was used; kNoStamp if none was.
    [[nodiscard]] EdgeChange find(std::span<const StampRange> ranges, StampNs lowest) const {
        if (!any())
            return {};
        const std::uint64_t ring = word(kRing).load_relaxed();
        const std::uint64_t begin = word(kBegin).load_relaxed();
        const std::uint64_t topology = word(kTopology).load_relaxed();
        const bool rebuilt = (topology & Topology::kRebuilt) != 0;
        const bool mixed = rebuilt && word(kSortedCommit).load_relaxed() > since_;
        const std::uint64_t floor =
            rebuilt && !mixed ? std::max(begin, word(kSortedEnd).load_relaxed()) : begin;
        for (std::uint64_t i = word(kHead).load_relaxed(); i-- > floor;) {
            const std::uint64_t slot = slot_word(ring, i);
            if (SlotWord::commit(slot) <= since_) {
                if (mixed)
                    continue;
                return forgotten(lowest);
            }
            const EdgeChange found = judge(ring, i, slot, ranges);
            if (found)
                return found;
        }
        const bool evicted =
            begin > 0 && floor == begin && word(kEvictSafe).load_relaxed() > since_;
        if (evicted)
            return {Change::kUnknown, kNoStamp};
        return forgotten(lowest);
    }

private:
    [[nodiscard]] typename Memory::Word& word(HeaderWord w) const {
        return memory_.word(header_ + 8 * w);
    }
    [[nodiscard]] std::uint64_t slot_word(std::uint64_t ring, std::uint64_t index) const {
        const std::uint64_t mask = RingWord::capacity(ring) - 1;
        return memory_
            .word(RingLayout<Memory>::slots(ring) + RingLayout<Memory>::kSlotBytes * (index & mask))
            .load_relaxed();
    }
    [[nodiscard]] StampNs stamp_at(std::uint64_t ring, std::uint64_t index) const {
        const std::uint64_t mask = RingWord::capacity(ring) - 1;
        return as_stamp(
            memory_.word(RingLayout<Memory>::stamps(ring) + 8 * (index & mask)).load_relaxed());
    }

    [[nodiscard]] EdgeChange judge(std::uint64_t ring, std::uint64_t index, std::uint64_t slot,
                                   std::span<const StampRange> ranges) const {
        const StampNs stamp = stamp_at(ring, index);
        if (stamp == kClearMarker)
            return {Change::kCleared, kNoStamp};
        // Whoever read a static edge depends on all of it; who only stored to it, on nothing here.
        if (stamp == kStaticStamp)
            return {ranges.empty() ? Change::kNone : Change::kStatic, kNoStamp};
        const auto range = std::lower_bound(
            ranges.begin(), ranges.end(), stamp,
            [](const StampRange& candidate, StampNs s) { return candidate.to < s; });
        if (range == ranges.end() || range->from > stamp)
            return {};
        const std::uint64_t begin = word(kBegin).load_relaxed();
        if (index > begin &&
            SlotWord::parent(slot_word(ring, index - 1)) != SlotWord::parent(slot)) {
            return {Change::kReparent, stamp};
        }
        const bool newest = stamp >= as_stamp(word(kNewest).load_relaxed());
        return {newest ? Change::kNewer : Change::kLate, stamp};
    }

    [[nodiscard]] EdgeChange forgotten(StampNs lowest) const {
        const StampNs newest = as_stamp(word(kNewest).load_relaxed());
        if (lowest >= 0 && newest >= 0 && lowest < newest - history_)
            return {Change::kForgotten, newest - history_};
        return {};
    }

    Memory& memory_;
    Offset header_;
    CommitNumber since_;
    StampNs history_;
};

}  // namespace tfdb::history
