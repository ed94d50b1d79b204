// Batches of transforms: validated, written and published as one commit.
#include "tfdb/store/writes.hpp"

#include <algorithm>
#include <array>
#include <map>
#include <mutex>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace tfdb::store {
namespace {

/// Sorts samples of one edge by stamp; the last of equal stamps counts.
void sort_items(std::vector<Store::Item>& items, std::span<const TransformView> batch) {
    const auto before = [&](const auto& a, const auto& b) {
        if (a.child != b.child)
            return a.child < b.child;
        return batch[a.index].stamp < batch[b.index].stamp;
    };
    if (!std::is_sorted(items.begin(), items.end(), before))
        std::stable_sort(items.begin(), items.end(), before);
}
/// Whether both are the same bytes in memory, as columns with one name for all rows have them.
bool is_same_text(std::string_view a, std::string_view b) {
    return a.data() == b.data() && a.size() == b.size();
}

/// Whether two members in sorted order have the same edge and stamp.
bool repeats_a_stamp(const std::vector<Store::Item>& items, const Batch& batch) {
    const auto same = [&](const auto& a, const auto& b) {
        return a.child == b.child && batch[a.index].stamp == batch[b.index].stamp;
    };
    return std::adjacent_find(items.begin(), items.end(), same) != items.end();
}

/// Number of an edge's samples that are appended at once, so that they stay in the cache.
constexpr std::size_t kTogether = 64;

/// Finds or creates the frames, and validates the samples against their edges before any write.
/// False: a member cannot be stored.
bool resolve_items(Store& store, StoreCommit& commit, const Batch& batch) {
    auto& items = store.items;
    items.clear();
    bool repeated = false;
    FrameId parent = kNoFrame;
    FrameId child = kNoFrame;
    for (std::size_t i = 0; i < batch.size(); ++i) {
        if (i == 0 || !is_same_text(batch[i].parent, batch[i - 1].parent))
            parent = commit.find_frame(batch[i].parent);
        if (i == 0 || !is_same_text(batch[i].child, batch[i - 1].child))
            child = commit.find_frame(batch[i].child);
        if (parent == kNoFrame || child == kNoFrame) {
            // A known name was validated when it was new.
            if (!has_sound_names(batch[i]))
                return false;
            parent = commit.frame(batch[i].parent);
            child = commit.frame(batch[i].child);
        }
        if (!is_storable(store, child, batch[i], batch.is_static(), batch.rules()))
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

/// Appends the samples that `resolve_items` found, the last of each stamp; an edge of the other
/// kind starts empty. Returns the number of normalised quaternions.
std::uint64_t append_items(Store& store, StoreCommit& commit, const Batch& batch) {
    const auto& items = store.items;
    auto& together = store.samples;
    auto& members = store.members;
    history::NewSample<StoreMemory> sample;
    std::uint64_t normalised = 0;
    const auto fill = [&](const Store::Item& item) {
        normalised += fill_from(batch[item.index], item.parent, batch.is_static(), sample) ? 1 : 0;
    };
    for (std::size_t i = 0; i < items.size(); ++i) {
        const FrameId child = items[i].child;
        const history::EdgeWriter<StoreMemory> edge(store.frames.memory(),
                                                    store.frames.header(child));
        if (batch.rules().change_kind && changes_kind(edge, batch.is_static()))
            commit.clear(child);
        const auto is_late = [&](std::size_t k) {
            return batch[items[k].index].stamp < edge.newest();
        };
        const auto is_of_edge = [&](std::size_t k) {
            return k < items.size() && items[k].child == child;
        };
        const bool alone = !is_of_edge(i + 1) && (i == 0 || items[i - 1].child != child);
        if (alone || batch.is_static()) {
            fill(items[i]);
            commit.append(child, sample, items[i].index);
            continue;
        }
        // Either all late samples, or some of the others.
        const bool late = is_late(i);
        together.clear();
        members.clear();
        const auto take = [&](std::size_t k) {
            fill(items[k]);
            if (is_of_edge(k + 1) && batch[items[k + 1].index].stamp == sample.stamp)
                return;
            together.push_back(sample);
            members.push_back(items[k].index);
        };
        take(i);
        while (is_of_edge(i + 1) && is_late(i + 1) == late && (late || together.size() < kTogether))
            take(++i);
        commit.append(child, together, [&](std::size_t k) { return members[k]; });
    }
    return normalised;
}

/// Publishes the writes; false if they would close a cycle.
bool publish(Store& store, StoreCommit& commit, std::uint64_t normalised, CommitNumber& number) {
    txn::Cycle cycle;
    if (commit.cycles().find(cycle))
        return false;
    number = commit.publish();
    if (normalised != 0)
        store.word(graph::kNormalised).fetch_add(normalised);
    return true;
}

/// Locks; false, without waiting, if the lock is taken and `wait` is false.
bool take(std::unique_lock<WriterLock>& guard, bool wait) {
    if (!wait)
        return guard.try_lock();
    guard.lock();
    return true;
}

/// Publishes the batch; false if a member cannot be stored.
bool store_all(Store& store, const Batch& batch, CommitNumber& number) {
    StoreCommit commit = store.start_commit(batch.authority());
    if (!resolve_items(store, commit, batch))
        return false;
    const std::uint64_t normalised = append_items(store, commit, batch);
    return publish(store, commit, normalised, number);
}

/// A private copy of some rows of columns, so that validated rows do not change.
/// Threads: one. Guarantee: wait-free.
class Rows {
public:
    explicit Rows(const EdgeColumns& columns) : columns_(columns) {}

    /// Copies the rows from `first` on. False: a row is invalid, or is not newer than `newest`.
    [[nodiscard]] bool take(std::size_t first, StampNs newest) {
        count_ = std::min(kTogether, columns_.stamps.size() - first);
        std::copy_n(columns_.stamps.data() + first, count_, stamps_.begin());
        std::copy_n(columns_.poses.data() + first, count_, poses_.begin());
        bool sound = true;
        for (std::size_t i = 0; i < count_; ++i) {
            sound = sound && stamps_[i] > newest && clock::is_stamp(stamps_[i]) &&
                    is_finite(poses_[i].translation) && is_rotation(poses_[i].rotation);
            newest = stamps_[i];
            normalised_ += counts_as_normalised(poses_[i].rotation) ? 1 : 0;
        }
        return sound;
    }
    /// Number of normalised quaternions so far.
    [[nodiscard]] std::uint64_t normalised() const { return normalised_; }
    [[nodiscard]] std::size_t count() const { return count_; }
    [[nodiscard]] StampNs stamp(std::size_t i) const { return stamps_[i]; }
    [[nodiscard]] const Pose& pose(std::size_t i) const { return poses_[i]; }

private:
    const EdgeColumns& columns_;
    std::size_t count_ = 0;
    std::uint64_t normalised_ = 0;
    std::array<StampNs, kTogether> stamps_{};
    std::array<Pose, kTogether> poses_{};
};

/// Publishes columns in ascending order that are newer than the edge's samples; false if a row is
/// not, or cannot be stored.
bool store_columns(Store& store, const EdgeColumns& columns, std::string_view authority,
                   CommitNumber& number) {
    StoreCommit commit = store.start_commit(authority);
    const TransformView names{columns.parent, columns.child, 0, {}};
    FrameId parent = commit.find_frame(names.parent);
    FrameId child = commit.find_frame(names.child);
    if (parent == kNoFrame || child == kNoFrame) {
        if (!has_sound_names(names))
            return false;
        parent = commit.frame(names.parent);
        child = commit.frame(names.child);
    }
    const history::EdgeWriter<StoreMemory> edge(store.frames.memory(), store.frames.header(child));
    if (parent == child || changes_kind(edge, false) || store.writer_of(child))
        return false;
    (void)commit.touch(child);
    Rows rows(columns);
    for (std::size_t first = 0; first < columns.stamps.size(); first += rows.count()) {
        if (!rows.take(first, edge.newest()))
            return false;
        const auto row = [&](std::size_t i) {
            history::NewSample<StoreMemory> sample;
            sample.stamp = rows.stamp(i);
            sample.parent = parent;
            fill_payload(rows.pose(i), sample);
            return sample;
        };
        commit.append_ahead(child, parent, rows.count(), row,
                            [&](std::size_t i) { return first + i; });
    }
    return publish(store, commit, rows.normalised(), number);
}

/// The rows as members, for the general path.
std::vector<TransformView> members_of(const EdgeColumns& columns) {
    std::vector<TransformView> members;
    members.reserve(columns.stamps.size());
    for (std::size_t i = 0; i < columns.stamps.size(); ++i)
        members.push_back({columns.parent, columns.child, columns.stamps[i], columns.poses[i]});
    return members;
}

/// Slow path: finds which members of a rejected batch are invalid.
/// Threads: the holder of the commit lock. Guarantee: the store stays as it is.
class Sorting {
public:
    Sorting(Store& store, const Batch& batch) : store_(store), batch_(batch) {
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

    /// The members that can be stored together.
    [[nodiscard]] std::span<const TransformView> good() const { return good_; }

    Refusals refusals;

private:
    /// Each attempt costs as much as the batch. Few batches need more than two.
    static constexpr int kTries = 64;

    [[nodiscard]] Fault fault_of(std::size_t i) const {
        const TransformView& transform = batch_[i];
        if (Fault fault = fault_alone(transform, i, batch_.is_static(), batch_.authority()))
            return fault;
        const CommitNumber now = store_.committed();
        const FrameId child = store_.names.find(transform.child, now);
        if (child == kNoFrame || store_.names.find(transform.parent, now) == kNoFrame) {
            if (Fault fault = fault_of_names(transform, i, batch_.authority()))
                return fault;
        }
        if (child == kNoFrame)
            return std::nullopt;
        return fault_of_edge(store_, child, transform, i, batch_.is_static(), batch_.authority(),
                             batch_.rules());
    }

    /// Writes the good members, searches for cycles, and rolls back. True if some members must be
    /// removed; `all` removes every possible part of a cycle.
    bool leave_out_some(bool all) {
        if (good_.empty())
            return false;
        StoreCommit trial = store_.start_commit();
        const Batch tried = batch_.with(good_);
        (void)resolve_items(store_, trial, tried);
        (void)append_items(store_, trial, tried);
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
        for (const auto& item : store_.items) {
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
                refusals.add(cycle_fault(good_[i], index, batch_.is_static(), batch_.authority()));
                if (!take_next(good_[i], index))
                    continue;
            }
            good_[kept] = batch_[index];
            indices_[kept++] = index;
        }
        good_.resize(kept);
        indices_.resize(kept);
    }

    /// Replaces a rejected member by the next one of its edge and stamp.
    [[nodiscard]] bool take_next(const TransformView& left_out, std::size_t& index) {
        const auto found = repeats_.find({left_out.child, left_out.stamp});
        if (found == repeats_.end() || found->second.empty())
            return false;
        index = found->second.front();
        found->second.erase(found->second.begin());
        return true;
    }

    Store& store_;
    const Batch& batch_;
    std::vector<TransformView> good_;
    std::vector<std::size_t> indices_;  // of the good members in the batch
    // With `only_new`: the stamps, and later members with the same stamp.
    std::map<std::pair<std::string_view, StampNs>, std::vector<std::size_t>> repeats_;
};

/// Stores columns on the fast path; false if the members must be validated one by one.
bool store_at_once(Store& store, const WriteRequest& request, WriteResult& result) {
    const EdgeColumns& columns = *request.columns;
    if (columns.stamps.size() != columns.poses.size()) {
        throw InvalidArgument(std::to_string(columns.stamps.size()) + " stamps for " +
                              std::to_string(columns.poses.size()) + " poses");
    }
    if (store.engine != nullptr || columns.stamps.empty())
        return false;
    check_not_in_transaction(store);
    std::unique_lock guard(store.lock, std::defer_lock);
    result.busy = !take(guard, request.wait);
    if (result.busy)
        return true;
    try {
        return store_columns(store, columns, request.authority, result.commit);
    } catch (const CapacityExceeded&) {
        return false;
    }
}

/// As Buffer::write, in an engine with its own commit.
WriteResult write_by_engine(Store& store, const Batch& batch, const WriteRequest& request) {
    WriteResult result;
    try {
        result.busy = !store.engine->write(batch, request.wait, result.commit);
        return result;
    } catch (const Error& error) {
        if (!request.partial || error.detail().refused.empty())
            throw;
    }
    const Alone alone(store);
    return commit_partial(store, batch);
}

}  // namespace

void check_rules(WriteRules rules, bool is_static) {
    if (rules.only_new && is_static)
        throw InvalidArgument("only_new needs stamps, which static transforms do not have");
}

CommitNumber commit_batch(Store& store, const Batch& batch) {
    CommitNumber commit = 0;
    if (batch.sound() && store_all(store, batch, commit))
        return commit;
    Sorting sorting(store, batch);
    try {
        sorting.leave_out_cycles();
    } catch (const CapacityExceeded&) {
        if (sorting.refusals.empty())
            throw;
    }
    sorting.refusals.raise(std::to_string(batch.size()) + " transforms");
}

WriteResult commit_partial(Store& store, const Batch& batch) {
    WriteResult result;
    if (batch.sound() && store_all(store, batch, result.commit))
        return result;
    Sorting sorting(store, batch);
    sorting.leave_out_cycles();
    result.refused = sorting.refusals.members();  // may throw, so before anything is stored
    result.commit = store.committed();
    if (!sorting.good().empty())
        (void)store_all(store, batch.with(sorting.good()), result.commit);
    return result;
}

}  // namespace tfdb::store

namespace tfdb {

WriteResult Buffer::write(const WriteRequest& request) {
    store::check_rules(request.rules, request.is_static);
    if (request.columns != nullptr) {
        WriteResult result;
        if (store::store_at_once(*store_, request, result))
            return result;
        const std::vector<TransformView> members = store::members_of(*request.columns);
        WriteRequest one_by_one = request;
        one_by_one.columns = nullptr;
        one_by_one.transforms = members;
        return write(one_by_one);
    }
    if (request.transforms.empty())
        return {.commit = commit()};
    store::check_not_in_transaction(*store_);
    const store::Batch batch(request.transforms, request.is_static, request.authority,
                             request.rules);
    if (store_->engine != nullptr) [[unlikely]]
        return store::write_by_engine(*store_, batch, request);
    std::unique_lock guard(store_->lock, std::defer_lock);
    if (!store::take(guard, request.wait))
        return {.busy = true};
    if (request.partial)
        return store::commit_partial(*store_, batch);
    return {.commit = store::commit_batch(*store_, batch)};
}

std::optional<Error> fault_of(const TransformView& transform, std::size_t index, bool is_static,
                              std::string_view authority) {
    store::Fault fault = store::fault_alone(transform, index, is_static, authority);
    return fault ? fault : store::fault_of_names(transform, index, authority);
}

}  // namespace tfdb
