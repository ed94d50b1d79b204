// What commits did, from the feed and from the history.
#include <algorithm>
#include <bit>
#include <string>
#include <unordered_map>
#include <utility>

#include "tfdb/store/raise.hpp"
#include "tfdb/store/store.hpp"

namespace tfdb::store {
namespace {

using lookup::Outcome;
using txn::FeedNote;

/// The notes of some commits, as they were copied from the feed.
/// Threads: one. Guarantee: none of it changes.
class Notes {
public:
    /// False: the feed does not reach back to `first` any more.
    [[nodiscard]] bool read(const Store& store, CommitNumber first, CommitNumber last) {
        first_ = first;
        if (!StoreFeed(store.frames).read(first, last, words_, ends_))
            return false;
        removals_.clear();
        for (CommitNumber commit = first; commit <= last; ++commit) {
            for_each(commit, [&](std::uint64_t note, std::string name) {
                if ((FeedNote::what(note) & FeedNote::kRemoved) != 0)
                    removals_[FeedNote::id(note)].push_back({commit, std::move(name)});
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
            if ((FeedNote::what(note) & FeedNote::kRemoved) != 0) {
                const std::size_t left = ends_[at] - i;
                for (std::uint64_t k = std::min(FeedNote::name_words(note), left); k > 0; --k) {
                    const std::uint64_t word = words_[i++];
                    name.append(reinterpret_cast<const char*>(&word), sizeof word);
                }
                name.resize(std::min(FeedNote::count(note), std::uint64_t{name.size()}));
            }
            visit(note, std::move(name));
        }
    }

    /// The name of a frame that was removed in this commit or a later one; null if it was not.
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

private:
    struct Removal {
        CommitNumber commit;
        std::string name;
    };
    CommitNumber first_ = 0;
    std::vector<std::uint64_t> words_;
    std::vector<std::size_t> ends_;
    std::unordered_map<FrameId, std::vector<Removal>> removals_;  // in their order
};

/// Reads what commits did from the newest state and the remains of older ones.
/// Threads: one. Guarantee: kLapped where a writer overtook it.
class ChangeReader {
public:
    ChangeReader(const Store& store, const StoreView& newest, const Notes& notes)
        : store_(store), newest_(newest), notes_(notes) {}

    [[nodiscard]] Outcome read(CommitNumber commit, Changes& out) {
        out = Changes{};
        out.commit = commit;
        bool whole = true;
        std::vector<FrameId> made;
        notes_.for_each(commit, [&](std::uint64_t note, const std::string& removed) {
            whole = whole && read_note(commit, note, removed, made, out);
        });
        return whole ? Outcome::kOk : Outcome::kLapped;
    }

private:
    bool read_note(CommitNumber commit, std::uint64_t note, const std::string& removed,
                   std::vector<FrameId>& made, Changes& out) {
        const FrameId id = FeedNote::id(note);
        const unsigned what = FeedNote::what(note);
        if ((what & FeedNote::kRemoved) != 0) {
            const auto own = std::find(made.begin(), made.end(), id);
            if (own != made.end())
                std::erase(out.made, removed);
            (own != made.end() ? out.passing : out.removed).push_back(removed);
            return true;
        }
        std::string name;
        if (!name_of(id, commit, name))
            return false;
        if ((what & FeedNote::kMade) != 0) {
            out.made.push_back(name);
            made.push_back(id);
        }
        if ((what & FeedNote::kMoved) != 0)
            out.moved.push_back(name);
        if ((what & FeedNote::kCleared) != 0)
            out.cleared.push_back(name);
        if (FeedNote::count(note) == 0)
            return true;
        auto& edge = out.stored.emplace_back();
        edge.child = std::move(name);
        return read_stored(id, commit, FeedNote::count(note), edge);
    }

    /// What state `commit` had, or what the newest one still has of it.
    bool read_stored(FrameId id, CommitNumber commit, std::uint64_t count, Changes::Edge& out) {
        std::vector<FrameId> parents;
        if (!collect_of_state(id, commit, count, parents, out)) {
            collected_nothing(parents, out);
            if (notes_.removed(id, commit) == nullptr &&
                !collect(newest_, id, commit, count, parents, out))
                return false;
        }
        out.gone = count - out.poses.size();
        std::reverse(out.stamps.begin(), out.stamps.end());
        std::reverse(out.poses.begin(), out.poses.end());
        std::reverse(parents.begin(), parents.end());
        for (std::size_t i = 0; i < parents.size(); ++i) {
            if (i > 0 && parents[i] == parents[i - 1]) {
                out.parents.push_back(out.parents.back());
            } else if (!name_of(parents[i], commit, out.parents.emplace_back())) {
                return false;
            }
        }
        return true;
    }
    /// What state `commit` had, as often as writers overtake that. False: it is known no more.
    bool collect_of_state(FrameId id, CommitNumber commit, std::uint64_t count,
                          std::vector<FrameId>& parents, Changes::Edge& out) {
        constexpr int kTries = 32;
        for (int i = 0; i < kTries; ++i) {
            collected_nothing(parents, out);
            if (collect(store_.view(commit), id, commit, count, parents, out))
                return true;
            if (store_.memory.reclaimed(memory::Line::kEnded).load_relaxed() > commit)
                return false;
        }
        return false;
    }
    static void collected_nothing(std::vector<FrameId>& parents, Changes::Edge& out) {
        parents.clear();
        out.stamps.clear();
        out.poses.clear();
    }

    /// At most `count` samples of one commit, those of the greatest stamp first. False: overtaken.
    static bool collect(const StoreView& view, FrameId id, CommitNumber commit, std::uint64_t count,
                        std::vector<FrameId>& parents, Changes::Edge& out) {
        StoreEdge edge;
        if (!view.open(id, edge))
            return false;
        const bool whole = edge.visit_since(commit, [&](const history::SampleAt& at) {
            const auto slot = edge.read(at);
            if (slot.commit != commit)
                return true;
            parents.push_back(slot.parent);
            out.stamps.push_back(std::max(at.stamp, history::kNoStamp));
            out.poses.push_back(std::bit_cast<Pose>(slot.payload));
            out.is_static = at.stamp == history::kStaticStamp;
            return out.poses.size() < count;
        });
        return whole && edge.confirm();
    }

    /// The name that a frame of a commit had. False: its slot was reused meanwhile.
    bool name_of(FrameId id, CommitNumber commit, std::string& name) const {
        if (const std::string* const removed = notes_.removed(id, commit)) {
            name = *removed;
            return true;
        }
        name = store_.names.name(id);
        sync::fence_acquire();
        return newest_.alive_since(id, commit);
    }

    const Store& store_;
    const StoreView& newest_;
    const Notes& notes_;
};

[[noreturn]] void throw_lapped(const Store& store, CommitNumber since) {
    // Commit `floor` and later ones are kept: a caller that has the one before it can go on.
    const CommitNumber oldest = StoreFeed(store.frames).floor().load_acquire() - 1;
    // Read after the floor: the commit of the view may have left the feed by now.
    const CommitNumber newest = store.committed();
    // The oldest commit is overwritten next: at a writer's full speed it is gone before the caller
    // asks again. Half of the feed lies between this one and that.
    const CommitNumber safe = newest - (newest - std::min(oldest, newest)) / 2;
    ErrorDetail detail;
    detail.since = since;
    detail.oldest = static_cast<std::int64_t>(oldest);
    detail.newest = static_cast<std::int64_t>(newest);
    detail.commit = safe;
    throw FeedLapped("changes since commit " + std::to_string(since) +
                         " are no longer kept: the feed reaches back to commit " +
                         std::to_string(oldest) +
                         ", which is overwritten next; take a snapshot (the newest commit is " +
                         std::to_string(newest) + ") and follow from its commit, or go on from " +
                         std::to_string(safe) + " without the commits before",
                     std::move(detail));
}

}  // namespace
}  // namespace tfdb::store

namespace tfdb {

std::vector<Changes> Buffer::changes(CommitNumber since, std::size_t limit) const {
    using lookup::Outcome;
    const bool kept = StoreFeed(store_->frames).is_kept();
    if (!kept && (store_->shared == nullptr || !store_->shared->frozen)) {
        throw NotSupported("the engine '" + std::string(concurrency_name(store_->concurrency)) +
                           "' keeps no feed of changes: 'snapshot' and 'giant' do");
    }
    store::check_not_in_transaction(*store_);
    std::vector<Changes> all;
    store::Notes notes;
    const auto read = [&](const StoreView& view, CommitNumber first, CommitNumber last) {
        all.clear();
        store::ChangeReader reader(*store_, view, notes);
        for (CommitNumber commit = first; commit <= last; ++commit) {
            const Outcome outcome = reader.read(commit, all.emplace_back());
            if (outcome != Outcome::kOk)
                return outcome;
        }
        return Outcome::kOk;
    };
    const auto attempt = [&](const StoreView& view) {
        all.clear();
        const CommitNumber newest = view.commit();
        if (since > newest) {
            throw InvalidArgument("no commit " + std::to_string(since) + " yet: the newest is " +
                                  std::to_string(newest));
        }
        const std::size_t wanted = std::min<std::uint64_t>(limit, newest - since);
        if (wanted == 0)
            return Outcome::kOk;
        // What was removed later has its name there: only where that is asked for are all read.
        for (const CommitNumber last : {since + wanted, newest}) {
            if (!kept || !notes.read(*store_, since + 1, last))
                store::throw_lapped(*store_, since);
            const Outcome outcome = read(view, since + 1, since + wanted);
            if (outcome == Outcome::kOk || last == newest)
                return outcome;
        }
        return Outcome::kOk;
    };
    (void)store::read(*store_, store::kNewest, attempt);
    return all;
}

}  // namespace tfdb
