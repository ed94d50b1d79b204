// Refuses answers over edges whose lifespan has ended.
#pragma once

#include "tfdb/lookup/lookup.hpp"
#include "tfdb/store/clock.hpp"
#include "tfdb/store/lifespans.hpp"
#include "tfdb/store/question.hpp"
#include "tfdb/store/store.hpp"

namespace tfdb::store {

/// Checks paths in one view by the lifespans that this process enforces. `name_of(id)` is the name
/// of a frame in that view.
/// Threads: one. Guarantee: that of the view.
template <lookup::View V, class NameOf>
class Freshness {
public:
    Freshness(const Store& store, const V& view, const Lifespans& lifespans, NameOf name_of)
        : view_(view), lifespans_(lifespans), name_of_(name_of), now_(now(store)) {}

    /// kFailed, with kStale: an edge of the newest tree's path between the two frames is too old.
    [[nodiscard]] lookup::Outcome path(FrameId target, FrameId source, Failure& failure) const {
        if (target == source)
            return lookup::Outcome::kOk;
        Answer newest;
        Failure none;
        lookup::Outcome outcome = lookup::latest_common_path(view_, target, source, newest, none);
        // Frames with a path at a stamp may have none in the newest tree.
        if (outcome != lookup::Outcome::kOk)
            return outcome == lookup::Outcome::kLapped ? outcome : lookup::Outcome::kOk;
        for (const auto* chain : {&newest.source_chain, &newest.target_chain}) {
            for (std::size_t i = 0; i + 1 < chain->size(); ++i) {
                outcome = edge((*chain)[i], failure);
                if (outcome != lookup::Outcome::kOk)
                    return outcome;
            }
        }
        return outcome;
    }
    /// The same for the edge from a frame to its newest parent.
    [[nodiscard]] lookup::Outcome edge(FrameId child, Failure& failure) const {
        StampNs newest = history::kNoStamp;
        FrameId parent = kNoFrame;
        const lookup::Outcome read = lookup::detail::newest_stamp(view_, child, newest, parent);
        if (read != lookup::Outcome::kOk || newest < 0 || parent == kNoFrame)
            return read;
        const Lifespan* const lifespan = lifespans_.of(name_of_(parent), name_of_(child));
        if (lifespan == nullptr || newest >= clock::saturating_sub(now_, lifespan->limit))
            return read;
        failure = Failure{};
        failure.code = ErrorCode::kStale;
        failure.frame = lookup::handle_of(view_, child);
        failure.other = lookup::handle_of(view_, parent);
        failure.stamp = now_;
        failure.newest = newest;
        failure.before = newest;
        failure.limit = lifespan->limit;
        failure.expectation = &lifespan->expectation;
        failure.commit = view_.commit();
        return lookup::Outcome::kFailed;
    }
    /// The same for all frames of a question; its handles are those of its frames in the view.
    [[nodiscard]] lookup::Outcome question(const Question& asked, Failure& failure) const {
        const FrameId target = asked.target.handle.id;
        const FrameId source = asked.source.handle.id;
        lookup::Outcome outcome = lookup::Outcome::kOk;
        switch (asked.kind) {
            case Question::kCommonTime:
            case Question::kCovered:
                return outcome;  // a question about the history: lifespans do not apply
            case Question::kEdge:
            case Question::kOwnEdge:
                return edge(source, failure);
            case Question::kFull:
                outcome = path(asked.fixed.handle.id, source, failure);
                if (outcome != lookup::Outcome::kOk)
                    return outcome;
                return path(target, asked.fixed.handle.id, failure);
            default:
                return path(target, source, failure);
        }
    }

private:
    const V& view_;
    const Lifespans& lifespans_;
    NameOf name_of_;
    StampNs now_;
};

/// The outcome of a question, or kFailed if an ended lifespan refuses its answer.
template <lookup::View V, class NameOf>
[[nodiscard]] lookup::Outcome unless_stale(const Store& store, const V& view, NameOf name_of,
                                           const Question& question, lookup::Outcome outcome,
                                           Failure& failure) {
    const Lifespans* const lifespans = store.lifespans.load_acquire();
    if (lifespans == nullptr || outcome != lookup::Outcome::kOk) [[likely]]
        return outcome;
    return Freshness(store, view, *lifespans, name_of).question(question, failure);
}

/// kOk, or kFailed if a lifespan on the path between two frames has ended.
template <lookup::View V, class NameOf>
[[nodiscard]] lookup::Outcome path_unless_stale(const Store& store, const V& view, NameOf name_of,
                                                FrameId target, FrameId source, Failure& failure) {
    const Lifespans* const lifespans = store.lifespans.load_acquire();
    if (lifespans == nullptr) [[likely]]
        return lookup::Outcome::kOk;
    return Freshness(store, view, *lifespans, name_of).path(target, source, failure);
}

}  // namespace tfdb::store
