// The notes of some commits, copied from the change feed.
#pragma once

#include <algorithm>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <unordered_map>
#include <unordered_set>
#include <utility>
#include <vector>

#include "tfdb/store/store.hpp"

namespace tfdb::store {

/// Threads: one. Guarantee: immutable between two reads.
class FeedNotes {
public:
    /// False: the feed no longer contains `first`.
    template <class AnyStore>
    [[nodiscard]] bool read(const AnyStore& store, CommitNumber first, CommitNumber last) {
        first_ = first;
        if (!txn::Feed(store.frames).read(first, last, words_, ends_))
            return false;
        removals_.clear();
        for (CommitNumber commit = first; commit <= last; ++commit) {
            for_each(commit, [&](std::uint64_t note, std::string name) {
                if ((txn::FeedNote::what(note) & txn::FeedNote::kRemoved) != 0)
                    removals_[txn::FeedNote::id(note)].push_back({commit, std::move(name)});
            });
        }
        return true;
    }

    /// Calls visit(note, name) for each note of a commit; the name is that of a removed frame.
    template <class Visit>
    void for_each(CommitNumber commit, Visit visit) const {
        const std::size_t at = commit - first_;
        for (std::size_t i = at == 0 ? 0 : ends_[at - 1]; i < ends_[at];) {
            const std::uint64_t note = words_[i++];
            std::string name;
            if ((txn::FeedNote::what(note) & txn::FeedNote::kRemoved) != 0) {
                const std::size_t left = ends_[at] - i;
                for (std::uint64_t k = std::min(txn::FeedNote::name_words(note), left); k > 0;
                     --k) {
                    const std::uint64_t word = words_[i++];
                    name.append(reinterpret_cast<const char*>(&word), sizeof word);
                }
                name.resize(std::min(txn::FeedNote::count(note), std::uint64_t{name.size()}));
            }
            visit(note, std::move(name));
        }
    }

    /// The name of a frame that was removed in this commit or a later one; null if it was not
    /// removed.
    [[nodiscard]] const std::string* removed(FrameId id, CommitNumber commit) const {
        const auto found = removals_.find(id);
        if (found == removals_.end())
            return nullptr;
        for (const Removal& removal : found->second) {
            if (removal.commit >= commit)
                return &removal.name;
        }
        return nullptr;
    }

    /// The name of a commit's frame. False: its slot was reused meanwhile, and the removal is not
    /// among the notes. `newest`: a view of the newest state before the notes were read.
    [[nodiscard]] bool name_of(const Store& store, const StoreView& newest, FrameId id,
                               CommitNumber commit, std::string& name) const {
        if (const std::string* const found = removed(id, commit)) {
            name = *found;
            return true;
        }
        name = store.names.name(id);
        sync::fence_acquire();
        return newest.alive_since(id, commit);
    }

private:
    struct Removal {
        CommitNumber commit;
        std::string name;
    };
    CommitNumber first_ = 0;
    std::vector<std::uint64_t> words_;
    std::vector<std::size_t> ends_;
    std::unordered_map<FrameId, std::vector<Removal>> removals_;  // in order of removal
};

/// The requested frames, by name.
/// Threads: one. Guarantee: immutable.
class FrameFilter {
public:
    using Only = std::optional<std::span<const std::string_view>>;
    /// None: all frames. Throws InvalidName for a name that no frame can have.
    FrameFilter(const Store& store, CommitNumber newest, Only only);

    [[nodiscard]] bool is_for_all() const { return !only_; }
    /// Checks a frame's id in a state: false if the frame is certainly not requested. A frame that
    /// has left the state is checked by its name.
    [[nodiscard]] bool may_contain(FrameId id, const StoreView& newest, CommitNumber commit) const {
        return !only_ || ids_.contains(id) || !newest.alive_since(id, commit);
    }
    [[nodiscard]] bool contains(std::string_view name) const {
        return !only_ || names_.contains(name);
    }

private:
    Only only_;
    std::unordered_set<std::string_view> names_;
    std::unordered_set<FrameId> ids_;
};

/// The samples that one commit stored in an edge, at most `count`, greatest stamps first:
/// visit(sample, slot). False: overtaken.
template <class Visit>
[[nodiscard]] bool visit_stored(const StoreEdge& edge, CommitNumber commit, std::uint64_t count,
                                Visit visit) {
    std::uint64_t left = count;
    return edge.visit_since(commit, [&](const history::SampleAt& at) {
        const auto slot = edge.read(at);
        if (slot.commit != commit)
            return true;
        visit(at, slot);
        return --left > 0;
    });
}

[[noreturn]] void throw_lapped(const Store& store, CommitNumber since);

/// Reads the notes of commits after `since`, of ever more commits, until `use(last)` returns kOk
/// for those up to `last`, or all up to `newest` are read. Names of frames that were removed later
/// need more notes. `least`: the number of commits wanted. Throws FeedLapped.
template <class Use>
[[nodiscard]] lookup::Outcome read_notes(const Store& store, FeedNotes& notes, CommitNumber since,
                                         CommitNumber newest, std::uint64_t least, Use use) {
    for (std::uint64_t count = least;; count *= 4) {
        const CommitNumber last = since + std::min<std::uint64_t>(count, newest - since);
        if (!notes.read(store, since + 1, last))
            throw_lapped(store, since);
        const lookup::Outcome outcome = use(last);
        if (outcome != lookup::Outcome::kLapped || last == newest)
            return outcome;
    }
}

/// Throws NotSupported if the store keeps no feed. False: the store is frozen and will have no
/// commits.
[[nodiscard]] bool has_feed(const Store& store);
[[noreturn]] void throw_future_commit(CommitNumber since, CommitNumber newest);

}  // namespace tfdb::store
