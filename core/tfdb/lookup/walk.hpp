// The path between two frames: both are walked up to where they meet, not to the root.
#pragma once

#include <vector>

#include "tfdb/history/layout.hpp"
#include "tfdb/lookup/edge.hpp"
#include "tfdb/lookup/view.hpp"

namespace tfdb::lookup {

/// How a walk learns parents: from hints that may be of a later state (checked edge by edge when
/// the poses are read), or from the samples of the view itself, which is exact and slower.
enum class WalkMode : std::uint8_t { kHints, kSamples };

template <View V>
[[nodiscard]] Outcome parent_at(const V& view, FrameId id, StampNs stamp, const Policy& policy,
                                WalkMode mode, std::uint64_t topology, FrameId& parent) {
    using history::Topology;
    if (mode == WalkMode::kHints &&
        (topology & (Topology::kMixedParents | Topology::kMortal)) == 0) {
        parent = Topology::parent(topology);
        return Outcome::kOk;
    }
    return exact_parent(view, id, stamp, policy, parent);
}

/// Takes the ancestors that both chains share off their ends, all but the lowest.
inline void strip_common(std::vector<FrameId>& a, std::vector<FrameId>& b) {
    while (a.size() > 1 && b.size() > 1 && a[a.size() - 2] == b[b.size() - 2]) {
        a.pop_back();
        b.pop_back();
    }
}

/// Fills both chains, each from its frame up to the meeting point (the last of both). When there
/// is none, kFailed with both roots. The depth hints say which side to move; where they are wrong
/// a side may walk past the meeting point, and both then meet higher up or at the root.
template <View V>
[[nodiscard]] Outcome walk(const V& view, FrameId target, FrameId source, StampNs stamp,
                           const Policy& policy, WalkMode mode, Answer& chains, Failure& failure) {
    using history::Topology;
    auto& up = chains.source_chain;
    auto& down = chains.target_chain;
    up.assign(1, source);
    down.assign(1, target);
    bool up_ended = false;
    bool down_ended = false;
    std::uint64_t up_topology = view.topology(source);
    std::uint64_t down_topology = view.topology(target);
    const std::size_t bound = 2 * (std::size_t{view.frame_count()} + 1);
    while (up.back() != down.back() && !(up_ended && down_ended)) {
        const bool move_up = !up_ended && (down_ended || Topology::depth(up_topology) >=
                                                             Topology::depth(down_topology));
        auto& chain = move_up ? up : down;
        auto& topology = move_up ? up_topology : down_topology;
        FrameId parent = kNoFrame;
        const Outcome step = parent_at(view, chain.back(), stamp, policy, mode, topology, parent);
        if (step != Outcome::kOk)
            return step;
        if (parent == kNoFrame) {
            (move_up ? up_ended : down_ended) = true;
            continue;
        }
        chain.push_back(parent);
        topology = view.topology(parent);
        if (up.size() + down.size() > bound) {
            failure.code = ErrorCode::kCycle;
            failure.frame = chain.back();
            failure.other = parent;
            return mode == WalkMode::kHints ? Outcome::kMismatch : Outcome::kFailed;
        }
    }
    if (up.back() == down.back()) {
        strip_common(up, down);
        return Outcome::kOk;
    }
    if (mode == WalkMode::kHints)
        return Outcome::kMismatch;
    failure.code = ErrorCode::kDisconnected;
    failure.frame = down.back();
    failure.other = up.back();
    failure.commit = view.commit();
    failure.stamp = stamp;
    return Outcome::kFailed;
}

}  // namespace tfdb::lookup
