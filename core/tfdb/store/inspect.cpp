// Inspection of frames and their samples.
#include <algorithm>
#include <unordered_map>
#include <utility>

#include "tfdb/store/collect.hpp"
#include "tfdb/store/nearest.hpp"
#include "tfdb/store/raise.hpp"
#include "tfdb/store/store.hpp"

namespace tfdb {

using lookup::Outcome;

namespace {

/// Whether a frame that is missing in this state may have existed in it: its slot may be reused.
bool may_be_reused(const store::Store& store, const StoreView& view) {
    return store::unless_reused(store, view.commit(), Outcome::kFailed) == Outcome::kLapped;
}

Outcome fill_info(const store::Store& store, const StoreView& view, FrameId id, FrameInfo& info) {
    info = FrameInfo{};
    info.authority = store.author(id);
    info.late = store.frames.word(id, history::kLate).load_relaxed();
    store::Outline outline;
    const Outcome outcome = store::outline(view, id, outline);
    if (outcome != Outcome::kOk)
        return outcome;
    store::fill_from(outline, info);
    if (outline.parent != kNoFrame) {
        if (!view.alive_since(outline.parent, outline.named)) {
            if (may_be_reused(store, view))
                return Outcome::kLapped;
        } else if (!store::read_name(store, view, outline.parent, info.parent.emplace())) {
            return Outcome::kLapped;
        }
    }
    return store::read_name(store, view, id, info.name) ? Outcome::kOk : Outcome::kLapped;
}

/// One walk of a Reach: from a frame up to `goal`, a root, or an edge without data.
Outcome climb(const StoreView& view, FrameId goal, FrameId& frame, bool& at_gap, Reach& reach) {
    at_gap = false;
    for (FrameId steps = 0; frame != goal && steps <= view.frame_count(); ++steps) {
        StoreEdge edge;
        if (!view.open(frame, edge))
            return Outcome::kLapped;
        history::SampleAt oldest;
        const bool moves = !edge.empty() && !edge.is_static();
        if (moves && !edge.oldest(oldest))
            return Outcome::kLapped;
        const StampNs newest = moves ? edge.newest().stamp : -1;
        const bool cleared = edge.cleared();
        if (!edge.confirm())
            return Outcome::kLapped;
        const bool anywhere = !moves || (reach.stamp == 0 && oldest.stamp > 0);
        if (cleared || (!anywhere && (reach.stamp < oldest.stamp || reach.stamp > newest))) {
            at_gap = true;
            reach.oldest = oldest.stamp;
            reach.newest = newest;
            return Outcome::kOk;
        }
        FrameId parent = kNoFrame;
        const Outcome found = lookup::parent_at(
            view, frame, anywhere ? std::nullopt : std::optional(reach.stamp), parent);
        if (found != Outcome::kOk || parent == kNoFrame)
            return found;
        frame = parent;
    }
    return Outcome::kOk;
}

Outcome walk_both(const store::Store& store, const StoreView& view, FrameId target, FrameId source,
                  Reach& reach) {
    FrameId top = source;
    bool source_at_gap = false;
    bool at_gap = false;
    reach.end = Reach::kMet;
    Outcome outcome = climb(view, target, top, source_at_gap, reach);
    if (outcome != Outcome::kOk || top == target)
        return outcome;
    FrameId end = target;
    outcome = climb(view, top, end, at_gap, reach);
    if (outcome != Outcome::kOk || end == top || end == source)
        return outcome;
    reach.end = at_gap || source_at_gap ? Reach::kGap : Reach::kApart;
    if (reach.end == Reach::kGap && !store::read_name(store, view, at_gap ? end : top, reach.edge))
        return Outcome::kLapped;
    return Outcome::kOk;
}

/// Runs `attempt(view, id)` on the frame of that name, as store::read. Throws UnknownFrame.
template <class Attempt>
void read_frame(const store::Store& store, CommitNumber held, std::string_view name,
                Attempt attempt) {
    CommitNumber at = 0;
    const bool found = store::read(store, held, [&](const StoreView& view) {
        at = view.commit();
        const FrameId id = store.names.find(name, at);
        return id == kNoFrame ? Outcome::kFailed : attempt(view, id);
    });
    if (!found)
        store::throw_unknown_frame(name, at, store::did_you_mean(store, at, name));
}

/// The result of lookup::parent_at for each frame, by id.
Outcome all_parents(const StoreView& view, StampNs stamp, std::vector<FrameId>& parents) {
    std::vector<lookup::NearestParent> nearest(view.frame_count());
    const Outcome outcome = store::for_each_frame(view, [&](FrameId id) {
        return id < nearest.size() ? lookup::nearest_parent_at(view, id, stamp, nearest[id])
                                   : Outcome::kOk;
    });
    std::vector<FrameId> first(nearest.size(),
                               kNoFrame);  // the frame whose walk visited this one first
    const auto above = [&](FrameId id) {
        return nearest[id].parent < nearest.size() ? nearest[id].parent : kNoFrame;
    };
    for (FrameId id = 0; id < nearest.size(); ++id) {
        FrameId at = id;
        for (; at != kNoFrame && first[at] == kNoFrame; at = above(at))
            first[at] = id;
        if (at == kNoFrame || first[at] != id)
            continue;
        for (FrameId next = above(at); next != kNoFrame;) {  // a cycle: walk it once
            const FrameId after = above(next);
            if (nearest[next].later)
                nearest[next].parent = kNoFrame;
            next = next == at ? kNoFrame : after;
        }
    }
    parents.clear();
    for (const lookup::NearestParent& each : nearest)
        parents.push_back(each.parent);
    return outcome;
}

/// Collects all frames of a state for TreeColumns.
/// Threads: one. Guarantee: each attempt to read starts anew.
class Listing {
public:
    explicit Listing(const store::Store& store) : store_(store) {}

    Outcome read(const StoreView& view, std::optional<StampNs> stamp) {
        const std::uint32_t count = view.frame_count();
        all_ = TreeColumns{};
        all_.names.reserve(count);
        all_.rows.reserve(count);
        ids_.clear();
        authorities_.clear();
        std::vector<FrameId> parents;
        const Outcome found = stamp ? all_parents(view, *stamp, parents) : Outcome::kOk;
        const Outcome listed = store::for_each_frame(view, [&](FrameId id) {
            TreeColumns::Row row;
            const Outcome outcome = look_at(view, id, row);
            if (outcome != Outcome::kOk)
                return outcome;
            if (stamp)
                row.parent = id < parents.size() ? parents[id] : FrameId{kNoFrame};
            ids_.push_back(id);
            all_.rows.push_back(row);
            const bool alive = store::read_name(store_, view, id, all_.names.emplace_back());
            return alive ? Outcome::kOk : Outcome::kLapped;
        });
        return found == Outcome::kOk ? listed : found;
    }

    /// Sorted by name, with parents as row indices.
    [[nodiscard]] TreeColumns sorted() {
        const std::vector<std::uint32_t> order = store::order_of(all_.names);
        std::vector<std::uint32_t> places;  // row indices by id
        TreeColumns sorted;
        sorted.authorities = std::move(all_.authorities);
        sorted.names.reserve(order.size());
        sorted.rows.reserve(order.size());
        for (const std::uint32_t from : order) {
            if (places.size() <= ids_[from])
                places.resize(ids_.back() + std::size_t{1}, TreeColumns::kNone);
            places[ids_[from]] = static_cast<std::uint32_t>(sorted.rows.size());
            sorted.names.push_back(std::move(all_.names[from]));
            sorted.rows.push_back(all_.rows[from]);
        }
        for (TreeColumns::Row& row : sorted.rows)
            row.parent = row.parent < places.size() ? places[row.parent] : TreeColumns::kNone;
        return sorted;
    }

private:
    /// Fills in all but the name; the parent is an id, or kNoFrame.
    Outcome look_at(const StoreView& view, FrameId id, TreeColumns::Row& row) {
        store::Outline outline;
        const Outcome outcome = store::outline(view, id, outline);
        if (outcome != Outcome::kOk)
            return outcome;
        store::fill_from(outline, row);
        row.late = store_.frames.word(id, history::kLate).load_relaxed();
        row.authority = authority(id);
        row.parent = kNoFrame;
        if (outline.parent == kNoFrame)
            return Outcome::kOk;
        if (view.alive_since(outline.parent, outline.named))
            row.parent = outline.parent;
        else if (may_be_reused(store_, view))
            return Outcome::kLapped;
        return Outcome::kOk;
    }
    std::uint32_t authority(FrameId id) {
        const std::uint64_t number = store_.frames.word(id, history::kAuthority).load_acquire();
        const auto next = static_cast<std::uint32_t>(all_.authorities.size());
        const auto [known, is_new] = authorities_.try_emplace(number, next);
        if (is_new)
            all_.authorities.push_back(store_.author(id));
        return known->second;
    }

    const store::Store& store_;
    TreeColumns all_;                                               // in order of ids
    std::vector<FrameId> ids_;                                      // of its rows, ascending
    std::unordered_map<std::uint64_t, std::uint32_t> authorities_;  // indices by number
};

}  // namespace

std::vector<std::string> StoreReader::frames() const {
    std::vector<std::string> names;
    (void)store::read(*store_, held_, [&](const StoreView& view) {
        names.clear();
        const Outcome all = store::for_each_frame(view, [&](FrameId id) {
            const bool alive = store::read_name(*store_, view, id, names.emplace_back());
            return alive ? Outcome::kOk : Outcome::kLapped;
        });
        return store::unless_reused(*store_, view.commit(), all);
    });
    std::vector<std::string> sorted;
    sorted.reserve(names.size());
    for (const std::uint32_t place : store::order_of(names))
        sorted.push_back(std::move(names[place]));
    return sorted;
}

FrameInfo StoreReader::frame_info(std::string_view name) const {
    FrameInfo info;
    read_frame(*store_, held_, name, [&](const StoreView& view, FrameId id) {
        return fill_info(*store_, view, id, info);
    });
    return info;
}

std::vector<FrameInfo> StoreReader::tree(std::optional<StampNs> stamp) const {
    const TreeColumns all = tree_columns(stamp);
    std::vector<FrameInfo> infos(all.rows.size());
    for (std::size_t i = 0; i < infos.size(); ++i) {
        const TreeColumns::Row& row = all.rows[i];
        FrameInfo& info = infos[i];
        info.name = all.names[i];
        if (row.parent != TreeColumns::kNone)
            info.parent = all.names[row.parent];
        info.is_static = row.is_static;
        info.samples = row.samples;
        info.oldest = row.oldest;
        info.newest = row.newest;
        info.longest_gap = row.longest_gap;
        info.cleared = row.cleared;
        info.authority = all.authorities[row.authority];
        info.late = row.late;
    }
    return infos;
}

TreeColumns StoreReader::tree_columns(std::optional<StampNs> stamp) const {
    Listing listing(*store_);
    (void)store::read(*store_, held_, [&](const StoreView& view) {
        const Outcome outcome = listing.read(view, stamp);
        return store::unless_reused(*store_, view.commit(), outcome);
    });
    return listing.sorted();
}

Samples StoreReader::samples(std::string_view name) const {
    Samples out;
    read_frame(*store_, held_, name, [&](const StoreView& view, FrameId id) {
        out = Samples{};
        store::Track track;
        const Outcome collected = store::collect_all(view, id, track);
        if (collected != Outcome::kOk)
            return collected;
        out.stamps = std::move(track.stamps);
        if (track.is_static)
            out.stamps.assign(1, -1);
        out.poses = std::move(track.poses);
        std::string parent;  // consecutive samples mostly have the same parent
        FrameId read = kNoFrame;
        for (std::size_t i = 0; i < track.parents.size(); ++i) {
            const bool known = view.alive_since(track.parents[i], track.commits[i]);
            if (!known && may_be_reused(*store_, view))
                return Outcome::kLapped;
            if (known && read != track.parents[i]) {
                read = track.parents[i];
                if (!store::read_name(*store_, view, read, parent))
                    return Outcome::kLapped;
            }
            out.parents.push_back(known ? parent : std::string());
        }
        sync::fence_acquire();
        return view.alive(id) ? Outcome::kOk : Outcome::kLapped;
    });
    return out;
}

Reach StoreReader::reach(std::string_view target, std::string_view source,
                         std::optional<StampNs> stamp) const {
    Reach reach;
    const auto walk = [&](const StoreView& view, FrameId to, FrameId from) {
        if (to == kNoFrame || from == kNoFrame)
            reach.end = Reach::kNowhere;
        if (to == from || reach.end == Reach::kNowhere)
            return Outcome::kOk;
        if (!stamp) {
            Answer answer;
            lookup::Failure failure;
            const Outcome found = lookup::latest_common_time(view, to, from, answer, failure);
            if (found == Outcome::kFailed)
                reach.end = Reach::kApart;
            if (found != Outcome::kOk)
                return found == Outcome::kFailed ? Outcome::kOk : found;
            reach.stamp = answer.stamp;
        }
        return walk_both(*store_, view, to, from, reach);
    };
    (void)store::read(*store_, held_, [&](const StoreView& view) {
        reach = Reach{};
        reach.stamp = stamp.value_or(0);
        const FrameId to = store_->names.find(target, view.commit());
        const FrameId from = store_->names.find(source, view.commit());
        return store::unless_reused(*store_, view.commit(), walk(view, to, from));
    });
    return reach;
}

std::optional<std::string> StoreReader::parent_of(std::string_view name,
                                                  std::optional<StampNs> stamp) const {
    std::optional<std::string> found;
    read_frame(*store_, held_, name, [&](const StoreView& view, FrameId id) {
        found.reset();
        FrameId parent = kNoFrame;
        const Outcome read = lookup::parent_at(view, id, stamp, parent);
        if (parent == kNoFrame)
            return store::unless_reused(*store_, view.commit(), read);
        return store::read_name(*store_, view, parent, found.emplace()) ? read : Outcome::kLapped;
    });
    return found;
}

std::string StoreReader::frame_name(FrameId id, std::uint32_t generation) const {
    return store::name_of_frame(*store_, id, generation);
}

}  // namespace tfdb
