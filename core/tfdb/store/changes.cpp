// The effects of commits, from the feed and from the history.
#include <algorithm>
#include <bit>
#include <string>
#include <utility>

#include "tfdb/store/feed_notes.hpp"
#include "tfdb/store/validate.hpp"

namespace tfdb::store {
namespace {

using lookup::Outcome;
using txn::FeedNote;

/// Reads the effects of commits from the newest state and the remains of older states.
/// Threads: one. Guarantee: kLapped if a writer overtook it.
class ChangeReader {
public:
    ChangeReader(const Store& store, const StoreView& newest, const FeedNotes& notes,
                 const FrameFilter& filter)
        : store_(store), newest_(newest), notes_(notes), filter_(filter) {}

    [[nodiscard]] Outcome read(CommitNumber commit, Changes& out) {
        out = Changes{};
        out.commit = commit;
        touched_any_ = false;
        bool whole = true;
        std::vector<FrameId> made;
        notes_.for_each(commit, [&](std::uint64_t note, const std::string& removed) {
            whole = whole && read_note(commit, note, removed, made, out);
        });
        return whole ? Outcome::kOk : Outcome::kLapped;
    }
    /// Whether the last commit read touched the requested frames.
    [[nodiscard]] bool touched_any() const { return touched_any_; }

private:
    bool read_note(CommitNumber commit, std::uint64_t note, const std::string& removed,
                   std::vector<FrameId>& made, Changes& out) {
        const FrameId id = FeedNote::id(note);
        const unsigned what = FeedNote::what(note);
        if ((what & FeedNote::kRemoved) != 0) {
            if (!filter_.contains(removed))
                return true;
            touched_any_ = true;
            const auto own = std::find(made.begin(), made.end(), id);
            if (own != made.end())
                std::erase(out.made, removed);
            (own != made.end() ? out.passing : out.removed).push_back(removed);
            return true;
        }
        std::string name;
        if (!filter_.may_contain(id, newest_, commit))
            return true;
        if (!notes_.name_of(store_, newest_, id, commit, name))
            return false;
        if (!filter_.contains(name))
            return true;
        touched_any_ = true;
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
        edge.authority = store_.author_name(FeedNote::authority(note));
        return read_stored(id, commit, FeedNote::count(note), edge);
    }

    /// Reads the commit's samples from its own state, or what remains of them in the newest state.
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
            } else if (!notes_.name_of(store_, newest_, parents[i], commit,
                                       out.parents.emplace_back())) {
                return false;
            }
        }
        return true;
    }
    /// Reads the commit's samples from its own state, retrying if a writer overtakes it. False: the
    /// state is lost.
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

    /// At most `count` samples of one commit, greatest stamps first. False: overtaken.
    static bool collect(const StoreView& view, FrameId id, CommitNumber commit, std::uint64_t count,
                        std::vector<FrameId>& parents, Changes::Edge& out) {
        StoreEdge edge;
        if (!view.open(id, edge))
            return false;
        const auto take = [&](const history::SampleAt& at, const auto& slot) {
            parents.push_back(slot.parent);
            out.stamps.push_back(std::max(at.stamp, history::kNoStamp));
            out.poses.push_back(std::bit_cast<Pose>(slot.payload));
            out.is_static = at.stamp == history::kStaticStamp;
        };
        return visit_stored(edge, commit, count, take) && edge.confirm();
    }

    const Store& store_;
    const StoreView& newest_;
    const FeedNotes& notes_;
    const FrameFilter& filter_;
    bool touched_any_ = false;
};

}  // namespace

FrameFilter::FrameFilter(const Store& store, CommitNumber newest, Only only) : only_(only) {
    if (!only_)
        return;
    for (const std::string_view name : *only_) {
        check_may_exist(name, "no commit would ever touch it: the");
        names_.insert(name);
        if (const FrameId id = store.names.find(name, newest); id != kNoFrame)
            ids_.insert(id);
    }
}

bool has_feed(const Store& store) {
    const bool kept = StoreFeed(store.frames).is_kept();
    if (!kept && (store.shared == nullptr || !store.shared->frozen)) {
        throw NotSupported("the engine '" + std::string(concurrency_name(store.concurrency)) +
                           "' keeps no feed of changes: 'snapshot' and 'giant' do");
    }
    return kept;
}

void throw_future_commit(CommitNumber since, CommitNumber newest) {
    throw InvalidArgument("no commit " + std::to_string(since) + " yet: the newest is " +
                          std::to_string(newest));
}

void throw_lapped(const Store& store, CommitNumber since) {
    // Commit `floor` and later ones are kept: a caller that has the previous commit can continue.
    const CommitNumber oldest = StoreFeed(store.frames).floor().load_acquire() - 1;
    // Read after the floor: the view's commit may have left the feed by now.
    const CommitNumber newest = store.committed();
    // The oldest commit is overwritten next: at a writer's full speed it is gone before the caller
    // asks again. Half of the feed lies between this commit and the safe one.
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

}  // namespace tfdb::store

namespace tfdb {

std::vector<Changes> Buffer::changes(CommitNumber since, std::size_t limit,
                                     store::FrameFilter::Only only) const {
    using lookup::Outcome;
    const bool kept = store::has_feed(*store_);
    store::check_not_in_transaction(*store_);
    std::vector<Changes> all;
    store::FeedNotes notes;
    const auto attempt = [&](const StoreView& view) {
        all.clear();
        const CommitNumber newest = view.commit();
        if (since > newest)
            store::throw_future_commit(since, newest);
        if (since == newest || limit == 0)
            return Outcome::kOk;
        if (!kept)
            store::throw_lapped(*store_, since);
        const store::FrameFilter filter(*store_, newest, only);
        store::ChangeReader reader(*store_, view, notes, filter);
        const auto read = [&](CommitNumber last) {
            all.clear();
            for (CommitNumber commit = since + 1; commit <= last && all.size() < limit; ++commit) {
                const Outcome outcome = reader.read(commit, all.emplace_back());
                if (outcome != Outcome::kOk)
                    return outcome;
                if (!filter.is_for_all() && !reader.touched_any())
                    all.pop_back();
            }
            return all.size() < limit && last < newest ? Outcome::kLapped : Outcome::kOk;
        };
        return store::read_notes(*store_, notes, since, newest, limit, read);
    };
    (void)store::read(*store_, store::kNewest, attempt);
    return all;
}

}  // namespace tfdb
