// Answers a question from one view: names are looked up in the very state that answers.
#pragma once

#include "tfdb/lookup/lookup.hpp"
#include "tfdb/store/question.hpp"

namespace tfdb::store {

/// Looks frames up in one view, by `find(name)` if a handle is missing or outdated.
/// Threads: one. Guarantee: that of the view.
template <lookup::View V, class Find>
class QuestionResolver {
public:
    QuestionResolver(const V& view, Find find, Question& question)
        : view_(view), find_(find), question_(question) {}

    [[nodiscard]] lookup::Outcome answer(Answer& answer, Failure& failure) {
        const FrameId target = resolve(question_.target);
        const FrameId source = resolve(question_.source);
        const FrameId fixed = question_.kind == Question::kFull ? resolve(question_.fixed) : 0;
        const lookup::Outcome outcome = look_up(target, source, fixed, answer, failure);
        const bool missing = outcome == lookup::Outcome::kFailed && by_handle_ &&
                             failure.code == ErrorCode::kUnknownFrame;
        if (!missing) [[likely]]
            return outcome;
        // A frame is gone; a new frame may have its name.
        return look_up(named(question_.target, target), named(question_.source, source),
                       named(question_.fixed, fixed), answer, failure);
    }

private:
    [[nodiscard]] FrameId resolve(FrameRef& frame) {
        const FrameHandle& known = frame.handle;
        if (known.id != kNoFrame && view_.generation(known.id) == known.generation) [[likely]] {
            by_handle_ = true;
            return known.id;
        }
        return named(frame, kNoFrame);
    }
    [[nodiscard]] FrameId named(FrameRef& frame, FrameId otherwise) {
        if (frame.name.data() == nullptr)
            return otherwise;
        const FrameId id = find_(frame.name);
        frame.handle = lookup::handle_of(view_, id);
        return id;
    }

    [[nodiscard]] lookup::Outcome look_up(FrameId target, FrameId source, FrameId fixed,
                                          Answer& answer, Failure& failure) const {
        const Question& q = question_;
        switch (q.kind) {
            case Question::kFull:
                return lookup::lookup_full(view_, target, q.stamp, source, q.source_stamp, fixed,
                                           q.policy, answer, failure);
            case Question::kCan:
                return lookup::can_lookup(view_, target, source, q.stamp, q.policy, answer,
                                          failure);
            case Question::kLatest:
                return lookup::lookup_latest(view_, target, source, q.max_age, q.now, answer,
                                             failure);
            case Question::kCommonTime:
                return lookup::latest_common_time(view_, target, source, answer, failure);
            case Question::kCovered:
                return lookup::covered_stamps(view_, target, source, answer, failure);
            case Question::kEdge:
                return lookup::lookup_edge(view_, target, source, q.stamp.value_or(0), q.policy,
                                           answer, failure);
            case Question::kOwnEdge:
                return lookup::lookup_own_edge(view_, source, q.stamp, q.policy, answer, failure);
            case Question::kAt:
                break;
        }
        return lookup::lookup(view_, target, source, q.stamp, q.policy, answer, failure);
    }

    const V& view_;
    Find find_;
    Question& question_;
    bool by_handle_ = false;
};

}  // namespace tfdb::store
