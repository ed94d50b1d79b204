// Copies of an edge's samples in plain memory: for infos and dumps.
#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>
#include <limits>
#include <span>
#include <string>
#include <vector>

#include "tfdb/lookup/view.hpp"
#include "tfdb/store/store.hpp"

namespace tfdb::store {

/// The name of a frame of a state; false if its slot was reused meanwhile.
[[nodiscard]] inline bool read_name(const Store& store, const StoreView& view, FrameId id,
                                    std::string& name) {
    name = store.names.name(id);
    sync::fence_acquire();
    return view.alive(id);
}

/// Calls visit(id) for each frame of a state while it returns kOk; returns its last result.
template <class Visit>
[[nodiscard]] lookup::Outcome for_each_frame(const StoreView& view, Visit visit) {
    lookup::Outcome outcome = lookup::Outcome::kOk;
    for (FrameId id = 0; id < view.frame_count() && outcome == lookup::Outcome::kOk; ++id) {
        if (view.alive(id))
            outcome = visit(id);
    }
    return outcome;
}

/// One edge's visible samples in stamp order, each stamp once. A static edge has one pose and no
/// stamp.
struct Track {
    std::vector<StampNs> stamps;
    std::vector<Pose> poses;
    std::vector<FrameId> parents;
    std::vector<CommitNumber> commits;
    bool is_static = false;
};

/// A summary of an edge.
struct Outline {
    bool is_static = false;
    bool cleared = false;       // a clear removed its samples, and none came since
    history::Extent extent;     // a static pose has no stamp
    FrameId parent = kNoFrame;  // in the newest sample
    CommitNumber named = 0;     // commit of that sample
};

/// Calls visit(sample) for a moving edge: for the sample at or before `from`, for all up to `to`
/// and for the one after it, until `visit` returns false. False: overtaken.
template <class Edge, class Visit>
[[nodiscard]] bool visit_samples(const Edge& edge, StampNs from, StampNs to, Visit visit) {
    if constexpr (requires { edge.visit(from, to, visit); })
        return edge.visit(from, to, visit);
    else
        return edge.visit(from, to, 0, visit);
}

/// The summary of the edge's retained samples in the view. For a store's edge its cost does not
/// grow with the number of samples.
template <lookup::View V>
[[nodiscard]] lookup::Outcome outline(const V& view, FrameId id, Outline& out) {
    using lookup::Outcome;
    out = Outline{};
    typename V::Edge edge;
    if (!view.open(id, edge))
        return Outcome::kLapped;
    out.is_static = edge.is_static();
    out.cleared = edge.cleared();
    out.extent.samples = out.is_static ? 1 : 0;
    if (!edge.empty()) {
        const std::uint64_t newest = edge.slot_word(edge.newest());
        out.parent = history::SlotWord::parent(newest);
        out.named = history::SlotWord::commit(newest);
    }
    if (!edge.empty() && !out.is_static && !edge.extent(out.extent))
        return Outcome::kLapped;
    return edge.confirm() ? Outcome::kOk : Outcome::kLapped;
}

/// The samples of an edge in the view that visit(edge, take) passes to take(sample); of a static
/// edge, its pose.
template <lookup::View V, class Visit>
[[nodiscard]] lookup::Outcome collect(const V& view, FrameId id, Track& track, Visit visit) {
    using lookup::Outcome;
    track = Track{};
    typename V::Edge edge;
    if (!view.open(id, edge))
        return Outcome::kLapped;
    const auto push = [&](const history::SampleAt& sample) {
        const auto slot = edge.read(sample);
        track.poses.push_back(std::bit_cast<Pose>(slot.payload));
        track.parents.push_back(slot.parent);
        track.commits.push_back(slot.commit);
    };
    if (edge.is_static()) {
        track.is_static = true;
        push(edge.newest());
    } else if (!edge.empty()) {
        const auto take = [&](const history::SampleAt& sample) {
            track.stamps.push_back(sample.stamp);
            push(sample);
            return true;
        };
        if (!visit(edge, take))
            return Outcome::kLapped;
    }
    return edge.confirm() ? Outcome::kOk : Outcome::kLapped;
}

/// All retained samples of an edge in the view.
template <lookup::View V>
[[nodiscard]] lookup::Outcome collect_all(const V& view, FrameId id, Track& track) {
    return collect(view, id, track, [](const auto& edge, auto take) {
        return visit_samples(edge, std::numeric_limits<StampNs>::min() / 2, history::kForever,
                             take);
    });
}

/// The newest `count` samples of an edge in the view. Their number is the cost, not that of all.
[[nodiscard]] inline lookup::Outcome collect_newest(const StoreView& view, FrameId id,
                                                    const Outline& outline, std::size_t count,
                                                    Track& track) {
    if (count >= outline.extent.samples)
        return collect_all(view, id, track);
    return collect(view, id, track, [&](const auto& edge, auto take) {
        return edge.visit(outline.extent.last, history::kForever, static_cast<unsigned>(count - 1),
                          take);
    });
}

/// The indices of names in sorted order. Most names differ in the first bytes after their common
/// prefix.
[[nodiscard]] inline std::vector<std::uint32_t> order_of(std::span<const std::string> names) {
    struct Key {
        std::uint64_t bytes;
        std::uint32_t place;
    };
    std::size_t common = names.empty() ? 0 : names.front().size();
    for (const std::string& name : names) {
        const auto end = name.begin() + static_cast<std::ptrdiff_t>(std::min(common, name.size()));
        const auto apart = std::mismatch(name.begin(), end, names.front().begin()).first;
        common = static_cast<std::size_t>(apart - name.begin());
    }
    std::vector<Key> keys(names.size());
    for (std::size_t i = 0; i < names.size(); ++i) {
        keys[i].place = static_cast<std::uint32_t>(i);
        for (std::size_t k = 0; k < sizeof keys[i].bytes; ++k) {
            const std::size_t at = common + k;
            const char byte = at < names[i].size() ? names[i][at] : '\0';
            keys[i].bytes = keys[i].bytes << 8U | static_cast<unsigned char>(byte);
        }
    }
    std::sort(keys.begin(), keys.end(), [&](const Key& a, const Key& b) {
        return a.bytes != b.bytes ? a.bytes < b.bytes : names[a.place] < names[b.place];
    });
    std::vector<std::uint32_t> order;
    order.reserve(keys.size());
    for (const Key& key : keys)
        order.push_back(key.place);
    return order;
}

/// Fills in an edge's summary, without its parent's name. `Info`: FrameInfo or a row of
/// TreeColumns.
template <class Info>
void fill_from(const Outline& outline, Info& info) {
    info.is_static = outline.is_static;
    info.cleared = outline.cleared;
    info.samples = outline.extent.samples;
    info.oldest = outline.extent.first;
    info.newest = outline.extent.last;
    info.longest_gap = outline.extent.longest_gap;
}

}  // namespace tfdb::store
