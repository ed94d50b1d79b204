// Removes frames by name in one commit, in any order.
#include <algorithm>
#include <mutex>

#include "tfdb/store/nearest.hpp"
#include "tfdb/store/writes.hpp"
#include "tfdb/txn/frame_places.hpp"

namespace tfdb::store {
namespace {

/// The frames of one removal, and the checks on them.
/// Threads: the holder of the commit lock. Guarantee: each frame is visited a few times, however
/// many are removed; removing a single leaf visits no other frames.
class Removal {
public:
    Removal(Store& store, StoreCommit& commit, std::span<const std::string_view> names)
        : store_(store), commit_(commit), names_(names) {
        ids_.reserve(names.size());
        for (std::size_t i = 0; i < names.size(); ++i) {
            const FrameId id = commit_.find_frame(names[i]);
            ids_.push_back(id);
            if (id < store.frames.count())
                add(id);
            else
                refusals_.add(unknown_frame(names[i], i, hint(names[i])));
        }
    }

    void judge(bool recursive) {
        if (std::none_of(gone_.begin(), gone_.end(), [&](FrameId id) { return children(id) > 0; }))
            return;
        if (recursive) {
            add_descendants();
        } else if (has_remaining_child()) {
            refuse_used();
        }
    }

    [[nodiscard]] const std::vector<FrameId>& frames() const { return gone_; }
    /// Frames of sources, which stay without their local parents.
    [[nodiscard]] const txn::FrameList& detached() const { return detached_; }
    [[nodiscard]] Refusals& refusals() { return refusals_; }

private:
    [[nodiscard]] std::uint64_t children(FrameId id) const {
        return store_.frames.word(id, history::kChildren).load_relaxed();
    }
    [[nodiscard]] bool goes(FrameId id) const { return store_.scratch.going.contains(id); }
    void add(FrameId id) {
        if (has_local_parent(id)) {
            detached_.insert(id);
        } else if (store_.scratch.going.insert(id)) {
            gone_.push_back(id);
        }
    }
    /// Whether a source created the frame, and a local writer stored its edge.
    [[nodiscard]] bool has_local_parent(FrameId id) const {
        return store_.remover_of(id) && !store_.writer_of(id) &&
               commit_.newest_parent(id) != kNoFrame;
    }

    /// Whether a frame to be removed has a child that stays.
    [[nodiscard]] bool has_remaining_child() const {
        std::uint64_t expected = 0;
        std::uint64_t going = 0;
        for (const FrameId id : gone_) {
            expected += children(id);
            const FrameId parent = commit_.newest_parent(id);
            going += parent != kNoFrame && goes(parent) ? 1 : 0;
        }
        for (const FrameId id : detached_)
            going += goes(commit_.newest_parent(id)) ? 1 : 0;
        return going != expected;
    }

    /// Calls visit(parent, child) for all frames, by newest parents.
    template <class Visit>
    void for_each_relation(Visit visit) const {
        const StoreView view = commit_.view();
        const std::uint32_t count = store_.frames.count();
        for (FrameId id = 0; id < count; ++id) {
            if (!view.alive(id))
                continue;
            // Excludes kNoFrame and invalid ids in a damaged store.
            const FrameId parent = commit_.newest_parent(id);
            if (parent < count)
                visit(parent, id);
        }
    }

    void add_descendants() {
        std::vector<std::vector<FrameId>> below(store_.frames.count());
        for_each_relation([&](FrameId parent, FrameId child) { below[parent].push_back(child); });
        for (std::size_t i = 0; i < gone_.size(); ++i) {
            for (const FrameId child : below[gone_[i]])
                add(child);
        }
    }

    /// For the first unknown frame only: more would take too long under the commit lock.
    [[nodiscard]] std::string hint(std::string_view name) const {
        return refusals_.empty() ? did_you_mean(store_, store_.committed(), name) : std::string();
    }

    void refuse_used() {
        std::vector<std::vector<FrameId>> stay(store_.frames.count());
        for_each_relation([&](FrameId parent, FrameId child) {
            if (goes(parent) && !goes(child) && !detached_.contains(child))
                stay[parent].push_back(child);
        });
        for (std::size_t i = 0; i < ids_.size(); ++i) {
            if (ids_[i] >= stay.size() || stay[ids_[i]].empty())
                continue;
            std::vector<std::string> children;
            for (const FrameId child : stay[ids_[i]])
                children.push_back(store_.names.name(child));
            refusals_.add(
                used_frame(names_[i], i, store_.remover_of(ids_[i]), std::move(children)));
        }
    }

    Store& store_;
    StoreCommit& commit_;
    std::span<const std::string_view> names_;
    std::vector<FrameId> ids_;   // by index in the list
    std::vector<FrameId> gone_;  // without duplicates
    txn::FrameList detached_;
    Refusals refusals_;
};

}  // namespace

CommitNumber commit_removal(Store& store, std::span<const std::string_view> names, bool recursive) {
    StoreCommit commit = store.start_commit();
    Removal removal(store, commit, names);
    removal.judge(recursive);
    if (!removal.refusals().empty())
        removal.refusals().raise(std::to_string(names.size()) + " frames");
    for (const FrameId id : removal.detached()) {
        (void)commit.touch(id);
        commit.clear(id);
    }
    for (const FrameId id : removal.frames())
        commit.remove(id);
    store.check_writable(commit);
    return commit.publish();
}

}  // namespace tfdb::store

namespace tfdb {

CommitNumber Buffer::remove_frames(std::span<const std::string_view> names, bool recursive) {
    if (names.empty())
        return commit();
    store::check_not_in_transaction(*store_);
    const store::Alone alone(*store_);
    return store::commit_removal(*store_, names, recursive);
}

}  // namespace tfdb
