// An edge as a transaction sees it: the store's samples, and its own laid over them.
#pragma once

#include <algorithm>
#include <cstdint>
#include <iterator>
#include <limits>

#include "tfdb/history/edge_view.hpp"
#include "tfdb/txn/read_set.hpp"
#include "tfdb/txn/write_set.hpp"

namespace tfdb::txn {

/// Answers what history::EdgeView answers, as if the transaction's samples had been committed, and
/// notes of each answer which samples of others would have changed it. An own sample's index is its
/// stamp with a high bit set.
/// Threads: one. Guarantee: that of the view below.
template <class Base>
class MergedEdge {
public:
    using Memory = typename Base::Memory;
    using BaseEdge = typename Base::Edge;
    using Own = typename WriteSet<Memory>::Edge;
    using Reads = typename Base::Reads;

    /// `reads` null: nothing is noted. False: overtaken.
    [[nodiscard]] bool open(const typename Base::Below& below, FrameId id, const Own* own,
                            bool is_own_frame, clock::StampNs history, Reads* reads) {
        own_ = own;
        reads_ = is_own_frame ? nullptr : reads;
        has_base_ = !is_own_frame;
        if (has_base_) {
            const std::uint32_t generation = below.generation(id);
            if (!below.open(id, base_))
                return false;
            if (reads_ != nullptr) {
                place_ = reads_->note_frame(id, generation);
                reads_->note_edge(place_);
            }
        }
        return own_ == nullptr || own_->is_static || find_newest(history);
    }

    [[nodiscard]] bool empty() const {
        if (own_ != nullptr)
            return false;
        const bool none = !has_base_ || base_.empty();
        if (none)
            note_all();
        return none;
    }
    [[nodiscard]] bool is_static() const {
        if (own_ != nullptr)
            return own_->is_static;
        const bool fixed = has_base_ && base_.is_static();
        if (fixed)
            note_all();
        return fixed;
    }
    [[nodiscard]] std::uint64_t static_index() const {
        return own_ != nullptr ? index_of(own_->newest()) : base_.static_index();
    }
    [[nodiscard]] std::uint64_t lo() const { return has_base_ ? base_.lo() : 0; }
    /// An own sample's index says nothing of how far down the ring must have been whole.
    [[nodiscard]] bool ordered() const { return own_ == nullptr && has_base_ && base_.ordered(); }
    [[nodiscard]] bool one_parent() const {
        return own_ == nullptr && has_base_ && base_.one_parent();
    }
    [[nodiscard]] bool confirm(std::uint64_t lowest) const {
        return !has_base_ || base_.confirm(lowest);
    }

    [[nodiscard]] bool newest(std::uint64_t& index, clock::StampNs& stamp) const {
        if (own_ == nullptr) {
            if (!has_base_) {
                index = history::kNoIndex;
                return true;
            }
            if (!base_.newest(index, stamp))
                return false;
        } else if (own_->newest().stamp >= base_newest_) {
            index = index_of(own_->newest());
            stamp = own_->newest().stamp;
        } else if (!base_.newest(index, stamp)) {
            return false;
        }
        if (index == history::kNoIndex) {
            note_all();
        } else {
            note(from_of(index, stamp), kDusk, stamp);
        }
        return true;
    }

    [[nodiscard]] bool oldest(std::uint64_t& index, clock::StampNs& stamp) const {
        index = history::kNoIndex;
        if (own_ == nullptr) {
            if (has_base_ && !base_.oldest(index, stamp))
                return false;
        } else {
            history::Bracket around;
            if (!find_around(cutoff_ - 1, around))
                return false;
            index = around.after;
            stamp = around.after_stamp;
        }
        if (index == history::kNoIndex) {
            note_all();
        } else {
            note(kDawn, to_of(index, stamp), stamp);
        }
        return true;
    }

    [[nodiscard]] bool bracket(clock::StampNs stamp, history::Bracket& out) const {
        const bool found =
            own_ == nullptr ? has_base_ && base_.bracket(stamp, out) : find_around(stamp, out);
        if (!found)
            return false;
        const bool before = out.before != history::kNoIndex;
        const bool after = out.after != history::kNoIndex;
        note(before ? from_of(out.before, out.before_stamp) : kDawn,
             after ? to_of(out.after, out.after_stamp) : kDusk,
             before ? out.before_stamp : out.after_stamp);
        return true;
    }

    [[nodiscard]] std::uint64_t slot_word(std::uint64_t index) const {
        if (!is_own(index))
            return base_.slot_word(index);
        return history::SlotWord::pack(kOwnCommit, sample(index).parent);
    }
    [[nodiscard]] history::SlotData<Memory> read(std::uint64_t index) const {
        if (!is_own(index))
            return base_.read(index);
        return {sample(index).parent, kOwnCommit, sample(index).payload};
    }

    /// For the writer's checks, which note less than an answer would need: whether there are
    /// samples, whether they are static, and the newest stamp.
    [[nodiscard]] bool has_samples() const {
        return own_ != nullptr || (has_base_ && !base_.empty());
    }
    [[nodiscard]] bool holds_static() const {
        return own_ != nullptr ? own_->is_static : has_base_ && base_.is_static();
    }
    [[nodiscard]] bool peek_newest(clock::StampNs& stamp) const {
        stamp = history::kNoStamp;
        std::uint64_t index = history::kNoIndex;
        if (own_ != nullptr) {
            stamp = std::max(base_newest_, own_->newest().stamp);
            return true;
        }
        return !has_base_ || base_.newest(index, stamp);
    }
    void note_newest(clock::StampNs stamp) const { note(stamp, kDusk, stamp); }
    void note_all() const {
        if (reads_ != nullptr)
            reads_->note_all(place_);
    }
    /// That the sample at `stamp` is not too old was relied upon.
    void note_used(clock::StampNs stamp) const {
        if (reads_ != nullptr)
            reads_->note_used(place_, stamp);
    }

private:
    using StampNs = clock::StampNs;
    static constexpr std::uint64_t kOwnBit = std::uint64_t{1} << 62;
    static_assert(history::kForever < StampNs{1} << 62, "a stamp leaves the bit free");
    static constexpr StampNs kDawn = std::numeric_limits<StampNs>::min();
    static constexpr StampNs kDusk = std::numeric_limits<StampNs>::max();

    [[nodiscard]] static bool is_own(std::uint64_t index) { return (index & kOwnBit) != 0; }
    using OwnSample = typename WriteSet<Memory>::Sample;
    [[nodiscard]] static std::uint64_t index_of(const OwnSample& sample) {
        return kOwnBit |
               (sample.stamp == history::kStaticStamp ? 0 : history::as_word(sample.stamp));
    }
    [[nodiscard]] const OwnSample& sample(std::uint64_t index) const {
        const StampNs stamp =
            own_->is_static ? history::kStaticStamp : history::as_stamp(index & ~kOwnBit);
        return *own_->samples.find(stamp);
    }
    /// A sample of somebody else at an own sample's stamp would be replaced by that.
    [[nodiscard]] static StampNs from_of(std::uint64_t index, StampNs stamp) {
        return is_own(index) ? stamp + 1 : stamp;
    }
    [[nodiscard]] static StampNs to_of(std::uint64_t index, StampNs stamp) {
        return is_own(index) ? stamp - 1 : stamp;
    }
    void note(StampNs from, StampNs to, StampNs used) const {
        if (reads_ == nullptr)
            return;
        reads_->note_range(place_, {from, to});
        reads_->note_used(place_, used);
    }

    /// Retention is counted from the newest sample, whoever wrote it.
    [[nodiscard]] bool find_newest(StampNs history) {
        std::uint64_t index = history::kNoIndex;
        base_newest_ = history::kNoStamp;
        if (has_base_ && !base_.newest(index, base_newest_))
            return false;
        cutoff_ = std::max(base_newest_, own_->newest().stamp) - history;
        return true;
    }

    /// The samples around a stamp among both, own ones first where stamps are equal.
    [[nodiscard]] bool find_around(StampNs stamp, history::Bracket& out) const {
        out = history::Bracket{};
        out.lowest = lo();
        if (has_base_ && !base_.empty()) {
            if (!base_.bracket(stamp, out))
                return false;
            if (out.before != history::kNoIndex && out.before_stamp < cutoff_)
                drop(out.before, out.before_stamp);
            if (out.after != history::kNoIndex && out.after_stamp < cutoff_) {
                history::Bracket later;
                if (!base_.bracket(cutoff_ - 1, later))
                    return false;
                out.after = later.after;
                out.after_stamp = later.after_stamp;
            }
        }
        const auto& samples = own_->samples;
        const auto next = samples.upper_bound(stamp);
        if (next != samples.begin()) {
            const OwnSample& before = *std::prev(next);
            if (before.stamp >= cutoff_ &&
                (out.before == history::kNoIndex || before.stamp >= out.before_stamp)) {
                out.before = index_of(before);
                out.before_stamp = before.stamp;
            }
        }
        const auto after = samples.upper_bound(std::max(stamp, cutoff_ - 1));
        if (after != samples.end() &&
            (out.after == history::kNoIndex || after->stamp <= out.after_stamp)) {
            out.after = index_of(*after);
            out.after_stamp = after->stamp;
        }
        return true;
    }
    static void drop(std::uint64_t& index, StampNs& stamp) {
        index = history::kNoIndex;
        stamp = history::kNoStamp;
    }

    BaseEdge base_;
    const Own* own_ = nullptr;
    Reads* reads_ = nullptr;
    std::size_t place_ = 0;
    bool has_base_ = false;
    StampNs base_newest_ = history::kNoStamp;
    StampNs cutoff_ = std::numeric_limits<StampNs>::min();
};

}  // namespace tfdb::txn
