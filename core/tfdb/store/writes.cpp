// Batches of transforms: checked, written and published as one commit.
#include "tfdb/store/writes.hpp"

#include <algorithm>
#include <mutex>

namespace tfdb {
namespace {

/// Samples of one edge must come in stamp order; the later member of a batch wins a tie.
void sort_items(std::vector<Reads::Impl::Item>& items, std::span<const TransformView> batch) {
    std::stable_sort(items.begin(), items.end(), [&](const auto& a, const auto& b) {
        if (a.child != b.child)
            return a.child < b.child;
        return batch[a.index].stamp < batch[b.index].stamp;
    });
}

void resolve_items(Reads::Impl& impl, StoreCommit& commit, std::span<const TransformView> batch,
                   bool is_static, std::string_view authority) {
    auto& items = impl.items;
    items.clear();
    bool repeated = false;
    for (std::size_t i = 0; i < batch.size(); ++i) {
        FrameId parent = commit.find_frame(batch[i].parent);
        FrameId child = commit.find_frame(batch[i].child);
        if (parent == kNoFrame || child == kNoFrame) {
            // A name that is known was checked when it was new.
            store::check_names(batch[i], i, authority);
            parent = commit.frame(batch[i].parent);
            child = commit.frame(batch[i].child);
        }
        repeated |= commit.touch(child);
        items.push_back({child, parent, i});
    }
    if (repeated && !is_static)
        sort_items(items, batch);
}

}  // namespace

namespace store {

CommitNumber commit_batch(Reads::Impl& impl, const Batch& all) {
    const std::span<const TransformView> batch = all.members();
    const bool is_static = all.is_static();
    const std::string_view authority_name = all.authority();
    if (!all.sound())
        check_batch(batch, is_static, authority_name);
    StoreCommit commit = impl.start_commit();
    resolve_items(impl, commit, batch, is_static, authority_name);
    history::NewSample<StoreMemory> sample;
    for (const auto& item : impl.items) {
        const TransformView& transform = batch[item.index];
        store::check_edge(impl, item.child, transform, item.index, is_static, authority_name);
        fill_sample(impl, transform, item.parent, is_static, sample);
        commit.append(item.child, sample, item.index);
    }
    txn::Cycle cycle;
    if (commit.find_cycle(cycle)) {
        store::throw_cycle(batch[cycle.item], cycle.item, authority_name);
    }
    const std::uint64_t authority = impl.authorities.id(authority_name);
    for (const auto& item : impl.items) {
        auto& writer = impl.frames.word(item.child, history::kAuthority);
        if (writer.load_relaxed() != authority)
            writer.store_relaxed(authority);
    }
    return commit.publish();
}

}  // namespace store

CommitNumber Buffer::set_transforms(std::span<const TransformView> batch, bool is_static,
                                    std::string_view authority) {
    if (batch.empty())
        return commit();
    const store::Batch judged(batch, is_static, authority);
    const std::lock_guard guard(impl_->lock);
    return store::commit_batch(*impl_, judged);
}

bool Buffer::try_set_transforms(std::span<const TransformView> batch, bool is_static,
                                std::string_view authority, CommitNumber& commit) {
    if (batch.empty()) {
        commit = this->commit();
        return true;
    }
    const store::Batch judged(batch, is_static, authority);
    const std::unique_lock guard(impl_->lock, std::try_to_lock);
    if (!guard.owns_lock())
        return false;
    commit = store::commit_batch(*impl_, judged);
    return true;
}

}  // namespace tfdb
