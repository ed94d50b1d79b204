#include "tfdb/store/collect.hpp"

#include <algorithm>
#include <bit>
#include <limits>
#include <utility>

namespace tfdb::store {
namespace {

using lookup::Outcome;

void push(const StoreEdge& edge, const history::SampleAt& sample, Track& track) {
    const auto slot = edge.read(sample);
    track.poses.push_back(std::bit_cast<Pose>(slot.payload));
    track.parents.push_back(slot.parent);
    track.commits.push_back(slot.commit);
}

}  // namespace

Outcome collect_all(const StoreView& view, FrameId id, Track& track) {
    track = Track{};
    StoreEdge edge;
    if (!view.open(id, edge))
        return Outcome::kLapped;
    if (edge.is_static()) {
        track.is_static = true;
        push(edge, edge.newest(), track);
    } else if (!edge.empty()) {
        const bool whole = edge.visit(std::numeric_limits<StampNs>::min() / 2, history::kForever, 0,
                                      [&](const history::SampleAt& sample) {
                                          track.stamps.push_back(sample.stamp);
                                          push(edge, sample, track);
                                          return true;
                                      });
        if (!whole)
            return Outcome::kLapped;
    }
    return edge.confirm() ? Outcome::kOk : Outcome::kLapped;
}

Outcome outline(const StoreView& view, FrameId id, Outline& out) {
    out = Outline{};
    StoreEdge edge;
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

}  // namespace tfdb::store
