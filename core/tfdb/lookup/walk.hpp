// The path between two frames: both are walked up to their meeting point, not to the root.
#pragma once

#include <algorithm>
#include <unordered_map>
#include <vector>

#include "tfdb/history/layout.hpp"
#include "tfdb/lookup/edge.hpp"
#include "tfdb/lookup/view.hpp"

namespace tfdb::lookup {

/// The source of parents for a walk. Hints may belong to a later state; they are verified edge by
/// edge when the poses are read. The view's own samples are exact and slower.
enum class WalkMode : std::uint8_t { kHints, kSamples };

/// Removes shared ancestors from the ends of both chains, except the lowest one.
inline void strip_common(std::vector<FrameId>& a, std::vector<FrameId>& b) {
    while (a.size() > 1 && b.size() > 1 && a[a.size() - 2] == b[b.size() - 2]) {
        a.pop_back();
        b.pop_back();
    }
}

/// Cuts both chains at the first frame of `up` that is also in `down`; false if there is none.
/// Chains may go past the lowest one if a policy chooses each edge's parent separately.
inline bool cut_at_meeting(std::vector<FrameId>& up, std::vector<FrameId>& down) {
    constexpr std::size_t kFewPairs = 4096;
    std::unordered_map<FrameId, std::size_t> index;
    const bool few = up.size() * down.size() <= kFewPairs;  // then it does not allocate
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

/// Walks both frames upward, once.
/// Threads: one; the view and the chains outlive it.
/// Guarantee: takes no lock, and terminates even if a policy's parents form a cycle.
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

    /// Fills both chains up to the meeting point, which ends both, or, if `met` is false, up to
    /// their roots. The depth hints select the side to move. If they are wrong, a side may walk
    /// past the meeting point; both sides then meet higher up or at the root.
    [[nodiscard]] Outcome walk(FrameId target, FrameId source, Edges edges, bool& met) {
        using history::Topology;
        Side up{up_, view_.topology(source)};
        Side down{down_, view_.topology(target)};
        up_.assign(1, source);
        down_.assign(1, target);
        // `climb` checks flags that may belong to a later state; an error's content must not depend
        // on them.
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

    /// Whether a frame on the path had several parents in its time.
    [[nodiscard]] bool branching() const { return branching_; }
    /// Whether the policy answers far from an edge's samples. If a frame had several parents,
    /// several paths may then exist, and only whole chains reveal the lowest meeting point.
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

    /// Ends a cyclic chain at the cycle's first root: see nearest_parent_at.
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

/// A view that records the samples on which an answer depends; hints do not count.
template <class V>
concept NotingView = View<V> && requires {
    requires V::kNotesReads;
};

/// Reports that the chains end at two roots, and the edge without data at the stamp: the first one
/// from the source upward, then from the target.
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

/// Fills both chains of the answer, from each frame up to the meeting point. By the samples, it
/// prefers a path whose edges all answer at the stamp, over one that names the failing edge.
/// Without any path: kFailed with both roots.
template <View V>
[[nodiscard]] Outcome walk(const V& view, FrameId target, FrameId source, StampNs stamp,
                           const Policy& policy, WalkMode mode, Answer& chains, Failure& failure) {
    Walker<V> walker(view, stamp, policy, mode, chains);
    bool met = false;
    if (mode == WalkMode::kHints) {
        // The path then depends on whole chains, but hints record only the frames on it.
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
