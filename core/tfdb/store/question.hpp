// A lookup's arguments, for any state of a store.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

#include "tfdb/base/error.hpp"
#include "tfdb/clock/stamp.hpp"
#include "tfdb/lookup/answer.hpp"
#include "tfdb/lookup/policy.hpp"

namespace tfdb {

using clock::StampNs;
using lookup::Answer;
using lookup::Failure;
using lookup::FrameHandle;
using lookup::Policy;

/// A frame by its name, by a handle, or both. The handle saves the name lookup while it refers to
/// the frame of that name in the state that is read. Without a name, a handle whose frame is gone
/// refers to no frame.
struct FrameRef {
    std::string_view name{};
    FrameHandle handle{};
};

/// One lookup. Names and answer belong to one state; afterwards the handles of named frames are
/// those of that state.
struct Question {
    enum Kind : std::uint8_t {
        kAt,          // T[target<-source] at `stamp`, none: the latest common time
        kCan,         // whether kAt has an answer
        kFull,        // T[target at stamp <- source at source_stamp] through `fixed`
        kLatest,      // from each edge's newest sample; none may be older than now - max_age
        kCommonTime,  // the newest stamp at which the path has data
        kCovered,     // ... and the oldest one
        kEdge,        // kAt if the edge from `source` to its parent `target` is the whole path
        kOwnEdge,     // kEdge to the parent of `source` at `stamp`; none: in its newest sample
    };
    Kind kind = kAt;
    FrameRef target{};
    FrameRef source{};
    FrameRef fixed{};                // kFull
    std::optional<StampNs> stamp{};  // kAt, kCan, kFull, kEdge (needed), kOwnEdge; kCommonTime: how
                                     // new a wait wants it
    std::optional<StampNs> source_stamp{};  // kFull
    Policy policy{};                        // kAt, kCan, kFull, kEdge, kOwnEdge
    std::optional<StampNs> max_age{};       // kLatest
    StampNs now = 0;                        // kLatest
};

namespace store {

[[nodiscard]] inline Question by_name(Question::Kind kind, std::string_view target,
                                      std::string_view source) {
    return {.kind = kind, .target = {.name = target}, .source = {.name = source}};
}
[[nodiscard]] inline Question at_stamp(std::string_view target, std::string_view source,
                                       std::optional<StampNs> stamp, const Policy& policy) {
    Question question = by_name(Question::kAt, target, source);
    question.stamp = stamp;
    question.policy = policy;
    return question;
}
/// For frames that were found before; without `stamp`, at the latest common time.
[[nodiscard]] inline Question at_stamp(FrameHandle target, FrameHandle source,
                                       std::optional<StampNs> stamp, const Policy& policy) {
    Question question{.target = {.handle = target}, .source = {.handle = source}};
    // Field by field: a copy of the whole would wait until each field has been stored.
    if (stamp)
        question.stamp.emplace(*stamp);
    question.policy.kind = policy.kind;
    question.policy.limit = policy.limit;
    return question;
}
/// For the edges of frames in turn: `source` is set later.
[[nodiscard]] inline Question of_edges(std::optional<StampNs> stamp, const Policy& policy) {
    Question question{.kind = Question::kOwnEdge};
    question.stamp = stamp;
    question.policy = policy;
    return question;
}
/// For a wait until the newest stamp at which the path has data is `stamp` or later.
[[nodiscard]] inline Question as_new_as(std::string_view target, std::string_view source,
                                        StampNs stamp) {
    Question question = by_name(Question::kCommonTime, target, source);
    question.stamp = stamp;
    return question;
}
[[nodiscard]] inline Question of_newest(std::string_view target, std::string_view source,
                                        std::optional<StampNs> max_age, StampNs now) {
    Question question = by_name(Question::kLatest, target, source);
    question.max_age = max_age;
    question.now = now;
    return question;
}
[[nodiscard]] inline Question of_newest(FrameHandle target, FrameHandle source,
                                        std::optional<StampNs> max_age, StampNs now) {
    return {.kind = Question::kLatest,
            .target = {.handle = target},
            .source = {.handle = source},
            .max_age = max_age,
            .now = now};
}
[[nodiscard]] inline Question by_way_of(std::string_view fixed, std::string_view target,
                                        std::optional<StampNs> target_stamp,
                                        std::string_view source,
                                        std::optional<StampNs> source_stamp, const Policy& policy) {
    Question question = by_name(Question::kFull, target, source);
    question.fixed.name = fixed;
    question.stamp = target_stamp;
    question.source_stamp = source_stamp;
    question.policy = policy;
    return question;
}

/// The answer of a StoreReader or a Transaction. Throws the typed error of a failed question.
template <class Asked>
[[nodiscard]] Answer answer_or_raise(Asked& asked, Question question) {
    Answer answer;
    Failure failure;
    if (!asked.ask(question, answer, failure))
        asked.raise(failure, question);
    return answer;
}

/// Whether a StoreReader or a Transaction has an answer. Throws SnapshotTooOld.
template <class Asked>
[[nodiscard]] bool can_answer(Asked& asked, Question question) {
    Answer answer;
    Failure failure;
    const bool can = asked.ask(question, answer, failure);
    if (!can && failure.code == ErrorCode::kSnapshotTooOld)
        asked.raise(failure, question);
    return can;
}

}  // namespace store

/// The oldest and newest stamp between which a path always has data; empty if `oldest > newest`.
struct CommonTimes {
    StampNs oldest = 0;
    StampNs newest = 0;
};

namespace store {

/// The lookups by name of `Self`, which has `ask` and `raise`. They throw the typed error of a
/// failed question. Threads: those of `Self`. Guarantee: that of its `ask`.
template <class Self>
class LookupsByName {
public:
    /// As `ask(Question&)`, for a question whose handles are not reused.
    [[nodiscard]] bool ask(Question&& question, Answer& answer, Failure& failure) const {
        return self().ask(question, answer, failure);
    }
    /// T[target<-source]; without `stamp`, at the latest common time.
    [[nodiscard]] Answer lookup_transform(std::string_view target, std::string_view source,
                                          std::optional<StampNs> stamp = std::nullopt,
                                          Policy policy = {}) const {
        return answer_or_raise(self(), at_stamp(target, source, stamp, policy));
    }
    /// From each edge's newest sample; none may be older than now - max_age.
    [[nodiscard]] Answer lookup_latest_transform(std::string_view target, std::string_view source,
                                                 std::optional<StampNs> max_age = std::nullopt,
                                                 StampNs now = 0) const {
        return answer_or_raise(self(), of_newest(target, source, max_age, now));
    }
    /// T[target at target_stamp <- source at source_stamp], through `fixed`. A missing stamp is the
    /// latest common time of its frame and `fixed`.
    [[nodiscard]] Answer lookup_transform_full(std::string_view target,
                                               std::optional<StampNs> target_stamp,
                                               std::string_view source,
                                               std::optional<StampNs> source_stamp,
                                               std::string_view fixed, Policy policy = {}) const {
        return answer_or_raise(
            self(), by_way_of(fixed, target, target_stamp, source, source_stamp, policy));
    }
    /// The newest stamp at which every moving edge between two frames has data; 0 if none moves.
    /// For a frame and itself, as in tf2: the stamp of its own newest sample.
    [[nodiscard]] StampNs latest_common_time(std::string_view target,
                                             std::string_view source) const {
        return answer_or_raise(self(), by_name(Question::kCommonTime, target, source)).stamp;
    }
    /// The latest common time and the oldest stamp, of one state: at each stamp between them every
    /// edge of the newest tree's path has data and its newest parent. Both are 0 if no edge moves.
    [[nodiscard]] CommonTimes common_times(std::string_view target, std::string_view source) const {
        const Answer answer = answer_or_raise(self(), by_name(Question::kCovered, target, source));
        return {answer.oldest, answer.stamp};
    }

private:
    [[nodiscard]] const Self& self() const { return static_cast<const Self&>(*this); }
};

}  // namespace store

}  // namespace tfdb
