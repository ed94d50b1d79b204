// Looking at frames and their samples.
#include <algorithm>

#include "tfdb/store/collect.hpp"
#include "tfdb/store/raise.hpp"
#include "tfdb/store/store.hpp"

namespace tfdb {

using lookup::Outcome;

namespace {

/// The name of a frame of this state; false if its slot was reused meanwhile.
bool read_name(const store::Store& store, const StoreView& view, FrameId id, std::string& name) {
    name = store.names.name(id);
    sync::fence_acquire();
    return view.alive(id);
}

/// Whether a frame that looks missing in this state may have lived in it.
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
    info.is_static = outline.is_static;
    info.samples = outline.extent.samples;
    info.oldest = outline.extent.first;
    info.newest = outline.extent.last;
    info.longest_gap = outline.extent.longest_gap;
    if (outline.parent != kNoFrame) {
        if (!view.alive_since(outline.parent, outline.named)) {
            if (may_be_reused(store, view))
                return Outcome::kLapped;
        } else if (!read_name(store, view, outline.parent, info.parent.emplace())) {
            return Outcome::kLapped;
        }
    }
    return read_name(store, view, id, info.name) ? Outcome::kOk : Outcome::kLapped;
}

template <class Visit>
Outcome for_each_frame(const StoreView& view, Visit visit) {
    for (FrameId id = 0; id < view.frame_count(); ++id) {
        if (!view.alive(id))
            continue;
        const Outcome outcome = visit(id);
        if (outcome != Outcome::kOk)
            return outcome;
    }
    return Outcome::kOk;
}

}  // namespace

std::vector<std::string> Reads::frames() const {
    std::vector<std::string> names;
    const Outcome outcome = store::read(*store_, held_, kFresh, [&](const StoreView& view) {
        names.clear();
        const Outcome all = for_each_frame(view, [&](FrameId id) {
            const bool alive = read_name(*store_, view, id, names.emplace_back());
            return alive ? Outcome::kOk : Outcome::kLapped;
        });
        return store::unless_reused(*store_, view.commit(), all);
    });
    if (outcome == Outcome::kLapped)
        store::throw_unreadable(*store_, held_);
    std::sort(names.begin(), names.end());
    return names;
}

FrameInfo Reads::frame_info(std::string_view name) const {
    FrameInfo info;
    CommitNumber at = 0;
    const Outcome outcome = store::read(*store_, held_, kFresh, [&](const StoreView& view) {
        at = view.commit();
        const FrameId id = store_->names.find(name, at);
        return id == kNoFrame ? Outcome::kFailed : fill_info(*store_, view, id, info);
    });
    if (outcome == Outcome::kFailed)
        store::throw_unknown_frame(name, at);
    if (outcome == Outcome::kLapped)
        store::throw_unreadable(*store_, held_);
    return info;
}

std::vector<FrameInfo> Reads::tree(std::optional<StampNs> stamp) const {
    std::vector<FrameInfo> infos;
    const Outcome outcome = store::read(*store_, held_, kFresh, [&](const StoreView& view) {
        infos.clear();
        const Outcome all = for_each_frame(view, [&](FrameId id) {
            FrameInfo& info = infos.emplace_back();
            const Outcome filled = fill_info(*store_, view, id, info);
            if (filled != Outcome::kOk || !stamp)
                return filled;
            FrameId parent = kNoFrame;
            const Outcome found = lookup::parent_at(view, id, stamp, parent);
            info.parent.reset();
            if (parent != kNoFrame && !read_name(*store_, view, parent, info.parent.emplace()))
                return Outcome::kLapped;
            return found;
        });
        return store::unless_reused(*store_, view.commit(), all);
    });
    if (outcome == Outcome::kLapped)
        store::throw_unreadable(*store_, held_);
    std::sort(infos.begin(), infos.end(),
              [](const FrameInfo& a, const FrameInfo& b) { return a.name < b.name; });
    return infos;
}

Samples Reads::samples(std::string_view name) const {
    Samples out;
    CommitNumber at = 0;
    const Outcome outcome = store::read(*store_, held_, kFresh, [&](const StoreView& view) {
        at = view.commit();
        out = Samples{};
        const FrameId id = store_->names.find(name, at);
        if (id == kNoFrame)
            return Outcome::kFailed;
        store::Track track;
        const Outcome collected = store::collect_all(view, id, track);
        if (collected != Outcome::kOk)
            return collected;
        out.stamps = std::move(track.stamps);
        if (track.is_static)
            out.stamps.assign(1, -1);
        out.poses = std::move(track.poses);
        std::string parent;  // samples in a row mostly have the same
        FrameId read = kNoFrame;
        for (std::size_t i = 0; i < track.parents.size(); ++i) {
            const bool known = view.alive_since(track.parents[i], track.commits[i]);
            if (!known && may_be_reused(*store_, view))
                return Outcome::kLapped;
            if (known && read != track.parents[i]) {
                read = track.parents[i];
                if (!read_name(*store_, view, read, parent))
                    return Outcome::kLapped;
            }
            out.parents.push_back(known ? parent : std::string());
        }
        sync::fence_acquire();
        return view.alive(id) ? Outcome::kOk : Outcome::kLapped;
    });
    if (outcome == Outcome::kFailed)
        store::throw_unknown_frame(name, at);
    if (outcome == Outcome::kLapped)
        store::throw_unreadable(*store_, held_);
    return out;
}

std::optional<std::string> Reads::parent_of(std::string_view name,
                                            std::optional<StampNs> stamp) const {
    std::optional<std::string> found;
    CommitNumber at = 0;
    const Outcome outcome = store::read(*store_, held_, kFresh, [&](const StoreView& view) {
        at = view.commit();
        found.reset();
        const FrameId id = store_->names.find(name, at);
        if (id == kNoFrame)
            return Outcome::kFailed;
        FrameId parent = kNoFrame;
        const Outcome read = lookup::parent_at(view, id, stamp, parent);
        if (parent == kNoFrame)
            return store::unless_reused(*store_, at, read);
        return read_name(*store_, view, parent, found.emplace()) ? read : Outcome::kLapped;
    });
    if (outcome == Outcome::kFailed)
        store::throw_unknown_frame(name, at);
    if (outcome == Outcome::kLapped)
        store::throw_unreadable(*store_, held_);
    return found;
}

std::string Reads::frame_name(FrameId id, std::uint32_t generation) const {
    return store::name_of_frame(*store_, id, generation);
}

}  // namespace tfdb
