// The reads of a transaction, kept as the changes that would alter its answers.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <unordered_set>
#include <utility>
#include <vector>

#include "tfdb/graph/frames.hpp"
#include "tfdb/graph/names.hpp"
#include "tfdb/history/edge_changes.hpp"
#include "tfdb/txn/child_index.hpp"
#include "tfdb/txn/frame_places.hpp"

namespace tfdb::txn {

/// Why a read is outdated.
struct ReadConflict {
    enum Kind : std::uint8_t {
        kNone,
        kEdge,      // with `change`
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

/// Frames, edges, names and child lists on which answers depend. An edge's reads are ranges of
/// stamps: a read between two past samples does not conflict with an append.
/// Threads: one. Guarantee: `validate` never misses a change; it requires that no writer is active.
class ReadSet {
public:
    void clear() {
        noted_ = 0;
        places_.clear();
        absent_.clear();
        children_.clear();
        every_frame_ = false;
    }
    /// Whether it is worth keeping for the next transaction.
    [[nodiscard]] bool is_small() const {
        return frames_.size() <= kMostKept && absent_.bucket_count() <= kMostKept;
    }

    /// Records that the frame exists. Returns its stable position.
    std::size_t note_frame(FrameId id, std::uint32_t generation) {
        if (last_ < noted_ && frames_[last_].id == id)
            return last_;
        std::uint32_t place = places_.find(id);
        if (place == FramePlaces::kNone) {
            place = static_cast<std::uint32_t>(noted_);
            if (noted_ == frames_.size())
                frames_.emplace_back();
            places_.set(id, place);
            frames_[noted_++].start(id, generation);
        }
        last_ = place;
        return last_;
    }
    /// Records a read of the frame's edge: a clear or a static pose would change it.
    void note_edge(std::size_t place) { frames_[place].edge = true; }
    /// Records a range: a new sample within the stamps, ends included, would change the read.
    void note_range(std::size_t place, history::StampRange range) {
        if (range.from <= range.to)
            add(frames_[place].ranges, range);
    }
    void note_all(std::size_t place) { note_range(place, {}); }
    /// Records a used sample: its eviction would change the read.
    void note_used(std::size_t place, clock::StampNs stamp) {
        clock::StampNs& lowest = frames_[place].lowest;
        if (stamp >= 0 && (lowest < 0 || stamp < lowest))
            lowest = stamp;
    }
    /// Records that all existing frames were noted: another frame would change the read.
    void note_every_frame() { every_frame_ = true; }
    void note_absent(std::string_view name) { absent_.emplace(name); }
    /// Records the frame's children by newest parents, ascending; an empty list needs no search at
    /// the end.
    void note_children(FrameId id, std::vector<FrameId> children) {
        children_.emplace_back(id, std::move(children));
    }

    /// Whether commit `now` differs from commit `since` in any recorded read. `edges` false:
    /// compares only frames, names and children.
    template <class Memory>
    [[nodiscard]] ReadConflict validate(const graph::Frames<Memory>& frames, clock::StampNs history,
                                        CommitNumber since, CommitNumber now, bool edges) const {
        for (const Frame& frame : std::span(frames_).first(noted_)) {
            const bool same =
                frames.generation(frame.id) == frame.generation && frames.alive(frame.id, now);
            if (!same)
                return {ReadConflict::kRemoved, frame.id, {}, {}};
            if (!edges || !frame.edge)
                continue;
            const history::EdgeChanges<Memory> changes(frames.memory(), frames.header(frame.id),
                                                       since, history);
            const history::EdgeChange change = changes.find(frame.ranges, frame.lowest);
            if (change)
                return {ReadConflict::kEdge, frame.id, {}, change};
        }
        const graph::Names<Memory> names(frames);
        for (const std::string& name : absent_) {
            const FrameId found = names.find(name, now);
            if (found != kNoFrame)
                return {ReadConflict::kNewName, found, name, {}};
        }
        for (FrameId id = 0; every_frame_ && id < frames.count(); ++id) {
            if (frames.alive(id, now) && places_.find(id) == FramePlaces::kNone)
                return {ReadConflict::kNewName, id, names.name(id), {}};
        }
        return validate_children(frames, history, now);
    }

private:
    struct Frame {
        FrameId id = kNoFrame;
        std::uint32_t generation = 0;
        bool edge = false;
        clock::StampNs lowest = history::kNoStamp;  // stamp of the oldest used sample
        std::vector<history::StampRange> ranges;    // sorted, disjoint

        void start(FrameId of, std::uint32_t its_generation) {
            id = of;
            generation = its_generation;
            edge = false;
            lowest = history::kNoStamp;
            ranges.clear();
        }
    };
    static constexpr std::size_t kMostRanges = 64;  // beyond, neighbours are merged
    static constexpr std::size_t kMostKept = 256;

    static void add(std::vector<history::StampRange>& ranges, history::StampRange range) {
        const auto first = std::lower_bound(
            ranges.begin(), ranges.end(), range.from,
            [](const history::StampRange& r, clock::StampNs s) { return r.to < s; });
        auto last = first;
        for (; last != ranges.end() && last->from <= range.to; ++last) {
            range.from = std::min(range.from, last->from);
            range.to = std::max(range.to, last->to);
        }
        if (first == last) {
            ranges.insert(first, range);
        } else {
            *first = range;
            ranges.erase(first + 1, last);
        }
        if (ranges.size() <= kMostRanges)
            return;
        std::size_t kept = 0;
        for (std::size_t i = 0; i < ranges.size(); i += 2, ++kept)
            ranges[kept] = {ranges[i].from, ranges[std::min(i + 1, ranges.size() - 1)].to};
        ranges.resize(kept);
    }

    template <class Memory>
    [[nodiscard]] ReadConflict validate_children(const graph::Frames<Memory>& frames,
                                                 clock::StampNs history, CommitNumber now) const {
        ChildIndex index;
        bool built = false;
        std::vector<FrameId> found;
        for (const auto& [id, children] : children_) {
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

    std::vector<Frame> frames_;  // entries beyond `noted_` are kept for reuse
    std::size_t noted_ = 0;
    FramePlaces places_;
    std::size_t last_ = 0;
    std::unordered_set<std::string> absent_;
    std::vector<std::pair<FrameId, std::vector<FrameId>>> children_;
    bool every_frame_ = false;
};

}  // namespace tfdb::txn
