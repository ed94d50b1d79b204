// An edge as a transaction sees it: the store's samples, and its own laid over them.
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>

#include "tfdb/history/edge_view.hpp"
#include "tfdb/txn/read_set.hpp"
#include "tfdb/txn/write_set.hpp"

namespace tfdb::txn {

/// Answers what history::EdgeView answers, as if the transaction's samples had been committed, and
/// notes of each answer which samples of others would have changed it. Own samples have indices
/// with the high bit set.
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
    [[nodiscard]] bool was_cleared() const { return has_base_ && base_.was_cleared(); }
    [[nodiscard]] bool is_static() const {
        if (own_ != nullptr)
            return own_->is_static;
        const bool fixed = has_base_ && base_.is_static();
        if (fixed)
            note_all();
        return fixed;
    }
    [[nodiscard]] std::uint64_t static_index() const {
        return own_ != nullptr ? kOwnBit : base_.static_index();
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
        } else if (own_->samples.back().stamp >= base_newest_) {
            index = kOwnBit | (own_->samples.size() - 1);
            stamp = own_->samples.back().stamp;
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
            stamp = std::max(base_newest_, own_->samples.back().stamp);
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
    static constexpr StampNs kDawn = std::numeric_limits<StampNs>::min();
    static constexpr StampNs kDusk = std::numeric_limits<StampNs>::max();

    [[nodiscard]] static bool is_own(std::uint64_t index) { return (index & kOwnBit) != 0; }
    [[nodiscard]] const auto& sample(std::uint64_t index) const {
        return own_->samples[index & ~kOwnBit];
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
        cutoff_ = std::max(base_newest_, own_->samples.back().stamp) - history;
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
        const auto later_than = [&](StampNs s) {
            return std::upper_bound(samples.begin(), samples.end(), s,
                                    [](StampNs a, const auto& b) { return a < b.stamp; });
        };
        const auto index = [&](auto at) {
            return kOwnBit | static_cast<std::uint64_t>(at - samples.begin());
        };
        const auto before = later_than(stamp);
        if (before != samples.begin() && (before - 1)->stamp >= cutoff_ &&
            (out.before == history::kNoIndex || (before - 1)->stamp >= out.before_stamp)) {
            out.before = index(before - 1);
            out.before_stamp = (before - 1)->stamp;
        }
        const auto after = later_than(std::max(stamp, cutoff_ - 1));
        if (after != samples.end() &&
            (out.after == history::kNoIndex || after->stamp <= out.after_stamp)) {
            out.after = index(after);
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
