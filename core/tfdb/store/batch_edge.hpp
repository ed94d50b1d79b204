// One edge of a path as batches read it: the samples around many stamps, in place.
#pragma once

#include <algorithm>
#include <bit>

#include "tfdb/geometry/batch_kernels.hpp"
#include "tfdb/lookup/select.hpp"
#include "tfdb/store/store.hpp"

namespace tfdb::store {

/// How a stamp of a batch is answered. In ascending order: of two edges' marks the later one
/// counts.
enum class Mark : std::uint8_t {
    kPlain,    // by the kernels
    kRefused,  // not at all: the policy gives some edge of this path no pose
    kSingle,   // by a single lookup, which handles every case
};

/// Threads: one. Guarantee: wait-free, no allocation. Reads by `find` and the kernels count only if
/// `confirm` is true afterwards.
class BatchEdge {
public:
    /// kMismatch: no edge between these two frames, or one that requires single lookups.
    [[nodiscard]] lookup::Outcome open(const StoreView& view, FrameId child, FrameId parent) {
        using history::SlotWord;
        using lookup::Outcome;
        memory_ = &view.frames().memory();
        if (!view.open(child, view_))
            return Outcome::kLapped;
        // The parent's slot may have held another frame before.
        const CommitNumber born = view.frames().born(parent);
        words_ = {SlotWord::pack(born, parent), SlotWord::pack(view.commit(), parent), kNoFrame};
        if (view_.empty() || !view.alive(parent) || born > view.commit())
            return view_.confirm() ? Outcome::kMismatch : Outcome::kLapped;
        cutoff_ = view_.cutoff();
        stamps_ = nullptr;
        first_ = last_ = 0;
        if (is_static()) {
            const auto slot = view_.read(view_.newest());
            pose_ = std::bit_cast<Pose>(slot.payload);
            if (!view_.confirm())
                return Outcome::kLapped;
            if (!words_.contain(SlotWord::pack(slot.commit, slot.parent)))
                return Outcome::kMismatch;
        }
        return Outcome::kOk;
    }

    [[nodiscard]] bool is_static() const { return view_.is_static(); }
    /// Requires a static edge.
    [[nodiscard]] const Pose& pose() const { return pose_; }
    void put_in_front(const Pose& pose) { pose_ = geometry::compose(pose, pose_); }
    [[nodiscard]] const geometry::SlotWords& words() const { return words_; }
    [[nodiscard]] const StoreEdge& view() const { return view_; }

    /// Finds the samples around the stamps; raises the marks of stamps that kernels cannot answer.
    /// False: overtaken. `count` is a multiple of the group size.
    [[nodiscard]] bool find(const StampNs* stamps, std::size_t count, const Policy& policy,
                            geometry::Pairs& pairs, Mark* marks) {
        pairs.count = 0;
        const bool interpolates = policy.kind == lookup::PolicyKind::kInterpolate;
        const StampNs widest = std::min(policy.limit, kWidest);
        std::uint32_t pair = 0;
        Mark mark = Mark::kPlain;
        StampNs from = 0;
        std::uint64_t length = 0;  // number of stamps for which the pair at `from` is valid
        for (std::size_t i = 0; i < count; ++i) {
            if (static_cast<std::uint64_t>(stamps[i] - from) >= length) {
                const std::uint64_t after = interpolates ? inside(stamps[i]) : 0;
                const StampNs gap = after == 0 ? 0 : stamp_at(after) - stamp_at(after - 1);
                pair = static_cast<std::uint32_t>(pairs.count);
                if (after != 0 && gap <= widest) {
                    from = stamp_at(after - 1);
                    length = static_cast<std::uint64_t>(gap);
                    mark = Mark::kPlain;
                    add(slot_at(after - 1), slot_at(after), from, static_cast<double>(gap), pairs);
                } else if (!find_apart(stamps[i], policy, pairs, from, length, mark)) {
                    return false;
                }
            }
            pairs.of[i] = std::min(pair, static_cast<std::uint32_t>(pairs.count - 1));
            if (mark != Mark::kPlain)
                marks[i] = std::max(marks[i], mark);
        }
        dense_ = 2 * pairs.count < count;
        return true;
    }

    /// Call after the kernels found slots that do not belong to this snapshot's edge between the
    /// two frames.
    void mark_strangers(const geometry::Pairs& pairs, std::size_t count, Mark* marks) const {
        const auto strange = [this](const void* slot) {
            return !words_.contain(static_cast<const sync::Word*>(slot)->load_relaxed());
        };
        for (std::size_t i = 0; i < count; ++i) {
            const std::uint32_t k = pairs.of[i];
            if (strange(pairs.first[k]) || strange(pairs.second[k]))
                marks[i] = Mark::kSingle;
        }
    }

    // The functions that lookup::select needs.
    [[nodiscard]] static bool empty() { return false; }
    [[nodiscard]] history::SampleAt newest() const { return view_.newest(); }
    [[nodiscard]] std::uint64_t slot_word(const history::SampleAt& at) const {
        return view_.slot_word(at);
    }
    /// As the view's, but the sample may be invisible to the snapshot: the kernels check the slot's
    /// first word.
    [[nodiscard]] bool bracket(StampNs stamp, history::Bracket& out) const {
        const std::uint64_t after = inside(stamp);
        if (after == 0)
            return view_.bracket(stamp, out);
        out.before = {slot_at(after - 1), stamp_at(after - 1)};
        out.after = {slot_at(after), stamp_at(after)};
        return true;
    }

private:
    /// The shares of wider gaps may round to 1.
    static constexpr StampNs kWidest = (StampNs{1} << 53) - 1;

    /// The index of the first sample after the stamp; 0 if the view must be asked.
    [[nodiscard, gnu::always_inline]] std::uint64_t inside(StampNs stamp) const {
        std::uint64_t index = index_;
        if (stamp < first_ || stamp >= last_) {
            index = enter_segment(stamp);
        } else if (!dense_ || stamp_at(index) > stamp || stamp_at(++index) <= stamp) {
            index = guess(stamp);  // not in the gap after the last stamp's
        }
        // Of equal stamps the newest sample counts, and it may be in another segment.
        const bool known = index > begin_ && index + 1 < end_ &&
                           stamp_at(index + 1) != stamp_at(index) && stamp_at(index - 1) >= cutoff_;
        index_ = known ? index : begin_;
        return known ? index : 0;
    }
    /// Enters a segment and returns the index of the first sample after the stamp, as
    /// EdgeView::place.
    [[nodiscard, gnu::noinline]] std::uint64_t enter_segment(StampNs stamp) const {
        const auto [segment, index] = view_.place(stamp);
        begin_ = segment.begin();
        end_ = segment.end();
        stamps_ = &memory_->word(segment.stamp_offset(0));
        slots_ = segment.slot(0);
        first_ = last_ = 0;
        if (begin_ + 1 < end_) {
            first_ = stamp_at(begin_);
            last_ = stamp_at(end_ - 1);
            rate_ = static_cast<double>(end_ - begin_ - 1) / static_cast<double>(last_ - first_);
        }
        return index;
    }
    /// The same within the segment. Samples mostly arrive at a steady rate. It is branch-free
    /// because the direction of a guess's error is unpredictable.
    [[nodiscard, gnu::always_inline]] std::uint64_t guess(StampNs stamp) const {
        const auto steps = static_cast<std::uint64_t>(static_cast<double>(stamp - first_) * rate_);
        std::uint64_t index = std::min(begin_ + steps + 1, end_ - 1);
        index += stamp_at(index) <= stamp ? 1 : 0;
        index -= stamp_at(index - 1) > stamp ? 1 : 0;
        if (stamp_at(index - 1) <= stamp && stamp_at(index) > stamp)
            return index;
        return history::gallop([this](std::uint64_t i) { return stamp_at(i); }, begin_, end_, index,
                               stamp);
    }
    [[nodiscard]] StampNs stamp_at(std::uint64_t i) const {
        return history::as_stamp(stamps_[i].load_relaxed());
    }
    [[nodiscard]] Offset slot_at(std::uint64_t i) const {
        return slots_ + history::Segment<StoreMemory>::kSlotBytes * i;
    }

    /// Follows the policy and the view. The result is valid for that many stamps from `from` on.
    [[nodiscard, gnu::noinline]] bool find_apart(StampNs stamp, const Policy& policy,
                                                 geometry::Pairs& pairs, StampNs& from,
                                                 std::uint64_t& length, Mark& mark) const {
        lookup::Selection chosen;
        if (!lookup::select(*this, stamp, policy, chosen))
            return false;
        const history::SampleAt& first = chosen.anchor;
        const history::SampleAt& second = chosen.second;
        const StampNs gap = chosen.second_stamp - chosen.anchor_stamp;
        from = stamp;
        length = 1;
        mark = Mark::kPlain;
        if (chosen.refused) {
            mark = Mark::kRefused;
        } else if (!first ||
                   (second && (chosen.used == lookup::Used::kExtrapolated || gap > kWidest)) ||
                   (chosen.used == lookup::Used::kHeld &&
                    policy.kind != lookup::PolicyKind::kPrevious)) {
            // It holds until the sample of another parent, which the snapshot may not see.
            mark = Mark::kSingle;
        } else if (!second) {
            add(first.slot, first.slot, first.stamp, geometry::Pairs::kHeld, pairs);
        } else {
            from = first.stamp;
            length = static_cast<std::uint64_t>(gap);
            add(first.slot, second.slot, first.stamp, static_cast<double>(gap), pairs);
        }
        return true;
    }

    void add(Offset first, Offset second, StampNs from, double span, geometry::Pairs& pairs) const {
        pairs.add(from, span, &memory_->word(first), &memory_->word(second));
        memory_->fetch(first);
        memory_->fetch(second);
    }

    StoreEdge view_;
    StoreMemory* memory_ = nullptr;
    geometry::SlotWords words_;
    Pose pose_{};
    StampNs cutoff_ = 0;
    // The last segment used: its stamps lie in [first, last].
    mutable const sync::Word* stamps_ = nullptr;
    mutable Offset slots_ = 0;
    mutable std::uint64_t begin_ = 0;
    mutable std::uint64_t end_ = 0;
    mutable std::uint64_t index_ = 0;  // in it, the first sample after the last stamp
    mutable double rate_ = 0.0;        // samples per ns
    bool dense_ = true;                // recently many stamps per sample
    mutable StampNs first_ = 0;
    mutable StampNs last_ = 0;
};

}  // namespace tfdb::store
