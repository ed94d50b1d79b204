// One edge as one snapshot sees it: which samples are visible, and the two around a stamp.
#pragma once

#include <array>
#include <cstdint>

#include "tfdb/history/layout.hpp"

namespace tfdb::history {

/// The samples around a stamp. Indices are kNoIndex where there is none.
struct Bracket {
    std::uint64_t before = kNoIndex;  // greatest stamp <= the stamp asked for
    std::uint64_t after = kNoIndex;   // least stamp > the stamp asked for
    StampNs before_stamp = kNoStamp;
    StampNs after_stamp = kNoStamp;
    std::uint64_t lowest = 0;  // the answer holds while this index is not overwritten
};

/// First word and payload of a slot.
template <class Memory>
struct SlotData {
    FrameId parent = kNoFrame;
    CommitNumber commit = 0;
    std::array<std::uint64_t, Memory::kPayloadWords> payload{};
};

/// A reader's window on one edge's ring at one commit.
/// Threads: each thread makes its own; any number beside the one writer.
/// Guarantee: wait-free. What was read counts only if `confirm` says so afterwards; every
/// function that returns false, and a failed `confirm`, mean "overtaken by the writer: read again".
template <class Memory>
class EdgeView {
public:
    /// Looks at the frame whose header is at `header`. False if the frame's slot was reused.
    [[nodiscard]] bool open(Memory& memory, Offset header, CommitNumber snapshot, StampNs history) {
        memory_ = &memory;
        header_ = header;
        snapshot_ = snapshot;
        history_ = history;
        mode_ = Mode::kOrdered;
        cleared_ = false;
        ring_ = word(kRing).load_acquire();
        topology_ = word(kTopology).load_acquire();
        if (RingWord::empty(ring_)) {
            lo_ = hi_ = 0;
            if (RingWord::is_busy(ring_))
                return false;
            return word(kBorn).load_acquire() >> kFrameBits <= snapshot;
        }
        stamps_ = RingLayout<Memory>::stamps(ring_);
        slots_ = RingLayout<Memory>::slots(ring_);
        mask_ = RingWord::capacity(ring_) - 1;
        hi_ = word(kHead).load_acquire();
        // Flags are set before the head that they speak of.
        topology_ = word(kTopology).load_acquire();
        lo_ = word(kBegin).load_acquire();
        const bool newer = word(kHeadCommit).load_relaxed() > snapshot;
        if (newer || (topology_ & kUnusual) != 0)
            open_unusual(newer);
        return hi_ > lo_ || lo_ == 0 || snapshot_ >= word(kEvictSafe).load_relaxed();
    }

    [[nodiscard]] bool empty() const { return hi_ == lo_; }
    /// Whether samples of the edge were cleared before this snapshot (of an edge that is empty).
    [[nodiscard]] bool was_cleared() const { return cleared_; }
    [[nodiscard]] std::uint64_t topology() const { return topology_; }
    [[nodiscard]] bool is_static() const {
        return hi_ > lo_ &&
               (mode_ == Mode::kScan ? scan_static_ : (topology_ & Topology::kStatic) != 0);
    }
    [[nodiscard]] std::uint64_t lo() const { return lo_; }
    [[nodiscard]] std::uint64_t hi() const { return hi_; }
    [[nodiscard]] bool ordered() const { return mode_ == Mode::kOrdered; }
    /// True only if all samples name one parent (by its slot, which may have had another frame).
    [[nodiscard]] bool one_parent() const {
        return mode_ != Mode::kScan && (topology_ & Topology::kMixedParents) == 0;
    }

    /// True if all that was read since `open`, at `lowest` and above, was whole and of this ring.
    [[nodiscard]] bool confirm(std::uint64_t lowest) const {
        Memory::fence_acquire();
        return word(kRing).load_relaxed() == ring_ &&
               (lowest == kNoIndex || word(kBegin).load_relaxed() <= lowest);
    }

    /// The newest sample in commit order of a static edge.
    [[nodiscard]] std::uint64_t static_index() const {
        return mode_ == Mode::kScan ? scan_last_ : hi_ - 1;
    }

    /// Finds the samples around `stamp` among those that the snapshot retains.
    [[nodiscard]] bool bracket(StampNs stamp, Bracket& out) const {
        if (mode_ != Mode::kOrdered)
            return bracket_general(stamp, out);
        const std::uint64_t p = upper_bound(stamp);
        out.lowest = lo_;
        out.before = out.after = kNoIndex;
        if (p < hi_) {
            out.after = p;
            out.after_stamp = stamp_at(p);
        }
        if (p == lo_ && may_miss())
            return false;
        if (p > lo_)
            out.lowest = p - 1;
        const StampNs found = p > lo_ ? stamp_at(p - 1) : kNoStamp;
        if (p == lo_ || expired(found)) {
            // What comes next counts only if it is itself retained.
            return out.after == kNoIndex || !expired(out.after_stamp) || bracket(cutoff() - 1, out);
        }
        out.before = p - 1;
        out.before_stamp = found;
        return true;
    }

    /// The sample with the greatest stamp; kNoIndex if none is visible.
    [[nodiscard]] bool newest(std::uint64_t& index, StampNs& stamp) const {
        index = kNoIndex;
        if (hi_ == lo_)
            return true;
        if (mode_ == Mode::kOrdered) {
            index = hi_ - 1;
            stamp = stamp_at(index);
            return true;
        }
        if (may_miss())
            return false;
        stamp = newest_stamp();
        index = stamp < 0 ? kNoIndex : last_at_or_before(stamp).index;
        return true;
    }

    /// The sample with the least stamp that the snapshot retains; kNoIndex if none.
    [[nodiscard]] bool oldest(std::uint64_t& index, StampNs& stamp) const {
        index = kNoIndex;
        if (hi_ == lo_)
            return true;
        Bracket around;
        if (!bracket(cutoff() - 1, around))
            return false;
        index = around.after;
        stamp = around.after_stamp;
        return true;
    }

    [[nodiscard]] StampNs stamp_at(std::uint64_t index) const {
        return as_stamp(memory_->word(stamps_ + 8 * (index & mask_)).load_relaxed());
    }
    [[nodiscard]] std::uint64_t slot_word(std::uint64_t index) const {
        return memory_->word(slot(index)).load_relaxed();
    }
    [[nodiscard]] SlotData<Memory> read(std::uint64_t index) const {
        SlotData<Memory> data;
        const Offset at = slot(index);
        const std::uint64_t first = memory_->word(at).load_relaxed();
        data.parent = SlotWord::parent(first);
        data.commit = SlotWord::commit(first);
        for (unsigned i = 0; i < Memory::kPayloadWords; ++i) {
            data.payload[i] = memory_->word(at + 8 * (1 + i)).load_relaxed();
        }
        return data;
    }

    /// True if the sample at `index` counts for the snapshot (ordered views: always in [lo, hi)).
    [[nodiscard]] bool visible(std::uint64_t index) const {
        return mode_ != Mode::kScan || SlotWord::commit(slot_word(index)) <= snapshot_;
    }
    /// True if something that this snapshot may need was overwritten before `open`.
    [[nodiscard]] bool may_miss() const {
        return lo_ != 0 && snapshot_ < word(kEvictSafe).load_relaxed();
    }
    /// Stamps below it are no longer retained.
    [[nodiscard]] StampNs cutoff() const { return newest_stamp() - history_; }
    /// First index in [lo, hi) whose stamp is greater (ordered views only).
    [[nodiscard]] std::uint64_t upper_bound(StampNs stamp) const;

private:
    enum class Mode : std::uint8_t {
        kOrdered,  // one run, stamps rise strictly
        kRuns,     // a few nearly sorted runs
        kScan,     // this snapshot is older than a rebuild or a clear: look at every sample
    };
    struct Found {
        std::uint64_t index = kNoIndex;
        StampNs stamp = kNoStamp;
    };
    static constexpr std::uint64_t kUnusual =
        Topology::kUnordered | Topology::kCleared | Topology::kRebuilt;

    [[nodiscard]] typename Memory::Word& word(HeaderWord w) const {
        return memory_->word(header_ + 8 * w);
    }
    [[nodiscard]] Offset slot(std::uint64_t index) const {
        return slots_ + RingLayout<Memory>::kSlotBytes * (index & mask_);
    }
    /// The header's newest stamp would not do: a clear in progress lowers it.
    [[nodiscard]] bool expired(StampNs stamp) const { return stamp < cutoff(); }

    void open_unusual(bool newer);
    void open_scan();
    [[nodiscard]] std::uint64_t walk_back(std::uint64_t floor) const;
    [[nodiscard]] std::uint64_t search_tail(std::uint64_t from, std::uint64_t to,
                                            StampNs stamp) const;
    [[nodiscard]] bool bracket_general(StampNs stamp, Bracket& out) const;
    [[nodiscard]] StampNs newest_stamp() const;
    [[nodiscard]] Found last_at_or_before(StampNs stamp) const;
    [[nodiscard]] StampNs least_stamp_after(StampNs stamp) const;
    template <class Visit>
    void visit_near(StampNs stamp, Visit visit) const;

    Memory* memory_ = nullptr;
    Offset header_ = 0;
    CommitNumber snapshot_ = 0;
    StampNs history_ = 0;
    std::uint64_t ring_ = 0;
    std::uint64_t topology_ = Topology::kRoot;
    Offset stamps_ = 0;
    Offset slots_ = 0;
    std::uint64_t mask_ = 0;
    std::uint64_t lo_ = 0;
    std::uint64_t hi_ = 0;
    Mode mode_ = Mode::kOrdered;
    bool scan_static_ = false;
    bool cleared_ = false;
    std::uint64_t scan_last_ = kNoIndex;
};

}  // namespace tfdb::history

#include "tfdb/history/edge_view_open.ipp"
#include "tfdb/history/edge_view_search.ipp"
