// Batches of transforms: judged, written and published as one commit.
#include "tfdb/store/writes.hpp"

#include <algorithm>
#include <map>
#include <mutex>
#include <string_view>
#include <utility>
#include <vector>

namespace tfdb::store {
namespace {

/// Samples of one edge must come in stamp order; the later member of a batch wins a tie.
void sort_items(std::vector<Reads::Impl::Item>& items, std::span<const TransformView> batch) {
    std::stable_sort(items.begin(), items.end(), [&](const auto& a, const auto& b) {
        if (a.child != b.child)
            return a.child < b.child;
        return batch[a.index].stamp < batch[b.index].stamp;
    });
}

/// Of items in order: whether two members of the batch are of one edge and stamp.
bool repeats_a_stamp(const std::vector<Reads::Impl::Item>& items, const Batch& batch) {
    const auto same = [&](const auto& a, const auto& b) {
        return a.child == b.child && batch[a.index].stamp == batch[b.index].stamp;
    };
    return std::adjacent_find(items.begin(), items.end(), same) != items.end();
}

/// Finds or makes the frames, and judges the samples against their edges while these are as they
/// were committed. False: a member cannot be stored.
bool resolve_items(Reads::Impl& impl, StoreCommit& commit, const Batch& batch) {
    auto& items = impl.items;
    items.clear();
    bool repeated = false;
    for (std::size_t i = 0; i < batch.size(); ++i) {
        FrameId parent = commit.find_frame(batch[i].parent);
        FrameId child = commit.find_frame(batch[i].child);
        if (parent == kNoFrame || child == kNoFrame) {
            // A name that is known was judged when it was new.
            if (!has_sound_names(batch[i]))
                return false;
            parent = commit.frame(batch[i].parent);
            child = commit.frame(batch[i].child);
        }
        if (!is_storable(impl, child, batch[i], batch.is_static(), batch.rules()))
            return false;
        repeated |= commit.touch(child);
        items.push_back({child, parent, i});
    }
    if (repeated && !batch.is_static()) {
        sort_items(items, batch.members());
        if (batch.rules().only_new && repeats_a_stamp(items, batch))
            return false;
    }
    return true;
}

/// Appends the samples that `resolve_items` has found in the batch; an edge of the other kind
/// starts anew. Returns how many quaternions were mended.
std::uint64_t append_items(Reads::Impl& impl, StoreCommit& commit, const Batch& batch) {
    const auto& items = impl.items;
    auto& late = impl.late_samples;
    history::NewSample<StoreMemory> sample;
    std::uint64_t mended = 0;
    const auto fill = [&](const Reads::Impl::Item& item) {
        mended += fill_from(batch[item.index], item.parent, batch.is_static(), sample) ? 1 : 0;
    };
    for (std::size_t i = 0; i < items.size(); ++i) {
        const FrameId child = items[i].child;
        const history::EdgeWriter<StoreMemory> edge(impl.frames.memory(),
                                                    impl.frames.header(child));
        if (batch.rules().change_kind && changes_kind(edge, batch.is_static()))
            commit.clear(child);
        const auto next_is_late = [&] {
            return i + 1 < items.size() && items[i + 1].child == child &&
                   batch[items[i + 1].index].stamp < edge.newest();
        };
        fill(items[i]);
        if (!next_is_late()) {
            commit.append(child, sample, items[i].index);
            continue;
        }
        const std::size_t first = i;
        late.assign(1, sample);
        while (next_is_late()) {
            fill(items[++i]);
            late.push_back(sample);
        }
        commit.append(child, late, [&](std::size_t k) { return items[first + k].index; });
    }
    return mended;
}

/// Publishes the batch; false if a member cannot be stored.
bool store_all(Reads::Impl& impl, const Batch& batch, CommitNumber& number) {
    StoreCommit commit = impl.start_commit();
    if (!resolve_items(impl, commit, batch))
        return false;
    const std::uint64_t mended = append_items(impl, commit, batch);
    txn::Cycle cycle;
    if (commit.cycles().find(cycle))
        return false;
    const std::uint64_t author = impl.authorities.id(batch.authority());
    commit.prepare();  // from here on nothing throws
    for (const auto& item : impl.items)
        impl.set_author(item.child, author);
    if (mended != 0)
        impl.word(graph::kNormalised).fetch_add(mended);
    number = commit.publish();
    return true;
}

/// The members of a batch that was refused, told apart. Here nothing is in a hurry.
/// Threads: the holder of the commit lock. Guarantee: the store stays as it is.
class Sorting {
public:
    Sorting(Reads::Impl& impl, const Batch& batch) : impl_(impl), batch_(batch) {
        for (std::size_t i = 0; i < batch.size(); ++i) {
            if (Fault fault = fault_of(i)) {
                refusals.add(std::move(fault));
                continue;
            }
            if (batch.rules().only_new) {
                const auto [place, is_new] = repeats_.try_emplace({batch[i].child, batch[i].stamp});
                if (!is_new) {
                    place->second.push_back(i);
                    continue;
                }
            }
            good_.push_back(batch[i]);
            indices_.push_back(i);
        }
    }

    /// Throws CapacityExceeded.
    void leave_out_cycles() {
        for (int tries = 0; leave_out_some(tries >= kTries); ++tries) {
        }
        for (const auto& [stamp, waiting] : repeats_) {
            for (const std::size_t i : waiting)
                refusals.add(repeated_stamp(batch_[i], i, batch_.authority()));
        }
        repeats_.clear();
    }

    /// What may be stored, all of it together.
    [[nodiscard]] std::span<const TransformView> good() const { return good_; }

    Refusals refusals;

private:
    /// Each try costs as much as the batch. Few batches need more than two.
    static constexpr int kTries = 64;

    [[nodiscard]] Fault fault_of(std::size_t i) const {
        const TransformView& transform = batch_[i];
        if (Fault fault = fault_alone(transform, i, batch_.is_static(), batch_.authority()))
            return fault;
        const CommitNumber now = impl_.committed();
        const FrameId child = impl_.names.find(transform.child, now);
        if (child == kNoFrame || impl_.names.find(transform.parent, now) == kNoFrame) {
            if (Fault fault = fault_of_names(transform, i, batch_.authority()))
                return fault;
        }
        if (child == kNoFrame)
            return std::nullopt;
        return fault_of_edge(impl_, child, transform, i, batch_.is_static(), batch_.authority(),
                             batch_.rules());
    }

    /// Writes what is good so far, looks for cycles, takes it all back. True if some members were
    /// to be left out; `all` leaves out whatever could be part of a cycle.
    bool leave_out_some(bool all) {
        if (good_.empty())
            return false;
        StoreCommit trial = impl_.start_commit();
        const Batch tried = batch_.with(good_);
        (void)resolve_items(impl_, trial, tried);
        (void)append_items(impl_, trial, tried);
        std::vector<txn::Cycle> cycles;
        if (!trial.cycles().find_all(cycles))
            return false;
        if (all)
            trial.cycles().suspects(cycles);
        leave_out(cycles);
        return true;
    }

    void leave_out(std::vector<txn::Cycle>& cycles) {
        std::sort(cycles.begin(), cycles.end(),
                  [](const auto& a, const auto& b) { return a.child < b.child; });
        std::vector<bool> out(good_.size());
        for (const auto& item : impl_.items) {
            const StampNs stamp = good_[item.index].stamp;
            auto at = std::lower_bound(cycles.begin(), cycles.end(), item.child,
                                       [](const auto& c, FrameId id) { return c.child < id; });
            for (; at != cycles.end() && at->child == item.child; ++at) {
                const bool timely = batch_.is_static() || (at->from <= stamp && stamp < at->to);
                if (at->item == item.index || (at->parent == item.parent && timely))
                    out[item.index] = true;
            }
        }
        std::size_t kept = 0;
        for (std::size_t i = 0; i < good_.size(); ++i) {
            std::size_t index = indices_[i];
            if (out[i]) {
                refusals.add(cycle_fault(good_[i], index, batch_.authority()));
                if (!take_next(good_[i], index))
                    continue;
            }
            good_[kept] = batch_[index];
            indices_[kept++] = index;
        }
        good_.resize(kept);
        indices_.resize(kept);
    }

    /// Who comes in the place of a member that was left out: the next one of its edge and stamp.
    [[nodiscard]] bool take_next(const TransformView& left_out, std::size_t& index) {
        const auto found = repeats_.find({left_out.child, left_out.stamp});
        if (found == repeats_.end() || found->second.empty())
            return false;
        index = found->second.front();
        found->second.erase(found->second.begin());
        return true;
    }

    Reads::Impl& impl_;
    const Batch& batch_;
    std::vector<TransformView> good_;
    std::vector<std::size_t> indices_;  // of the good ones in the batch
    // With `only_new`: their stamps, and who came later with the same one.
    std::map<std::pair<std::string_view, StampNs>, std::vector<std::size_t>> repeats_;
};

}  // namespace

void check_rules(WriteRules rules, bool is_static) {
    if (rules.only_new && is_static)
        throw InvalidArgument("only_new is about stamps: a static transform has none");
}

CommitNumber commit_batch(Reads::Impl& impl, const Batch& batch) {
    CommitNumber commit = 0;
    if (batch.sound() && store_all(impl, batch, commit))
        return commit;
    Sorting sorting(impl, batch);
    try {
        sorting.leave_out_cycles();
    } catch (const CapacityExceeded&) {
        if (sorting.refusals.empty())
            throw;
    }
    sorting.refusals.raise(std::to_string(batch.size()) + " transforms");
}

std::vector<RefusedMember> commit_partial(Reads::Impl& impl, const Batch& batch,
                                          CommitNumber& commit) {
    if (batch.sound() && store_all(impl, batch, commit))
        return {};
    Sorting sorting(impl, batch);
    sorting.leave_out_cycles();
    auto refused = sorting.refusals.members();  // it may throw: not once something is stored
    commit = impl.committed();
    if (!sorting.good().empty())
        (void)store_all(impl, batch.with(sorting.good()), commit);
    return refused;
}

}  // namespace tfdb::store

namespace tfdb {

CommitNumber Buffer::set_transforms(std::span<const TransformView> batch, bool is_static,
                                    std::string_view authority, WriteRules rules) {
    store::check_rules(rules, is_static);
    if (batch.empty())
        return commit();
    store::check_not_in_transaction(*impl_);
    const store::Batch judged(batch, is_static, authority, rules);
    if (impl_->engine != nullptr) [[unlikely]]
        return impl_->engine->write(judged);
    const std::lock_guard guard(impl_->lock);
    return store::commit_batch(*impl_, judged);
}

bool Buffer::try_set_transforms(std::span<const TransformView> batch, bool is_static,
                                std::string_view authority, CommitNumber& commit,
                                WriteRules rules) {
    store::check_rules(rules, is_static);
    if (batch.empty()) {
        commit = this->commit();
        return true;
    }
    store::check_not_in_transaction(*impl_);
    const store::Batch judged(batch, is_static, authority, rules);
    if (impl_->engine != nullptr) [[unlikely]]
        return impl_->engine->try_write(judged, commit);
    const std::unique_lock guard(impl_->lock, std::try_to_lock);
    if (!guard.owns_lock())
        return false;
    commit = store::commit_batch(*impl_, judged);
    return true;
}

std::vector<RefusedMember> Buffer::set_transforms_partial(std::span<const TransformView> batch,
                                                          bool is_static,
                                                          std::string_view authority,
                                                          CommitNumber& commit, WriteRules rules) {
    store::check_rules(rules, is_static);
    if (batch.empty()) {
        commit = this->commit();
        return {};
    }
    store::check_not_in_transaction(*impl_);
    const store::Batch judged(batch, is_static, authority, rules);
    const store::Alone alone(*impl_);
    return store::commit_partial(*impl_, judged, commit);
}

}  // namespace tfdb
