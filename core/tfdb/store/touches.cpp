#include "tfdb/store/touches.hpp"

#include <algorithm>
#include <string_view>

namespace tfdb::store {

using lookup::Outcome;
using txn::FeedNote;

namespace {

/// The frame of that name in a state. kFailed: it has none.
Outcome find_named(const Store& store, const StoreView& view, std::string_view name, FrameId& id) {
    id = store.names.find(name, view.commit());
    if (id == kNoFrame)
        return unless_reused(store, view.commit(), Outcome::kFailed);
    return view.alive(id) ? Outcome::kOk : Outcome::kLapped;
}

}  // namespace

Touches::Touches(const Store& store, const Watched& watched) : store_(store) {
    for (const std::string& name : watched.frames)
        subjects_.push_back({{name, {}}, Kind::kFrame});
    for (const auto& [target, source] : watched.pairs)
        subjects_.push_back({{target, source}, Kind::kPair});
    if (watched.every_commit)
        subjects_.push_back({{}, Kind::kEvery});
}

void Touches::begin(CommitNumber after) {
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

void Touches::skip(CommitNumber after, CommitNumber until) {
    if (after <= until_)
        until_ = std::max(until_, until);
}

std::vector<Touch> Touches::read(std::size_t limit) {
    // After an exception all is found anew.
    const CommitNumber from = std::exchange(from_, 1);
    const CommitNumber until = std::exchange(until_, 0);
    const CommitNumber newest = store_.committed();
    if (until < newest && !notes_.read(store_, until + 1, newest))
        throw_lapped(store_, until);
    std::vector<Touch> all;
    CommitNumber last = until;
    while (last < newest && all.size() < limit) {
        if (std::vector<Place> what = judge(++last); !what.empty())
            all.push_back({last, std::move(what)});
    }
    from_ = all.empty() ? from : all.back().commit;
    until_ = last;
    return all;
}

const std::vector<FrameId>& Touches::frames() {
    if (frames_.empty()) {
        for (const auto& [frame, places] : places_)
            frames_.push_back(frame);
        std::sort(frames_.begin(), frames_.end());
    }
    return frames_;
}

std::vector<Touches::Place> Touches::judge(CommitNumber commit) {
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

bool Touches::is_missing(const Subject& subject) {
    return subject.frames.front() == kBirths;
}

void Touches::find(Place place, CommitNumber commit) {
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
        // Where a frame is in both, the older entry goes.
        found->second.erase(std::find(found->second.begin(), found->second.end(), place));
        if (found->second.empty())
            places_.erase(found);
    }
}

/// kFailed: a frame is missing.
Outcome Touches::find_in(const StoreView& view, const Subject& subject,
                         std::vector<FrameId>& frames) const {
    if (subject.kind == Kind::kEvery) {
        frames.assign(1, kCommits);
        return Outcome::kOk;
    }
    std::array<FrameId, 2> ids{};
    for (std::size_t i = 0; i < (subject.kind == Kind::kPair ? 2 : 1); ++i) {
        const Outcome outcome = find_named(store_, view, subject.names[i], ids[i]);
        if (outcome != Outcome::kOk)
            return outcome;
    }
    if (subject.kind == Kind::kPair)
        return find_path(view, ids[0], ids[1], frames) ? Outcome::kOk : Outcome::kLapped;
    frames.assign(1, ids[0]);
    return Outcome::kOk;
}

}  // namespace tfdb::store
