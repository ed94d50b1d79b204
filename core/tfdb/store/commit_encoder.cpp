// Encodes commits from the feed, and states of snapshots, for other stores: see docs/wire.md.
#include <algorithm>
#include <bit>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "tfdb/store/collect.hpp"
#include "tfdb/store/feed_notes.hpp"
#include "tfdb/store/validate.hpp"
#include "tfdb/txn/frame_places.hpp"
#include "tfdb/wire/commit_sample.hpp"

namespace tfdb::store {
namespace {

using lookup::Outcome;
using txn::FeedNote;
using wire::CommitSample;
using wire::SampleWriter;

[[noreturn]] void throw_gone(const std::string& child, CommitNumber commit) {
    ErrorDetail detail;
    detail.edge = child;
    detail.commit = commit;
    throw Gone("samples that commit " + std::to_string(commit) + " stored of frame " +
                   quoted(child) +
                   " are no longer kept: take the state of a snapshot (state_bytes) and go on from "
                   "its commit, and hold a snapshot of the position that you have read up to",
               std::move(detail));
}

std::uint32_t choice_of(FrameFilter::Only only) {
    return only ? wire::digest_of(*only) : 0;
}

/// A sample being written, and the indices of its names and authorities.
/// Threads: one. Guarantee: none.
class Sample {
public:
    explicit Sample(const Store& store) : store_(store) { writer.start(); }

    /// The index of a frame's name; `name_of()` provides the name if the sample lacks it.
    template <class NameOf>
    [[nodiscard]] std::uint32_t place(FrameId id, NameOf name_of) {
        std::uint32_t place = places_.find(id);
        if (place == txn::FramePlaces::kNone) {
            place = writer.add_name(name_of());
            places_.set(id, place);
        }
        return place;
    }
    /// Call when another frame gets the slot.
    void forget(FrameId id) {
        if (places_.find(id) != txn::FramePlaces::kNone)
            places_.set(id, txn::FramePlaces::kNone);
    }
    /// The index of an authority, by its number in the store.
    [[nodiscard]] std::uint32_t authority(std::uint64_t number) {
        if (number == 0)
            return 0;
        const auto [found, is_new] = authorities_.try_emplace(number, 0);
        if (is_new)
            found->second = writer.add_authority(store_.author_name(number));
        return found->second;
    }

    SampleWriter writer;

private:
    const Store& store_;
    txn::FramePlaces places_;
    std::unordered_map<std::uint64_t, std::uint32_t> authorities_;
};

/// Adds commits to a sample, each by its net effect.
/// Threads: one. Guarantee: reads only; kLapped if writers overtook it.
class CommitEncoder {
public:
    /// For commits after `since`, up to `last`.
    CommitEncoder(const Store& store, const StoreView& newest, const FeedNotes& notes,
                  const FrameFilter& filter, CommitNumber since, CommitNumber last)
        : sample(store),
          store_(store),
          newest_(newest),
          notes_(notes),
          filter_(filter),
          first_(since + 1),
          last_(last),
          before_(since) {}

    /// Skips a commit that did not touch the requested frames. Throws Gone.
    [[nodiscard]] Outcome add(CommitNumber commit) {
        commit_ = commit;
        whole_ = true;
        for (auto* const list : {&cleared_, &removed_, &passing_, &made_})
            list->clear();
        edges_.clear();
        gone_.clear();
        bool any_gone = false;
        notes_.for_each(commit, [&](std::uint64_t note, const std::string&) {
            any_gone = any_gone || (FeedNote::what(note) & FeedNote::kRemoved) != 0;
        });
        if (any_gone)
            note_removals();
        notes_.for_each(commit, [&](std::uint64_t note, const std::string&) { add_note(note); });
        if (!whole_)
            return Outcome::kLapped;
        const bool any = !edges_.empty() || !cleared_.empty() || !removed_.empty() ||
                         !passing_.empty() || !made_.empty();
        if (any || filter_.is_for_all()) {
            sample.writer.start_commit(commit - before_, {cleared_, removed_, passing_, made_},
                                       edges_.size());
            before_ = commit;
            for (const auto& [id, edge, count] : edges_) {
                if (const Outcome outcome = add_edge(id, edge, count); outcome != Outcome::kOk)
                    return outcome;
            }
        }
        for (const FrameId id : gone_)
            sample.forget(id);
        return Outcome::kOk;
    }

    Sample sample;

private:
    struct NotedEdge {
        FrameId id;
        CommitSample::Edge edge;
        std::uint64_t count;
    };

    void note_removals() {
        made_here_.clear();
        notes_.for_each(commit_, [&](std::uint64_t note, const std::string& name) {
            const FrameId id = FeedNote::id(note);
            if ((FeedNote::what(note) & FeedNote::kMade) != 0) {
                sample.forget(id);
                made_here_.insert(id);
            }
            if ((FeedNote::what(note) & FeedNote::kRemoved) == 0)
                return;
            gone_.insert(id);
            const bool passed = made_here_.contains(id);
            // A copy of some frames may have other frames as parents: it needs the removal of
            // those.
            if (passed && !filter_.contains(name))
                return;
            (passed ? passing_ : removed_).push_back(sample.place(id, [&] { return name; }));
        });
    }
    void add_note(std::uint64_t note) {
        const FrameId id = FeedNote::id(note);
        const unsigned what = FeedNote::what(note);
        if (!whole_ || (what & FeedNote::kRemoved) != 0 ||
            !filter_.may_contain(id, newest_, commit_))
            return;
        if (gone_.contains(id))  // it was created or written, and is gone
            return;
        if ((what & FeedNote::kMade) != 0 && gone_.empty())
            sample.forget(id);
        if (!filter_.is_for_all()) {
            std::string name;
            whole_ = notes_.name_of(store_, newest_, id, commit_, name);
            if (!whole_ || !filter_.contains(name))
                return;
        }
        const std::uint32_t place = place_of(id);
        if ((what & FeedNote::kMade) != 0)
            made_.push_back(place);
        if ((what & FeedNote::kCleared) != 0)
            cleared_.push_back(place);
        if (FeedNote::count(note) != 0) {
            CommitSample::Edge edge;
            edge.child = place;
            edge.authority = sample.authority(FeedNote::authority(note));
            edges_.push_back({id, edge, FeedNote::count(note)});
        }
    }

    [[nodiscard]] std::uint32_t place_of(FrameId id) {
        return sample.place(id, [&] {
            std::string name;
            whole_ = notes_.name_of(store_, newest_, id, commit_, name) && whole_;
            return name;
        });
    }

    [[nodiscard]] Outcome add_edge(FrameId id, CommitSample::Edge edge, std::uint64_t count) {
        constexpr int kTries = 32;
        for (int tries = 0; tries < kTries; ++tries) {
            if (!take_rows(id, count, edge) && !read_rows(id, count, edge)) {
                check_kept(id);
                continue;
            }
            for (CommitSample::Row& row : rows_) {
                row.gone = gone_.contains(row.parent);
                row.parent = place_of(row.parent);
            }
            if (!whole_)
                return Outcome::kLapped;
            sample.writer.add_edge(edge, rows_);
            return Outcome::kOk;
        }
        return Outcome::kLapped;
    }
    /// An edge's samples of all encoded commits, as the last commit's state shows them.
    struct Rows {
        struct Stored {
            CommitNumber commit;
            CommitSample::Row row;
        };
        bool is_static = false;
        std::vector<Stored> rows;  // ordered by commit, then by stamp
        std::size_t next = 0;      // of the next commit
    };
    [[nodiscard]] Rows& rows_of(FrameId id) {
        const std::uint32_t place = rows_places_.find(id);
        if (place != txn::FramePlaces::kNone)
            return rows_by_edge_[place];
        rows_places_.set(id, static_cast<std::uint32_t>(rows_by_edge_.size()));
        Rows& found = rows_by_edge_.emplace_back();
        StoreEdge view;
        const auto take = [&](const history::SampleAt& at) {
            const auto slot = view.read(at);
            found.rows.push_back({slot.commit, row_of(at, slot)});
            return true;
        };
        if (!store_.view(last_).open(id, view) || !view.visit_since(first_, take) ||
            !view.confirm())
            found.rows.clear();
        found.is_static = view.is_static();
        std::reverse(found.rows.begin(), found.rows.end());
        const auto earlier = [](const auto& a, const auto& b) { return a.commit < b.commit; };
        if (!std::is_sorted(found.rows.begin(), found.rows.end(), earlier))
            std::stable_sort(found.rows.begin(), found.rows.end(), earlier);
        return found;
    }
    [[nodiscard]] static CommitSample::Row row_of(const history::SampleAt& at,
                                                  const history::SlotData<StoreMemory>& slot) {
        return {std::max<StampNs>(at.stamp, 0), slot.parent, false, slot.payload};
    }
    /// Takes the commit's samples if the last commit's state shows all of them. False: later
    /// commits replaced some, or the history no longer has them.
    [[nodiscard]] bool take_rows(FrameId id, std::uint64_t count, CommitSample::Edge& edge) {
        Rows& all = rows_of(id);
        rows_.clear();
        for (; all.next < all.rows.size() && all.rows[all.next].commit <= commit_; ++all.next) {
            if (all.rows[all.next].commit == commit_)
                rows_.push_back(all.rows[all.next].row);
        }
        edge.is_static = all.is_static;
        return rows_.size() == count;
    }
    /// Reads the commit's samples from its own state. False: overtaken, or no longer kept.
    [[nodiscard]] bool read_rows(FrameId id, std::uint64_t count, CommitSample::Edge& edge) {
        rows_.clear();
        StoreEdge view;
        if (!store_.view(commit_).open(id, view))
            return false;
        const auto take = [&](const history::SampleAt& at, const auto& slot) {
            rows_.push_back(row_of(at, slot));
        };
        if (!visit_stored(view, commit_, count, take))
            return false;
        edge.is_static = view.is_static();
        std::reverse(rows_.begin(), rows_.end());
        // Readers do not need samples that were outside the history in that state.
        const bool may_miss = rows_.empty() || (rows_.size() < count && view.may_miss());
        return view.confirm() && !may_miss;
    }
    /// Throws Gone if the commit's state can no longer be read.
    void check_kept(FrameId id) {
        sync::fence_acquire();
        const auto since = [&](history::HeaderWord w) {
            return store_.frames.word(id, w).load_relaxed();
        };
        if (store_.memory.reclaimed(memory::Line::kEnded).load_relaxed() > commit_ ||
            since(history::kForgotten) > commit_ || since(history::kCorrected) > commit_ ||
            store_.frames.born(id) > commit_) {
            std::string name;
            (void)notes_.name_of(store_, newest_, id, commit_, name);
            throw_gone(name, commit_);
        }
    }

    const Store& store_;
    const StoreView& newest_;
    const FeedNotes& notes_;
    const FrameFilter& filter_;
    CommitNumber first_;
    CommitNumber last_;
    CommitNumber before_;  // the last one added
    CommitNumber commit_ = 0;
    bool whole_ = true;
    std::vector<std::uint32_t> cleared_;
    std::vector<std::uint32_t> removed_;
    std::vector<std::uint32_t> passing_;
    std::vector<std::uint32_t> made_;
    std::vector<NotedEdge> edges_;
    txn::FrameList gone_;
    txn::FrameList made_here_;
    std::vector<CommitSample::Row> rows_;
    std::vector<Rows> rows_by_edge_;
    txn::FramePlaces rows_places_;
};

/// The state of a snapshot as a sample, with frames ordered by name.
/// Threads: one. Guarantee: none.
class StateEncoder {
public:
    StateEncoder(const Store& store, CommitNumber held, FrameFilter::Only only, std::size_t newest,
                 const Position* as)
        : store_(store),
          held_(held),
          filter_(store, held, only),
          choice_(choice_of(only)),
          newest_(newest),
          epoch_(as == nullptr ? store.epoch() : as->epoch),
          commit_(as == nullptr ? held : as->commit),
          sample_(store) {}

    [[nodiscard]] std::vector<std::byte> run() {
        find_frames();
        for (std::uint32_t place = 0; place < frames_.size(); ++place)
            places_.emplace(frames_[place].id, sample_.writer.add_name(frames_[place].name));
        for (const Frame& frame : frames_)
            add(frame);
        return sample_.writer.finish(CommitSample::Kind::kState, epoch_, choice_, commit_, commit_,
                                     frames_.size());
    }

private:
    struct Frame {
        std::string name;
        FrameId id;
    };
    /// Throws SnapshotTooOld.
    template <class Attempt>
    void read(Attempt attempt) const {
        interruption_point();
        (void)store::read(store_, held_, attempt);
    }

    void find_frames() {
        read([&](const StoreView& view) {
            frames_.clear();
            const Outcome outcome = for_each_frame(view, [&](FrameId id) {
                std::string name;
                if (!read_name(store_, view, id, name))
                    return Outcome::kLapped;
                if (filter_.contains(name))
                    frames_.push_back({std::move(name), id});
                return Outcome::kOk;
            });
            return unless_reused(store_, view.commit(), outcome);
        });
        std::sort(frames_.begin(), frames_.end(),
                  [](const Frame& a, const Frame& b) { return a.name < b.name; });
    }

    void add(const Frame& frame) {
        Outline outline;
        std::uint64_t late = 0;
        std::uint64_t authority = 0;
        read([&](const StoreView& view) {
            late = store_.frames.word(frame.id, history::kLate).load_relaxed();
            authority = store_.frames.word(frame.id, history::kAuthority).load_relaxed();
            Outcome outcome = store::outline(view, frame.id, outline);
            if (outcome == Outcome::kOk)
                outcome = collect_newest(view, frame.id, outline, newest_, track_);
            return view.alive(frame.id) ? outcome : Outcome::kLapped;
        });
        CommitSample::Edge edge;
        edge.child = places_.at(frame.id);
        edge.authority = sample_.authority(authority);
        edge.is_static = track_.is_static;
        edge.cleared = outline.cleared;
        edge.late = late;
        rows_.clear();
        const std::size_t all = track_.poses.size();
        for (std::size_t i = all - std::min(all, newest_); i < all; ++i)
            rows_.push_back(row(i));
        sample_.writer.add_frame(edge, rows_);
    }
    [[nodiscard]] CommitSample::Row row(std::size_t i) {
        CommitSample::Row row;
        row.stamp = track_.is_static ? 0 : track_.stamps[i];
        row.numbers = std::bit_cast<std::array<std::uint64_t, 7>>(track_.poses[i]);
        read([&](const StoreView& view) {
            const FrameId parent = track_.parents[i];
            if (const auto found = places_.find(parent);
                found != places_.end() && view.alive_since(parent, track_.commits[i])) {
                row.parent = found->second;
                return Outcome::kOk;
            }
            row.gone = true;
            if (filter_.is_for_all() || !view.alive_since(parent, track_.commits[i]))
                return Outcome::kOk;
            std::string name = store_.names.name(parent);
            sync::fence_acquire();
            if (!view.alive_since(parent, track_.commits[i]))
                return Outcome::kLapped;
            row.gone = false;
            row.parent = sample_.writer.add_name(name);
            places_.insert_or_assign(parent, row.parent);
            return Outcome::kOk;
        });
        return row;
    }

    const Store& store_;
    CommitNumber held_;
    FrameFilter filter_;
    std::uint32_t choice_;
    std::size_t newest_;  // at most this many samples per edge
    Epoch epoch_;
    CommitNumber commit_;
    Sample sample_;
    std::vector<Frame> frames_;
    std::unordered_map<FrameId, std::uint32_t> places_;
    Track track_;
    std::vector<CommitSample::Row> rows_;
};

}  // namespace

std::vector<std::byte> state_bytes(const Store& store, CommitNumber held, FrameFilter::Only only,
                                   std::size_t newest, const Position* as) {
    return StateEncoder(store, held, only, newest, as).run();
}

}  // namespace tfdb::store

namespace tfdb {

std::vector<std::byte> Buffer::commits_bytes(
    CommitNumber since, SampleLimits limits,
    std::optional<std::span<const std::string_view>> only) const {
    using lookup::Outcome;
    const bool kept = store::has_feed(*store_);
    store::check_not_in_transaction(*store_);
    const std::uint32_t choice = store::choice_of(only);
    std::vector<std::byte> bytes;
    store::FeedNotes notes;
    const auto attempt = [&](const StoreView& view) {
        bytes.clear();
        const CommitNumber newest = view.commit();
        if (since > newest)
            store::throw_future_commit(since, newest);
        if (since == newest)
            return Outcome::kOk;
        if (!kept)
            store::throw_lapped(*store_, since);
        const store::FrameFilter filter(*store_, newest, only);
        const auto encode = [&](CommitNumber last) {
            store::CommitEncoder encoder(*store_, view, notes, filter, since, last);
            auto& writer = encoder.sample.writer;
            CommitNumber commit = since;
            bool full = false;
            while (!full && commit < last) {
                const auto before = writer.mark();
                if (const Outcome outcome = encoder.add(commit + 1); outcome != Outcome::kOk)
                    return outcome;
                const bool too_large = writer.commits() > 1 && writer.size() > limits.bytes;
                if (too_large)
                    writer.cut(before);
                else
                    ++commit;
                full = too_large || writer.commits() == limits.commits;
            }
            if (!full && last < newest)
                return Outcome::kLapped;
            bytes = writer.finish(wire::CommitSample::Kind::kCommits, store_->epoch(), choice,
                                  since, commit);
            return Outcome::kOk;
        };
        return store::read_notes(*store_, notes, since, newest, limits.commits, encode);
    };
    (void)store::read(*store_, store::kNewest, attempt);
    return bytes;
}

std::vector<std::byte> Snapshot::state_bytes(std::optional<std::span<const std::string_view>> only,
                                             std::size_t newest, const Position* as) const {
    return store::state_bytes(*store_, held_, only, newest, as);
}

}  // namespace tfdb
