// What a transaction has read, kept as what would have to change for its answers to change.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "tfdb/graph/frames.hpp"
#include "tfdb/graph/names.hpp"
#include "tfdb/history/edge_changes.hpp"
#include "tfdb/txn/child_index.hpp"
#include "tfdb/txn/frame_places.hpp"

namespace tfdb::txn {

/// Why what was read is no longer so.
struct ReadConflict {
    enum Kind : std::uint8_t {
        kNone,
        kEdge,      // `change` says how
        kRemoved,   // the frame
        kNewName,   // a frame of `name`, which did not exist
        kChildren,  // the frame has other children
    };
    Kind kind = kNone;
    FrameId frame = kNoFrame;
    std::string name;
    history::EdgeChange change;

    [[nodiscard]] explicit operator bool() const { return kind != kNone; }
};

/// Frames, edges, names and lists of children that answers depend on. An edge is noted as ranges of
/// stamps: a read between two samples of the past does not mind what is appended.
/// Threads: one. Guarantee: `validate` never misses a change; it wants all writers held off.
class ReadSet {
public:
    void clear() {
        frames_.clear();
        places_.clear();
        last_ = 0;
        ranges_.clear();
        most_ranges_ = kFewRanges;
        absent_.clear();
        absent_names_.clear();
        most_absent_ = kFewNames;
        listings_.clear();
    }
    /// Whether it takes little memory, cleared.
    [[nodiscard]] bool is_small() const {
        return frames_.capacity() <= 1024 && places_.capacity() <= 2048 &&
               ranges_.capacity() <= 2 * kFewRanges && absent_.capacity() <= 2 * kFewNames &&
               absent_names_.capacity() <= 64 * kFewNames && listings_.capacity() <= 64;
    }

    /// The frame exists. Returns its place, which stays.
    std::size_t note_frame(FrameId id, std::uint32_t generation) {
        if (last_ < frames_.size() && frames_[last_].id == id)
            return last_;
        std::uint32_t place = places_.find(id);
        if (place == FramePlaces::kNone) {
            place = static_cast<std::uint32_t>(frames_.size());
            frames_.push_back({id, generation, history::kNoStamp, kNoRange, false});
            places_.set(id, place);
        }
        last_ = place;
        return place;
    }
    /// The frame's edge was looked at: that it was cleared or stored static would show.
    void note_edge(std::size_t place) { frames_[place].edge = true; }
    /// A new sample within the stamps, ends included, would show.
    void note_range(std::size_t place, history::StampRange range) {
        if (range.from > range.to)
            return;
        Frame& frame = frames_[place];
        if (frame.range != kNoRange) {
            history::StampRange& last = ranges_[frame.range].stamps;
            if (range.from <= last.to && last.from <= range.to) {
                last = {std::min(range.from, last.from), std::max(range.to, last.to)};
                return;
            }
        }
        if (ranges_.size() >= most_ranges_) {
            merge_ranges();
            most_ranges_ = 2 * ranges_.size() + kFewRanges;
        }
        frame.range = ranges_.size();
        ranges_.push_back({static_cast<std::uint32_t>(place), range});
    }
    void note_all(std::size_t place) { note_range(place, {}); }
    /// A sample was used: that it is no longer retained would show.
    void note_used(std::size_t place, clock::StampNs stamp) {
        clock::StampNs& lowest = frames_[place].lowest;
        if (stamp >= 0 && (lowest < 0 || stamp < lowest))
            lowest = stamp;
    }
    void note_absent(std::string_view name) {
        if (!absent_.empty() && name_of(absent_.back()) == name)
            return;
        if (absent_.size() >= most_absent_) {
            merge_absent();
            most_absent_ = 2 * absent_.size() + kFewNames;
        }
        absent_.push_back({absent_names_.size(), name.size()});
        absent_names_ += name;
    }
    /// The frame's children by newest parents, ascending; none needs no search at the end.
    void note_children(FrameId id, std::vector<FrameId> children) {
        listings_.emplace_back(id, std::move(children));
    }

    /// Whether commit `now` differs from commit `since` in anything that was read. `edges` false:
    /// only frames, names and children are asked for.
    template <class Memory>
    [[nodiscard]] ReadConflict validate(const graph::Frames<Memory>& frames, clock::StampNs history,
                                        CommitNumber since, CommitNumber now, bool edges) {
        merge_ranges();
        for (const Frame& frame : frames_) {
            const bool same =
                frames.generation(frame.id) == frame.generation && frames.alive(frame.id, now);
            if (!same)
                return {ReadConflict::kRemoved, frame.id, {}, {}};
            if (!edges || !frame.edge)
                continue;
            const history::EdgeChanges<Memory> changes(frames.memory(), frames.header(frame.id),
                                                       since, history);
            const history::EdgeChange change = changes.find(ranges_of(frame), frame.lowest);
            if (change)
                return {ReadConflict::kEdge, frame.id, {}, change};
        }
        const graph::Names<Memory> names(frames);
        for (const Absent& absent : absent_) {
            const FrameId found = names.find(name_of(absent), now);
            if (found != kNoFrame)
                return {ReadConflict::kNewName, found, std::string(name_of(absent)), {}};
        }
        return validate_children(frames, history, now);
    }

private:
    static constexpr std::size_t kNoRange = ~std::size_t{0};
    struct Frame {
        FrameId id;
        std::uint32_t generation;
        clock::StampNs lowest;  // stamp that was used
        std::size_t range;      // the last that was noted of it; merged: its first
        bool edge;
    };
    struct Range {
        std::uint32_t place;
        history::StampRange stamps;
    };
    struct Absent {  // a name
        std::size_t at;
        std::size_t length;
    };
    static constexpr std::size_t kMostRanges = 64;  // of a frame; beyond, neighbours become one
    static constexpr std::size_t kFewRanges = 1024;
    static constexpr std::size_t kFewNames = 64;

    [[nodiscard]] std::string_view name_of(const Absent& absent) const {
        return std::string_view(absent_names_).substr(absent.at, absent.length);
    }
    void merge_absent() {
        std::sort(absent_.begin(), absent_.end(),
                  [&](const Absent& a, const Absent& b) { return name_of(a) < name_of(b); });
        std::string names;
        std::size_t kept = 0;
        for (const Absent& absent : absent_) {
            const std::string_view name = name_of(absent);
            if (kept > 0 && std::string_view(names).substr(absent_[kept - 1].at) == name)
                continue;
            const std::size_t at = names.size();
            names += name;
            absent_[kept++] = {at, name.size()};
        }
        absent_.resize(kept);
        absent_names_.swap(names);
    }

    /// Puts those of each frame one after another, ascending and apart.
    void merge_ranges() {
        std::sort(ranges_.begin(), ranges_.end(), [](const Range& a, const Range& b) {
            return a.place != b.place ? a.place < b.place : a.stamps.from < b.stamps.from;
        });
        std::size_t kept = 0;
        for (std::size_t first = 0, end = 0; first < ranges_.size(); first = end) {
            const std::size_t start = kept;
            for (; end < ranges_.size() && ranges_[end].place == ranges_[first].place; ++end) {
                const history::StampRange next = ranges_[end].stamps;
                history::StampRange* const last =
                    kept > start ? &ranges_[kept - 1].stamps : nullptr;
                if (last != nullptr && next.from <= last->to)
                    last->to = std::max(last->to, next.to);
                else
                    ranges_[kept++] = ranges_[end];
            }
            while (kept - start > kMostRanges)
                kept = join_neighbours(start, kept);
            frames_[ranges_[start].place].range = start;
        }
        ranges_.resize(kept);
    }
    std::size_t join_neighbours(std::size_t start, std::size_t end) {
        std::size_t kept = start;
        for (std::size_t i = start; i < end; i += 2, ++kept) {
            ranges_[kept] = ranges_[i];
            ranges_[kept].stamps.to = ranges_[std::min(i + 1, end - 1)].stamps.to;
        }
        return kept;
    }
    /// After `merge_ranges`.
    [[nodiscard]] std::span<const history::StampRange> ranges_of(const Frame& frame) {
        const auto place = static_cast<std::uint32_t>(&frame - frames_.data());
        of_one_.clear();
        for (std::size_t i = frame.range; i < ranges_.size() && ranges_[i].place == place; ++i)
            of_one_.push_back(ranges_[i].stamps);
        return of_one_;
    }

    template <class Memory>
    [[nodiscard]] ReadConflict validate_children(const graph::Frames<Memory>& frames,
                                                 clock::StampNs history, CommitNumber now) const {
        ChildIndex index;
        bool built = false;
        std::vector<FrameId> found;
        for (const auto& [id, children] : listings_) {
            found.clear();
            const bool any = frames.word(id, history::kChildren).load_relaxed() != 0;
            if (any && !built) {
                built = index.build(SnapshotView<Memory>(frames, now, history));
                if (!built)
                    return {ReadConflict::kChildren, id, {}, {}};
            }
            if (any)
                index.append_children(id, found);
            if (found != children)
                return {ReadConflict::kChildren, id, {}, {}};
        }
        return {};
    }

    std::vector<Frame> frames_;
    FramePlaces places_;
    std::size_t last_ = 0;
    std::vector<Range> ranges_;
    std::vector<history::StampRange> of_one_;
    std::vector<Absent> absent_;
    std::string absent_names_;
    std::vector<std::pair<FrameId, std::vector<FrameId>>> listings_;
    std::size_t most_ranges_ = kFewRanges;  // before they are merged
    std::size_t most_absent_ = kFewNames;
};

}  // namespace tfdb::txn
