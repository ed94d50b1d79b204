// An edge as a transaction sees it: the store's samples, overlaid with its own.
#pragma once

#include <algorithm>
#include <cstdint>
#include <iterator>
#include <limits>

#include "tfdb/history/edge_view.hpp"
#include "tfdb/txn/read_set.hpp"
#include "tfdb/txn/write_set.hpp"

namespace tfdb::txn {

/// Has the functions of history::EdgeView, and answers as if the transaction's samples were
/// committed. For each answer it records which samples of others would have changed the answer. The
/// slot of an own sample is kOwn, because it has none in the store.
/// Threads: one. Guarantee: that of the view below.
template <class Base>
class MergedEdge {
    using SampleAt = history::SampleAt;
    using StampNs = clock::StampNs;

public:
    using Memory = typename Base::Memory;
    using BaseEdge = typename Base::Edge;
    using Own = typename WriteSet<Memory>::Edge;
    using Reads = typename Base::Reads;

    /// `reads` null: no recording. `cleared`: the store's moving samples are hidden. False:
    /// overtaken by a writer.
    [[nodiscard]] bool open(const typename Base::Below& below, FrameId id, const Own* own,
                            bool is_own_frame, bool cleared, clock::StampNs history, Reads* reads) {
        own_ = own;
        was_cleared_ = false;
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
        if (cleared && has_base_ && !base_.is_static() && !pass_base())
            return false;
        if (own_ != nullptr && !own_->is_static)
            cutoff_ = peek_newest().stamp - history;
        return true;
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
    /// The answer true depends on every sample.
    [[nodiscard]] bool one_parent() const {
        const bool one = own_ == nullptr && has_base_ && base_.one_parent();
        if (one)
            note_all();
        return one;
    }
    [[nodiscard]] CommitNumber least_commit() const {
        return has_base_ ? base_.least_commit() : kOwnCommit;
    }
    [[nodiscard]] bool confirm() const { return !has_base_ || base_.confirm(); }

    [[nodiscard]] SampleAt newest() const {
        const SampleAt found = peek_newest();
        if (found) {
            note(from_of(found), kDusk, found.stamp);
        } else {
            note_all();
        }
        return found;
    }

    [[nodiscard]] bool oldest(SampleAt& out) const {
        out = {};
        if (own_ == nullptr) {
            if (has_base_ && !base_.oldest(out))
                return false;
        } else {
            history::Bracket around;
            if (!find_around(cutoff_ - 1, around))
                return false;
            out = around.after;
        }
        if (out) {
            note(kDawn, to_of(out), out.stamp);
        } else {
            note_all();
        }
        return true;
    }

    [[nodiscard]] bool bracket(clock::StampNs stamp, history::Bracket& out) const {
        const bool found =
            own_ == nullptr ? has_base_ && base_.bracket(stamp, out) : find_around(stamp, out);
        if (!found)
            return false;
        note(out.before ? from_of(out.before) : kDawn, out.after ? to_of(out.after) : kDusk,
             out.before ? out.before.stamp : out.after.stamp);
        return true;
    }

    [[nodiscard]] std::uint64_t slot_word(const SampleAt& at) const {
        if (!is_own(at))
            return base_.slot_word(at);
        return history::SlotWord::pack(kOwnCommit, sample(at).parent);
    }
    [[nodiscard]] history::SlotData<Memory> read(const SampleAt& at) const {
        if (!is_own(at))
            return base_.read(at);
        return {sample(at).parent, kOwnCommit, sample(at).payload};
    }

    /// Whether it had samples of others and a clear removed them all.
    [[nodiscard]] bool cleared() const {
        return own_ == nullptr && (was_cleared_ || (has_base_ && base_.cleared()));
    }
    /// Calls visit(sample) for a moving edge: for the sample at or before `from`, for all up to
    /// `to`, and for the one after it, until `visit` returns false.
    template <class Visit>
    [[nodiscard]] bool visit(StampNs from, StampNs to, Visit visit) const {
        history::Bracket around;
        if (!bracket(from, around))
            return false;
        SampleAt at = around.before ? around.before : around.after;
        while (at && visit(at) && at.stamp <= to) {
            if (!bracket(at.stamp, around))
                return false;
            at = around.after;
        }
        return true;
    }
    /// The extent of a moving edge's samples; reads each of them.
    [[nodiscard]] bool extent(history::Extent& out) const {
        out = {};
        return visit(kDawn / 2, kDusk, [&](const SampleAt& at) {
            out.add({1, at.stamp, at.stamp, 0});
            return true;
        });
    }

    /// For the writer's checks, which record less than an answer: whether there are samples,
    /// whether they are static, and the newest stamp.
    [[nodiscard]] bool has_samples() const {
        return own_ != nullptr || (has_base_ && !base_.empty());
    }
    [[nodiscard]] bool holds_static() const {
        return own_ != nullptr ? own_->is_static : has_base_ && base_.is_static();
    }
    [[nodiscard]] SampleAt peek_newest() const {
        const SampleAt below = has_base_ ? base_.newest() : SampleAt{};
        if (own_ == nullptr || (below && !own_->is_static && own_->newest().stamp < below.stamp))
            return below;
        return at_own(own_->newest());
    }
    /// The number of own samples before the others' newest: the commit counts them as late.
    [[nodiscard]] std::size_t own_late() const {
        const SampleAt below = has_base_ ? base_.newest() : SampleAt{};
        if (own_ == nullptr || own_->is_static || !below)
            return 0;
        return static_cast<std::size_t>(after(below.stamp - 1) - own_->samples.in_order().begin());
    }
    void note_newest(clock::StampNs stamp) const { note(stamp, kDusk, stamp); }
    void note_all() const {
        if (reads_ != nullptr)
            reads_->note_all(place_);
    }
    /// Records that the transaction relied on retention of the sample at `stamp`.
    void note_used(clock::StampNs stamp) const {
        if (reads_ != nullptr)
            reads_->note_used(place_, stamp);
    }

private:
    using OwnSample = typename WriteSet<Memory>::Sample;
    static constexpr Offset kOwn = ~Offset{0};
    static constexpr StampNs kDawn = std::numeric_limits<StampNs>::min();
    static constexpr StampNs kDusk = std::numeric_limits<StampNs>::max();

    /// Continues as if the store had no samples of the edge: the commit clears the moving ones that
    /// exist then. Only a static pose would remain visible. False: overtaken by a writer.
    [[nodiscard]] bool pass_base() {
        was_cleared_ = base_.cleared() || !base_.empty();
        if (!base_.confirm())
            return false;
        if (reads_ != nullptr)
            reads_->note_range(place_, {history::kStaticStamp, history::kStaticStamp});
        has_base_ = false;
        reads_ = nullptr;
        return true;
    }

    [[nodiscard]] static bool is_own(const SampleAt& at) { return at.slot == kOwn; }
    [[nodiscard]] static SampleAt at_own(const OwnSample& sample) { return {kOwn, sample.stamp}; }
    [[nodiscard]] const OwnSample& sample(const SampleAt& at) const { return *after(at.stamp - 1); }
    /// The first own sample after a stamp.
    [[nodiscard]] auto after(StampNs stamp) const {
        const auto& samples = own_->samples.in_order();
        return std::upper_bound(samples.begin(), samples.end(), stamp,
                                [](StampNs a, const OwnSample& b) { return a < b.stamp; });
    }
    /// An own sample replaces a committed sample with the same stamp.
    [[nodiscard]] static StampNs from_of(const SampleAt& at) {
        return is_own(at) ? at.stamp + 1 : at.stamp;
    }
    [[nodiscard]] static StampNs to_of(const SampleAt& at) {
        return is_own(at) ? at.stamp - 1 : at.stamp;
    }
    void note(StampNs from, StampNs to, StampNs used) const {
        if (reads_ == nullptr)
            return;
        reads_->note_range(place_, {from, to});
        reads_->note_used(place_, used);
    }

    /// The samples around a stamp among both; own ones win at equal stamps. Retention counts from
    /// the newest sample of both.
    [[nodiscard]] bool find_around(StampNs stamp, history::Bracket& out) const {
        out = {};
        if (has_base_ && !base_.empty()) {
            if (!base_.bracket(stamp, out))
                return false;
            if (out.before && out.before.stamp < cutoff_)
                out.before = {};
            if (out.after && out.after.stamp < cutoff_) {
                history::Bracket later;
                if (!base_.bracket(cutoff_ - 1, later))
                    return false;
                out.after = later.after;
            }
        }
        const auto& samples = own_->samples.in_order();
        const auto next = after(stamp);
        if (next != samples.begin()) {
            const OwnSample& before = *std::prev(next);
            if (before.stamp >= cutoff_ && (!out.before || before.stamp >= out.before.stamp))
                out.before = at_own(before);
        }
        const auto later = after(std::max(stamp, cutoff_ - 1));
        if (later != samples.end() && (!out.after || later->stamp <= out.after.stamp))
            out.after = at_own(*later);
        return true;
    }

    BaseEdge base_;
    const Own* own_ = nullptr;
    Reads* reads_ = nullptr;
    std::size_t place_ = 0;
    bool has_base_ = false;
    bool was_cleared_ = false;  // the transaction cleared the edge's samples in the store
    StampNs cutoff_ = std::numeric_limits<StampNs>::min();
};

}  // namespace tfdb::txn
