// One edge as one snapshot sees it: its visible samples, and the two around a stamp.
#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>
#include <limits>
#include <utility>

#include "tfdb/history/segment.hpp"

namespace tfdb::history {

/// The samples around a stamp: the last one at or before it, and the first one after it.
struct Bracket {
    SampleAt before;
    SampleAt after;
};

/// The values that a reader loads before anything else. Epochs count how often retired blocks were
/// freed.
struct AsOf {
    std::uint64_t epoch = 0;
    CommitNumber commit = 0;
};
/// For a caller that excludes all writers.
inline constexpr AsOf kAsItIs{kMaxCommit, kMaxCommit};

/// A reader's view of one edge at one commit.
///
/// Whatever the writer does meanwhile, the words that it swaps lead to segments that still hold all
/// samples of this snapshot. Samples of later commits are recognised by their commit numbers and
/// skipped. But a block may be reused: only after an epoch that began after the reader did, or, if
/// a clear ended the version, after a commit later than the snapshot. The memory publishes how far
/// reuse has advanced for both.
///
/// Threads: each thread creates its own; any number run beside the one writer.
///
/// Guarantee: wait-free. Results count only if `confirm` is true afterwards. A function that
/// returns false and a failed `confirm` mean "overtaken by the writer: read again".
template <class Memory>
class EdgeView {
public:
    /// Opens the frame whose header is at `header`; empty if the frame was not born yet.
    [[nodiscard]] bool open(Memory& memory, Offset header, CommitNumber snapshot, StampNs history,
                            const AsOf& as_of) {
        memory_ = &memory;
        header_ = header;
        snapshot_ = snapshot;
        epoch_ = as_of.epoch;
        ended_ = std::min(snapshot, as_of.commit);
        history_ = history;
        overtaken_ = false;
        newest_ = {};
        if (!load())
            return false;
        const bool whole = word(kChanged).load_relaxed() <= snapshot;
        // All other words were stored after these two, or before the loaded value.
        const CommitNumber since = word(kSince).load_acquire();
        const bool born = word(kBorn).load_acquire() >> kFrameBits <= snapshot;
        if (!confirm())
            return false;
        if (since > snapshot && !load_older())
            return false;
        find_newest(whole && since <= snapshot);
        // The header of a slot that is being reused mixes words of two frames.
        return !overtaken_ && (newest_ ? born : !may_miss());
    }

    [[nodiscard]] bool empty() const { return !newest_; }
    /// May be newer than the snapshot, and then less exact.
    [[nodiscard]] std::uint64_t topology() const { return topology_; }
    [[nodiscard]] bool is_static() const { return newest_ && newest_.stamp == kStaticStamp; }
    /// Whether the edge had samples and a clear removed them all.
    [[nodiscard]] bool cleared() const { return empty() && (topology_ & Topology::kCleared) != 0; }
    /// True only if all samples name one parent slot, which may have held another frame before.
    [[nodiscard]] bool one_parent() const { return (topology_ & Topology::kMixedParents) == 0; }

    /// True only if all samples that the snapshot retained, including those evicted since, name one
    /// parent. A static edge has one sample.
    [[nodiscard]] bool had_one_parent() const {
        return empty() || is_static() ||
               (one_parent() &&
                (!may_miss() || (word(kSince).load_relaxed() <= snapshot_ &&
                                 as_stamp(word(kParentFrom).load_relaxed()) <= cutoff())));
    }

    /// Whether all reads since `open` are consistent.
    [[nodiscard]] bool confirm() const {
        Memory::fence_acquire();
        return memory_->reclaimed(memory::Line::kReplaced).load_relaxed() <= epoch_ &&
               memory_->reclaimed(memory::Line::kEnded).load_relaxed() <= ended_ &&
               word(kCorrected).load_relaxed() <= snapshot_;
    }

    /// Whether samples that this snapshot may need were evicted before `open`.
    [[nodiscard]] bool may_miss() const { return snapshot_ < forgotten_; }

    /// The sample with the greatest stamp, or the pose of a static edge; empty if none is visible.
    [[nodiscard]] SampleAt newest() const { return newest_; }

    /// Finds the samples around `stamp` among those that the snapshot retains.
    [[nodiscard]] bool bracket(StampNs stamp, Bracket& out) const {
        const StampNs cutoff = this->cutoff();
        const Spot at = locate(std::max(stamp, cutoff - 1));
        out.before = sample(last_visible(at));
        out.after = sample(first_visible(at));
        if (!out.before && may_miss())
            return false;
        if (out.before && out.before.stamp < cutoff)
            out.before = {};
        return !overtaken_;
    }

    /// A segment of the edge in stamp order, in place, and the index in it of the first sample with
    /// a greater stamp, unless that is the segment's first sample or its end. The segment also
    /// holds samples of commits that the snapshot does not see.
    [[nodiscard]] std::pair<Segment<Memory>, std::uint64_t> place(StampNs stamp) const {
        const Spot at = locate(stamp);
        return {at.segment, at.index};
    }

    /// The sample with the least stamp that the snapshot retains; empty if there is none.
    [[nodiscard]] bool oldest(SampleAt& out) const {
        out = {};
        if (empty())
            return true;
        Bracket around;
        if (!bracket(cutoff() - 1, around))
            return false;
        out = around.after;
        return true;
    }

    /// The extent of all samples that the snapshot retains. Reads the samples of the segments at an
    /// end, and of those with a sample newer than the snapshot.
    [[nodiscard]] bool extent(Extent& out) const {
        out = {};
        if (empty())
            return true;
        const Spot at = locate(cutoff() - 1);
        if (!last_visible(at).found && may_miss())
            return false;
        out.add(extent_of(at.segment, at.index, snapshot_));
        if (at.k < end_) {
            const std::uint64_t capacity = this->capacity();
            for (std::uint64_t k = at.k + 1; k < end_ && directory().first(k) <= newest_.stamp;)
                k = add_from(k, capacity, out);
            out.add(extent_of(segment(end_), segment(end_).begin(), snapshot_));
        }
        return !overtaken_;
    }

    /// Calls visit(sample) in stamp order: for the sample at or before `from` and `more` before it,
    /// for all up to `to`, for the one after it and `more` after that, as far as the snapshot
    /// retains them. Stops when `visit` returns false.
    template <class Visit>
    [[nodiscard]] bool visit(StampNs from, StampNs to, unsigned more, Visit visit) const {
        const StampNs cutoff = this->cutoff();
        Spot at = locate(std::max(from, cutoff - 1));
        Spot first = first_visible(at);
        for (unsigned i = 0; i <= more; ++i) {
            const Spot before = last_visible(at);
            if (!before.found) {
                if (may_miss())
                    return false;
                break;
            }
            if (before.segment.stamp(before.index) < cutoff)
                break;
            first = before;
            at = first_of_its_stamp(before);
        }
        unsigned after = 0;
        if (first.found) {
            visit_from(first, [&](const SampleAt& found) {
                after += found.stamp > to ? 1 : 0;
                return visit(found) && after <= more;
            });
        }
        return !overtaken_;
    }

    /// Calls visit(sample) for the retained samples of commit `first` and later, greatest stamp
    /// first, until `visit` returns false. Reads the samples of the tail, and of the segments that
    /// have some of those commits.
    template <class Visit>
    [[nodiscard]] bool visit_since(CommitNumber first, Visit visit) const {
        const StampNs cutoff = this->cutoff();
        const std::uint64_t capacity = begin_ < end_ ? this->capacity() : 0;
        SampleAt later;
        for (std::uint64_t k = empty() ? begin_ : end_ + 1; k > begin_;) {
            if (k <= end_) {
                k = skip_older(k, capacity, first);
                if (k == begin_)
                    break;
            }
            const Segment<Memory> in = segment(--k);
            for (std::uint64_t i = all_too_new(in) ? 0 : in.end(); i > in.begin(); --i) {
                const SampleAt at{in.slot(i - 1), in.stamp(i - 1)};
                const CommitNumber commit = in.commit(i - 1);
                // Of equal stamps, the later sample belongs to the newer commit.
                if (commit < first || commit > snapshot_ || (later && later.stamp == at.stamp))
                    continue;
                if (at.stamp < cutoff || !visit(at))
                    return !overtaken_;
                later = at;
            }
        }
        return !overtaken_;
    }

    /// A lower bound of the samples' commits.
    [[nodiscard]] CommitNumber least_commit() const {
        const Segment<Memory> tail(*memory_, tail_);
        CommitNumber least = tail.empty() ? kMaxCommit : tail.meta(kLeast).load_relaxed();
        const std::uint64_t capacity = begin_ < end_ ? this->capacity() : 0;
        for (std::uint64_t k = begin_; k < end_;) {
            const unsigned level = largest_from(k);
            least = std::min(least, directory().least(capacity, level, k));
            k += Dir::segments(level);
        }
        return least;
    }

    [[nodiscard]] std::uint64_t slot_word(const SampleAt& at) const {
        return memory_->word(at.slot).load_relaxed();
    }
    [[nodiscard]] SlotData<Memory> read(const SampleAt& at) const {
        SlotData<Memory> data;
        const std::uint64_t first = memory_->word(at.slot).load_relaxed();
        data.parent = SlotWord::parent(first);
        data.commit = SlotWord::commit(first);
        for (unsigned i = 0; i < Memory::kPayloadWords; ++i) {
            data.payload[i] = memory_->word(at.slot + 8 * (1 + Offset{i})).load_relaxed();
        }
        return data;
    }

    /// Stamps below it are no longer retained.
    [[nodiscard]] StampNs cutoff() const { return newest_.stamp - history_; }

private:
    /// A position among the samples: segment `k` (the one at `end_` is the tail), and the index in
    /// it.
    struct Spot {
        std::uint64_t k = 0;
        Segment<Memory> segment;
        std::uint64_t index = 0;
        bool found = false;
    };
    using Dir = Directory<Memory>;
    static constexpr int kLoads = 8;

    [[nodiscard]] typename Memory::Word& word(HeaderWord w) const {
        return memory_->word(header_ + 8 * Offset{w});
    }
    [[nodiscard]] Directory<Memory> directory() const { return {*memory_, directory_}; }
    /// Loads the tail and the directory before it. If the tail becomes full meanwhile, it moves
    /// into the directory: both are then loaded again.
    [[nodiscard]] bool load() {
        tail_ = word(kTail).load_acquire();
        for (int tries = 0; tries < kLoads; ++tries) {
            load_directory(word(kDirectory).load_acquire());
            // The writer sets flags before the samples that they describe.
            topology_ = word(kTopology).load_acquire();
            // Words of a reused block may point anywhere.
            if (!confirm())
                return false;
            const std::uint64_t last =
                end_ > begin_ ? directory().entry(end_ - 1).load_acquire() : 0;
            const std::uint64_t again = word(kTail).load_acquire();
            if (SegmentWord::block(again) == SegmentWord::block(tail_)) {
                // The writer puts a full tail into the directory before it starts a new one.
                if (last != 0 && SegmentWord::block(last) == SegmentWord::block(tail_))
                    --end_;
                return true;
            }
            tail_ = again;
        }
        return false;
    }
    void load_directory(Offset block) {
        directory_ = block;
        begin_ = end_ = 0;
        if (block != 0) {
            end_ = directory().end();
            begin_ = directory().begin(end_);
        }
        // The writer raises kForgotten before it evicts.
        forgotten_ = word(kForgotten).load_relaxed();
    }
    /// Loads the version before the last clear, or an earlier one. If that clear was rolled back,
    /// its version continues in the header until the next clear begins.
    [[nodiscard]] bool load_older() {
        const std::uint64_t older = word(kOlder).load_acquire();
        if ((older & kTakenBack) != 0 && (!load() || word(kOlder).load_acquire() != older))
            return false;
        Offset version = memory::inside(*memory_, older);
        CommitNumber newer = kMaxCommit + 1;
        for (bool goes_on = (older & kTakenBack) != 0;; goes_on = false) {
            if (version == 0)
                return false;
            const auto old = [&](VersionWord w) -> std::uint64_t {
                return memory_->word(version + 8 * Offset{w}).load_relaxed();
            };
            const std::uint64_t tail = old(kOldTail);
            const std::uint64_t topology = old(kOldTopology);
            const CommitNumber since = old(kOldSince);
            const Offset directory = old(kOldDirectory);
            const std::uint64_t end = old(kOldEnd);
            version = memory::inside(*memory_, old(kOldOlder));
            // Circular only if damaged.
            if (!confirm() || since >= newer)
                return false;
            newer = since;
            if (!goes_on) {
                tail_ = tail;
                topology_ = topology;
                load_directory(directory);
                end_ = std::min(end_, end);
                begin_ = std::min(begin_, end_);
            }
            if (since <= snapshot_)
                return confirm();
        }
    }

    [[nodiscard]] std::uint64_t entry(std::uint64_t k) const {
        const std::uint64_t found = directory().entry(k).load_acquire();
        // A word of a reused block may point anywhere.
        if (confirm())
            return found;
        overtaken_ = true;
        return 0;
    }
    [[nodiscard]] Segment<Memory> segment(std::uint64_t k) const {
        return {*memory_, k == end_ ? tail_ : entry(k)};
    }
    [[nodiscard]] SampleAt sample(const Spot& at) const {
        if (!at.found)
            return {};
        return {at.segment.slot(at.index), at.segment.stamp(at.index)};
    }

    void find_newest(bool whole) {
        const Segment<Memory> tail(*memory_, tail_);
        if (whole && !tail.empty()) {
            newest_ = {tail.slot(tail.end() - 1), tail.stamp(tail.end() - 1)};
        } else {
            newest_ = sample(last_visible({end_, tail, tail.end(), false}));
        }
    }

    /// Index of the first sample in a segment with a greater stamp.
    [[nodiscard]] std::uint64_t find_index(const Segment<Memory>& segment, std::uint64_t k,
                                           StampNs stamp) const {
        if (segment.empty())
            return segment.begin();
        double rate = 0.0;
        StampNs first = 0;
        if (k == end_) {
            rate = std::bit_cast<double>(word(kRate).load_relaxed());
            first = segment.stamp(segment.begin());
        } else {
            first = directory().first(k);
            const StampNs next = k + 1 < end_ ? directory().first(k + 1) : newest_.stamp;
            rate = next > first ? static_cast<double>(SegmentWord::count(segment.word())) /
                                      static_cast<double>(next - first)
                                : 0.0;
        }
        return gallop([&](std::uint64_t i) { return segment.stamp(i); }, segment.begin(),
                      segment.end(),
                      guess_at(static_cast<double>(stamp - first), rate, segment.begin()), stamp);
    }
    /// The position before the first sample with a greater stamp, and after some sample if one
    /// exists.
    [[nodiscard]] Spot locate(StampNs stamp) const {
        std::uint64_t k = directory().find(begin_, end_, {*memory_, tail_}, stamp);
        for (;;) {
            const Segment<Memory> segment = this->segment(k);
            const std::uint64_t index = find_index(segment, k, stamp);
            if (index > segment.begin() || k == begin_)
                return {k, segment, index, false};
            --k;
        }
    }

    /// The directory's capacity; 0, which keeps all following reads inside the block, if the block
    /// was reused.
    [[nodiscard]] std::uint64_t capacity() const {
        const std::uint64_t found = directory().capacity();
        if (confirm())
            return found;
        overtaken_ = true;
        return 0;
    }
    /// Level of the largest node whose first entry is `k`, or whose last entry is the one before
    /// `k`.
    [[nodiscard]] unsigned largest_from(std::uint64_t k) const {
        unsigned level = 0;
        while (k % Dir::segments(level + 1) == 0 && k + Dir::segments(level + 1) <= end_)
            ++level;
        return level;
    }
    [[nodiscard]] unsigned largest_before(std::uint64_t k) const {
        unsigned level = 0;
        while (k % Dir::segments(level + 1) == 0 && k >= begin_ + Dir::segments(level + 1))
            ++level;
        return level;
    }
    /// The position behind the last entry before `k` that has samples of commit `first` or later;
    /// otherwise the first entry.
    [[nodiscard]] std::uint64_t skip_older(std::uint64_t k, std::uint64_t capacity,
                                           CommitNumber first) const {
        const auto is_older = [&](unsigned level) {
            return directory().node(capacity, level, k - Dir::segments(level)).changed < first;
        };
        while (k > begin_ && !overtaken_) {
            unsigned level = largest_before(k);
            while (level > 0 && !is_older(level))
                --level;
            if (!is_older(level))
                return k;
            k -= Dir::segments(level);
        }
        return k;
    }
    /// The first segment at or after an entry with samples as old as the snapshot; otherwise the
    /// tail.
    [[nodiscard]] std::uint64_t first_as_old(std::uint64_t k) const {
        const std::uint64_t capacity = k < end_ ? this->capacity() : 0;
        while (k < end_) {
            unsigned level = largest_from(k);
            while (level > 0 && directory().least(capacity, level, k) <= snapshot_)
                --level;
            if (level == 0 && directory().least(capacity, 0, k) <= snapshot_)
                return k;
            k += Dir::segments(level);
        }
        return end_;
    }
    /// The last such segment before an entry; otherwise the first segment.
    [[nodiscard]] std::uint64_t last_as_old(std::uint64_t k) const {
        const std::uint64_t capacity = k > begin_ ? this->capacity() : 0;
        while (k > begin_) {
            unsigned level = largest_before(k);
            while (level > 0 &&
                   directory().least(capacity, level, k - Dir::segments(level)) <= snapshot_)
                --level;
            if (level == 0 && directory().least(capacity, 0, k - 1) <= snapshot_)
                return k - 1;
            k -= Dir::segments(level);
        }
        return begin_;
    }

    [[nodiscard]] bool visible(const Segment<Memory>& segment, std::uint64_t index) const {
        return segment.commit(index) <= snapshot_;
    }
    [[nodiscard]] bool all_too_new(const Segment<Memory>& segment) const {
        return segment.meta(kLeast).load_relaxed() > snapshot_;
    }
    /// The last visible sample before a position. Of equal stamps, the later sample belongs to the
    /// newer commit.
    [[nodiscard]] Spot last_visible(Spot at) const {
        for (;;) {
            const std::uint64_t begin = at.segment.begin();
            bool skip = false;
            while (at.index > begin && !skip) {
                --at.index;
                if (visible(at.segment, at.index)) {
                    at.found = true;
                    return at;
                }
                skip = all_too_new(at.segment);
            }
            if (at.k == begin_)
                return {at.k, at.segment, begin, false};
            at.k = skip ? last_as_old(at.k) : at.k - 1;
            at.segment = segment(at.k);
            at.index = at.segment.end();
        }
    }
    /// The first visible sample from a position on; of equal stamps, the newest sample.
    [[nodiscard]] Spot first_visible(Spot at) const {
        Spot best = at;
        best.found = false;
        for (;;) {
            bool skip = false;
            for (; at.index < at.segment.end() && !skip; ++at.index) {
                if (best.found && at.segment.stamp(at.index) != best.segment.stamp(best.index))
                    return best;
                if (visible(at.segment, at.index)) {
                    best = at;
                    best.found = true;
                } else {
                    skip = !best.found && all_too_new(at.segment);
                }
            }
            if (at.k == end_)
                return best;
            at.k = skip ? first_as_old(at.k + 1) : at.k + 1;
            at.segment = segment(at.k);
            at.index = at.segment.begin();
        }
    }
    /// Calls visit(sample) for the visible samples from a position on, until it returns false; of
    /// equal stamps, for the newest sample only.
    template <class Visit>
    void visit_from(Spot at, Visit visit) const {
        SampleAt last;
        while (!overtaken_) {
            bool skip = false;
            for (; at.index < at.segment.end() && !skip; ++at.index) {
                if (!visible(at.segment, at.index)) {
                    skip = all_too_new(at.segment);
                    continue;
                }
                const StampNs stamp = at.segment.stamp(at.index);
                if (last && last.stamp != stamp && !visit(last))
                    return;
                last = {at.segment.slot(at.index), stamp};
            }
            if (at.k == end_)
                break;
            at.k = skip ? first_as_old(at.k + 1) : at.k + 1;
            at.segment = segment(at.k);
            at.index = at.segment.begin();
        }
        if (last)
            visit(last);
    }
    /// Adds the largest node that begins with the segment and holds for the snapshot, or the
    /// segment itself. Returns the segment behind it.
    [[nodiscard]] std::uint64_t add_from(std::uint64_t k, std::uint64_t capacity,
                                         Extent& out) const {
        for (unsigned level = largest_from(k);; --level) {
            const auto node = directory().node(capacity, level, k);
            if (node.changed <= snapshot_) {
                out.add(node.extent);
                return k + Dir::segments(level);
            }
            if (level == 0) {
                const Segment<Memory> in = segment(k);
                out.add(extent_of(in, in.begin(), snapshot_));
                return k + 1;
            }
        }
    }
    /// The position before all samples with this sample's stamp.
    [[nodiscard]] Spot first_of_its_stamp(Spot at) const {
        const StampNs stamp = at.segment.stamp(at.index);
        if (at.index > at.segment.begin() && at.segment.stamp(at.index - 1) != stamp)
            return at;
        return locate(stamp - 1);
    }

    Memory* memory_ = nullptr;
    Offset header_ = 0;
    CommitNumber snapshot_ = 0;
    std::uint64_t epoch_ = 0;
    CommitNumber ended_ = 0;  // versions that ended after this commit are needed
    StampNs history_ = 0;
    std::uint64_t tail_ = 0;
    Offset directory_ = 0;
    std::uint64_t begin_ = 0;
    std::uint64_t end_ = 0;
    CommitNumber forgotten_ = 0;
    std::uint64_t topology_ = Topology::kRoot;
    SampleAt newest_;
    mutable bool overtaken_ = false;
};

}  // namespace tfdb::history
