// Finds the commits that touched some frames and paths, from the feed.
#pragma once

#include <algorithm>
#include <array>
#include <string>
#include <string_view>
#include <unordered_map>
#include <utility>
#include <vector>

#include "tfdb/store/feed_notes.hpp"
#include "tfdb/store/path_frames.hpp"
#include "tfdb/store/watch.hpp"

namespace tfdb::store {

/// For each subject of a watch, keeps the frames that it consists of in one state. A commit that
/// notes one of them touches the subject, whose frames are then recomputed in the state after that
/// commit. Every commit touches a subject that is missing there or depends on the stamp.
/// Threads: one at a time. Guarantee: as Watch.
template <class Store>
class BasicTouches {
    using Outcome = lookup::Outcome;

public:
    BasicTouches(const Store& store, const Watched& watched) : store_(store) {
        for (const std::string& name : watched.frames)
            subjects_.push_back({{name, {}}, Kind::kFrame});
        for (const auto& [target, source] : watched.pairs)
            subjects_.push_back({{target, source}, Kind::kPair});
        if (watched.every_commit)
            subjects_.push_back({{}, Kind::kEvery});
    }

    /// Finds the subjects' frames in the state of a commit, unless no commit touched them between
    /// that state and theirs. Throws InvalidArgument for a future commit.
    void begin(CommitNumber after) {
        if (const CommitNumber newest = store_.committed(); after > newest)
            throw_future_commit(after, newest);
        if (from_ <= after && after <= until_)
            return;
        from_ = 1;
        until_ = 0;
        frames_.clear();
        places_.clear();
        for (Subject& subject : subjects_)
            subject.frames.clear();
        for (Place place = 0; place < subjects_.size(); ++place)
            find(place, after);
        from_ = until_ = after;
    }
    /// All frames of the subjects, sorted, without duplicates.
    [[nodiscard]] const std::vector<FrameId>& frames() {
        if (frames_.empty()) {
            for (const auto& [frame, places] : places_)
                frames_.push_back(frame);
            std::sort(frames_.begin(), frames_.end());
        }
        return frames_;
    }
    /// The commits after `after`, up to `until`, touched no subject.
    void skip(CommitNumber after, CommitNumber until) {
        if (after <= until_)
            until_ = std::max(until_, until);
    }
    /// The later commits that touched a subject, at most `limit` of them. Throws FeedLapped.
    [[nodiscard]] std::vector<Touch> read(std::size_t limit) {
        // After an exception everything is recomputed.
        const CommitNumber from = std::exchange(from_, 1);
        const CommitNumber until = std::exchange(until_, 0);
        const CommitNumber newest = store_.committed();
        std::vector<Touch> all;
        CommitNumber last = until;
        for (std::uint64_t count = limit; last < newest && all.size() < limit; count *= 4) {
            count = std::min<std::uint64_t>(count, newest - last);
            const CommitNumber noted = last + count;
            if (!notes_.read(store_, last + 1, noted)) {
                if (!all.empty())
                    break;
                throw_lapped(store_, last);
            }
            while (last < noted && all.size() < limit) {
                if (std::vector<Place> what = touched_by(++last); !what.empty())
                    all.push_back({last, std::move(what)});
            }
        }
        from_ = all.empty() ? from : all.back().commit;
        until_ = last;
        return all;
    }

private:
    using Place = std::uint32_t;
    enum class Kind : std::uint8_t { kFrame, kPair, kEvery };
    struct Subject {
        std::array<std::string, 2> names;  // for a frame: only the first
        Kind kind;
        std::vector<FrameId> frames{};
    };

    [[nodiscard]] std::vector<Place> touched_by(CommitNumber commit) {
        using txn::FeedNote;
        std::vector<Place> hit;
        const auto add = [&](FrameId frame) {
            if (const auto found = places_.find(frame); found != places_.end())
                hit.insert(hit.end(), found->second.begin(), found->second.end());
        };
        add(kCommits);
        notes_.for_each(commit, [&](std::uint64_t note, const std::string&) {
            add(FeedNote::id(note));
            if ((FeedNote::what(note) & FeedNote::kMade) != 0)
                add(kBirths);
        });
        std::sort(hit.begin(), hit.end());
        hit.erase(std::unique(hit.begin(), hit.end()), hit.end());
        std::vector<Place> touched;
        for (const Place place : hit) {
            const bool was_missing = is_missing(subjects_[place]);
            find(place, commit);
            if (!was_missing || !is_missing(subjects_[place]))
                touched.push_back(place);
        }
        return touched;
    }
    [[nodiscard]] static bool is_missing(const Subject& subject) {
        return subject.frames.front() == kBirths;
    }
    void find(Place place, CommitNumber commit) {
        constexpr int kTries = 4;
        Subject& subject = subjects_[place];
        std::vector<FrameId> frames;
        Outcome outcome = Outcome::kLapped;
        for (int i = 0; i < kTries && outcome == Outcome::kLapped; ++i)
            outcome = find_in(store_.view(commit), subject, frames);
        if (outcome != Outcome::kOk)
            frames.assign(1, outcome == Outcome::kFailed ? kBirths : kCommits);
        if (frames == subject.frames)
            return;
        frames_.clear();
        for (const FrameId frame : frames)
            places_[frame].push_back(place);
        subject.frames.swap(frames);
        for (const FrameId frame : frames) {
            const auto found = places_.find(frame);
            // If a frame is in both lists, the older entry is removed.
            found->second.erase(std::find(found->second.begin(), found->second.end(), place));
            if (found->second.empty())
                places_.erase(found);
        }
    }
    /// kFailed: a frame is missing.
    template <class View>
    [[nodiscard]] Outcome find_in(const View& view, const Subject& subject,
                                  std::vector<FrameId>& frames) const {
        if (subject.kind == Kind::kEvery) {
            frames.assign(1, kCommits);
            return Outcome::kOk;
        }
        std::array<FrameId, 2> ids{};
        for (std::size_t i = 0; i < (subject.kind == Kind::kPair ? 2 : 1); ++i) {
            const Outcome outcome = find_named(view, subject.names[i], ids[i]);
            if (outcome != Outcome::kOk)
                return outcome;
        }
        if (subject.kind == Kind::kPair)
            return find_path(view, ids[0], ids[1], frames) ? Outcome::kOk : Outcome::kLapped;
        frames.assign(1, ids[0]);
        return Outcome::kOk;
    }
    /// The frame of that name in a state. kFailed: missing.
    template <class View>
    [[nodiscard]] Outcome find_named(const View& view, std::string_view name, FrameId& id) const {
        id = store_.names.find(name, view.commit());
        if (id == kNoFrame)
            return unless_reused(store_, view.commit(), Outcome::kFailed);
        return view.alive(id) ? Outcome::kOk : Outcome::kLapped;
    }

    const Store& store_;
    std::vector<Subject> subjects_;
    std::unordered_map<FrameId, std::vector<Place>> places_;  // no list is empty
    // The subjects' frames hold in these states: no commit after the first of them touched a
    // subject.
    CommitNumber from_ = 1;
    CommitNumber until_ = 0;  // less than `from_`: none are known
    FeedNotes notes_;
    std::vector<FrameId> frames_;  // empty: to be collected
};

}  // namespace tfdb::store
