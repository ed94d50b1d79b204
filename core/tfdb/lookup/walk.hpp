// The path between two frames: both are walked up to where they meet, not to the root.
#pragma once

#include <algorithm>
#include <unordered_map>
#include <vector>

#include "tfdb/history/layout.hpp"
#include "tfdb/lookup/edge.hpp"
#include "tfdb/lookup/view.hpp"

namespace tfdb::lookup {

/// How a walk learns parents: from hints that may be of a later state (checked edge by edge when
/// the poses are read), or from the samples of the view itself, which is exact and slower.
enum class WalkMode : std::uint8_t { kHints, kSamples };

/// Takes the ancestors that both chains share off their ends, all but the lowest.
inline void strip_common(std::vector<FrameId>& a, std::vector<FrameId>& b) {
    while (a.size() > 1 && b.size() > 1 && a[a.size() - 2] == b[b.size() - 2]) {
        a.pop_back();
        b.pop_back();
    }
}

/// Cuts both chains at the first frame of `up` that `down` has too; false if it has none. Where a
/// policy chooses a parent for each edge by itself, chains may run past the lowest one.
inline bool cut_at_meeting(std::vector<FrameId>& up, std::vector<FrameId>& down) {
    constexpr std::size_t kFewPairs = 4096;
    std::unordered_map<FrameId, std::size_t> index;
    const bool few = up.size() * down.size() <= kFewPairs;  // then no allocation either
    for (std::size_t i = 0; !few && i < down.size(); ++i) {
        index.try_emplace(down[i], i);
    }
    const auto place_in_down = [&](FrameId id) {
        if (few) {
            return static_cast<std::size_t>(std::find(down.begin(), down.end(), id) - down.begin());
        }
        const auto found = index.find(id);
        return found == index.end() ? down.size() : found->second;
    };
    for (std::size_t i = 0; i < up.size(); ++i) {
        const std::size_t shared = place_in_down(up[i]);
        if (shared == down.size()) {
            continue;
        }
        up.resize(i + 1);
        down.resize(shared + 1);
        return true;
    }
    return false;
}

/// One walk of both frames upward.
/// Threads: one; the view and the chains outlive it.
/// Guarantee: takes no lock, and ends also where a policy's choices run in a circle.
template <View V>
class Walker {
public:
    Walker(const V& view, StampNs stamp, const Policy& policy, WalkMode mode, Answer& chains)
        : view_(view),
          stamp_(stamp),
          policy_(policy),
          mode_(mode),
          up_(chains.source_chain),
          down_(chains.target_chain),
          to_root_(policy.kind == PolicyKind::kNearest || policy.kind == PolicyKind::kExtrapolate) {
    }

    /// Fills both chains up to the meeting point, the last of both; or, when `met` is false, up to
    /// their roots. The depth hints say which side to move; where they are wrong a side may walk
    /// past the meeting point, and both then meet higher up or at the root.
    [[nodiscard]] Outcome walk(FrameId target, FrameId source, Edges edges, bool& met) {
        using history::Topology;
        Side up{up_, view_.topology(source)};
        Side down{down_, view_.topology(target)};
        up_.assign(1, source);
        down_.assign(1, target);
        // The flags that `climb` looks at may be of a later state; what an error names must not
        // hang on them.
        branching_ = mode_ == WalkMode::kSamples && (to_root_ || edges == Edges::kAll);
        while (!(up.ended && down.ended)) {
            if (!branching_ && !to_root_ && up_.back() == down_.back()) {
                break;
            }
            const bool move_up = !up.ended && (down.ended || Topology::depth(up.topology) >=
                                                                 Topology::depth(down.topology));
            const Outcome step = climb(move_up ? up : down, edges);
            if (step != Outcome::kOk) {
                return step;
            }
        }
        for (std::vector<FrameId>* const chain : {&up_, &down_}) {
            const Outcome cut = branching_ ? cut_circle(*chain, edges) : Outcome::kOk;
            if (cut != Outcome::kOk)
                return cut;
        }
        met = branching_ ? cut_at_meeting(up_, down_) : up_.back() == down_.back();
        if (met) {
            strip_common(up_, down_);
        }
        return Outcome::kOk;
    }

    /// True if a frame on the way had more than one parent in its time.
    [[nodiscard]] bool branching() const { return branching_; }
    /// True for policies that answer far from an edge's samples: where a frame had several parents,
    /// there may then be several paths, and the lowest meeting point is found from whole chains.
    [[nodiscard]] bool to_root() const { return to_root_; }

private:
    struct Side {
        std::vector<FrameId>& chain;
        std::uint64_t topology;
        bool ended = false;
    };

    [[nodiscard]] Outcome climb(Side& side, Edges edges) {
        using history::Topology;
        constexpr std::uint64_t kAskSamples = Topology::kMixedParents | Topology::kMortal;
        branching_ |= (side.topology & (Topology::kMixedParents | Topology::kCleared)) != 0;
        FrameId parent = Topology::parent(side.topology);
        if (mode_ == WalkMode::kSamples || (side.topology & kAskSamples) != 0) {
            NearestParent nearest;
            const Outcome found =
                exact_parent(view_, side.chain.back(), stamp_, policy_, edges, nearest);
            if (found != Outcome::kOk) {
                return found;
            }
            parent = nearest.parent;
        }
        side.ended = parent == kNoFrame || side.chain.size() > view_.frame_count();
        if (!side.ended) {
            side.chain.push_back(parent);
            side.topology = view_.topology(parent);
        }
        return Outcome::kOk;
    }

    /// Ends a chain with a cycle at the cycle's first root: see nearest_parent_at.
    [[nodiscard]] Outcome cut_circle(std::vector<FrameId>& chain, Edges edges) {
        const auto again = std::find(chain.rbegin() + 1, chain.rend(), chain.back());
        if (again == chain.rend())
            return Outcome::kOk;
        const auto around = static_cast<std::size_t>(again - chain.rbegin());
        std::size_t first = 0;
        while (chain[first] != chain[first + around])
            ++first;
        chain.resize(first + around);
        for (std::size_t at = first; at < chain.size(); ++at) {
            NearestParent nearest;
            const Outcome found = exact_parent(view_, chain[at], stamp_, policy_, edges, nearest);
            if (found != Outcome::kOk)
                return found;
            if (nearest.later)
                chain.resize(at + 1);
        }
        return Outcome::kOk;
    }

    const V& view_;
    StampNs stamp_;
    const Policy& policy_;
    WalkMode mode_;
    std::vector<FrameId>& up_;
    std::vector<FrameId>& down_;
    bool to_root_;
    bool branching_ = false;
};

/// A view that notes which samples an answer depends on; hints do not count.
template <class V>
concept NotingView = View<V> && requires {
    requires V::kNotesReads;
};

/// Says that the chains end at two roots, and which edge of them has no data at the stamp: the
/// first one from the source upward, then from the target.
template <View V>
[[nodiscard]] Outcome describe_apart(const V& view, StampNs stamp, const Policy& policy,
                                     Answer& chains, Failure& failure) {
    failure = Failure{};
    failure.code = ErrorCode::kDisconnected;
    failure.frame = handle_of(view, chains.target_chain.back());
    failure.other = handle_of(view, chains.source_chain.back());
    failure.commit = view.commit();
    if (policy.kind != PolicyKind::kLatest)
        failure.stamp = stamp;
    for (const auto* chain : {&chains.source_chain, &chains.target_chain}) {
        for (const FrameId id : *chain) {
            bool noted = false;
            const Outcome outcome = note_if_out_of_range(view, id, stamp, policy, failure, noted);
            if (outcome != Outcome::kOk)
                return outcome;
            if (noted)
                return Outcome::kFailed;
        }
    }
    return Outcome::kFailed;
}

/// Fills both chains of the answer, each from its frame up to the meeting point. By the samples: a
/// path of edges that all answer at the stamp if there is one, else one that names the culprit.
/// When there is none, kFailed with both roots.
template <View V>
[[nodiscard]] Outcome walk(const V& view, FrameId target, FrameId source, StampNs stamp,
                           const Policy& policy, WalkMode mode, Answer& chains, Failure& failure) {
    Walker<V> walker(view, stamp, policy, mode, chains);
    bool met = false;
    if (mode == WalkMode::kHints) {
        // There the path depends on whole chains, of which hints note only what lies on it.
        if (NotingView<V> && walker.to_root())
            return Outcome::kMismatch;
        const Outcome outcome = walker.walk(target, source, Edges::kAll, met);
        if (outcome != Outcome::kOk) {
            return outcome;
        }
        return met && !(walker.branching() && walker.to_root()) ? Outcome::kOk : Outcome::kMismatch;
    }
    for (const Edges edges : {Edges::kAnswering, Edges::kAll}) {
        const Outcome outcome = walker.walk(target, source, edges, met);
        if (outcome != Outcome::kOk || met) {
            return outcome;
        }
    }
    return describe_apart(view, stamp, policy, chains, failure);
}

}  // namespace tfdb::lookup
