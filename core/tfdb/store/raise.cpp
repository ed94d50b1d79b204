// Converts a Failure to a typed error: looks names up, and writes a message that suggests a fix.
#include <string>

#include "tfdb/store/nearest.hpp"
#include "tfdb/store/raise.hpp"
#include "tfdb/store/store.hpp"
#include "tfdb/store/validate.hpp"

namespace tfdb {
namespace {

using store::quoted;
using store::seconds;
using store::transform_name;

/// T[target<-source] of a failed lookup, or of its failed half.
struct Context {
    const Failure& failure;
    std::string_view target;
    std::string_view source;
    std::string whole;  // the whole lookup, if this is a half
    std::string frame;
    std::string other;
    ErrorDetail detail;

    [[nodiscard]] std::string path() const { return transform_name(target, source) + whole; }
    [[nodiscard]] std::string edge() const { return edge_of(other, frame); }
    /// " at 12.345678901 s", if a stamp was given.
    [[nodiscard]] std::string at() const {
        return failure.stamp < 0 ? std::string() : " at " + seconds(failure.stamp);
    }

    static std::string edge_of(std::string_view parent, std::string_view child) {
        return "edge " + transform_name(parent, child);
    }
};

std::optional<std::int64_t> known(StampNs stamp) {
    return stamp < 0 ? std::nullopt : std::optional<std::int64_t>(stamp);
}

std::string span_of(const Failure& f) {
    return seconds(f.oldest) + " to " + seconds(f.newest);
}

[[noreturn]] void raise_unknown(Context& c, const Question& question, const std::string& hint) {
    c.detail.frame = store::unknown_of(c.failure, question).name;
    const std::string message = "frame " + quoted(c.detail.frame) + " does not exist in commit " +
                                std::to_string(c.failure.commit) + hint;
    throw UnknownFrame(message, std::move(c.detail));
}

/// The edge without data at the stamp, which separates the trees.
std::string out_of_range(Context& c, const std::string& child, const std::string& parent) {
    const Failure& f = c.failure;
    if (child.empty())
        return {};
    c.detail.edge = child;
    c.detail.parent = parent;
    c.detail.reason = f.direction > 0 ? "future" : "past";
    return "; " + Context::edge_of(parent, child) + " has no data" + c.at() + " (it covers " +
           span_of(f) + ")" + store::likely_meant(f.stamp, f.oldest, f.newest);
}

/// For one frame's edge: the frame is a root at the stamp.
[[noreturn]] void raise_no_parent(Context& c) {
    c.detail.frame = c.source;
    c.detail.frames = {std::string(c.source)};
    const std::string message = "frame " + quoted(c.source) + " has no parent" + c.at() +
                                ": it is a root and has no edge to look up";
    throw Disconnected(message, std::move(c.detail));
}

[[noreturn]] void raise_disconnected(Context& c, const std::string& child,
                                     const std::string& parent) {
    c.detail.frames = {c.frame, c.other};
    const std::string message =
        c.path() + c.at() + " has no answer: the frames are in different trees, " +
        quoted(c.target) + " under root " + quoted(c.frame) + " and " + quoted(c.source) +
        " under root " + quoted(c.other) + out_of_range(c, child, parent);
    throw Disconnected(message, std::move(c.detail));
}

/// For an edge that has data at a single stamp, where two are needed.
[[noreturn]] void raise_no_data(Context& c) {
    c.detail.reason = "no data";
    const std::string message = c.path() + c.at() +
                                " has no velocity: that needs two stamps, but " + c.edge() +
                                " has data only at " + seconds(c.failure.newest);
    throw Extrapolation(message, std::move(c.detail));
}

[[noreturn]] void raise_extrapolation(Context& c) {
    const Failure& f = c.failure;
    if (f.direction == 0)
        raise_no_data(c);
    const bool future = f.direction > 0;
    c.detail.reason = future ? "future" : "past";
    const StampNs distance = future ? f.stamp - f.newest : f.oldest - f.stamp;
    const std::string message = c.path() + " at " + seconds(f.stamp) +
                                " would need extrapolation by " + seconds(distance) + " into the " +
                                c.detail.reason + ": " + c.edge() + " covers " + span_of(f) +
                                store::likely_meant(f.stamp, f.oldest, f.newest);
    throw Extrapolation(message, std::move(c.detail));
}

[[noreturn]] void raise_gap(Context& c) {
    const Failure& f = c.failure;
    const std::string message = c.path() + " at " + seconds(f.stamp) + " was refused: " + c.edge() +
                                " has a gap of " + seconds(f.after - f.before) + " from " +
                                seconds(f.before) + " to " + seconds(f.after) +
                                ", more than max_gap = " + seconds(f.limit);
    throw GapTooLarge(message, std::move(c.detail));
}

[[noreturn]] void raise_expired(Context& c) {
    const Failure& f = c.failure;
    c.detail.expectation = *f.expectation;
    const std::string message = c.path() + " was refused: the newest sample of " + c.edge() +
                                " is " + seconds(f.stamp - f.newest) + " old (at " +
                                seconds(f.newest) + "), more than lifespan = " + seconds(f.limit) +
                                " of the expectation " + quoted(c.detail.expectation) +
                                store::likely_meant(f.stamp, f.newest, f.newest);
    throw Stale(message, std::move(c.detail));
}

[[noreturn]] void raise_stale(Context& c) {
    const Failure& f = c.failure;
    if (f.expectation != nullptr)
        raise_expired(c);
    const std::string message = c.path() + " at " + seconds(f.stamp) +
                                " was refused: the newest usable sample of " + c.edge() + " is " +
                                seconds(f.stamp - f.before) + " old (at " + seconds(f.before) +
                                "), more than max_age = " + seconds(f.limit) +
                                store::likely_meant(f.stamp, f.before, f.before);
    throw Stale(message, std::move(c.detail));
}

[[noreturn]] void raise_not_near(Context& c) {
    const Failure& f = c.failure;
    std::string near = "no sample";
    if (f.before >= 0 && f.after >= 0) {
        near = "samples at " + seconds(f.before) + " and " + seconds(f.after);
    } else if (f.before >= 0 || f.after >= 0) {
        near = "the closest sample at " + seconds(f.before >= 0 ? f.before : f.after);
    }
    const bool exact = f.limit < 0 || f.limit >= lookup::kNoLimit;
    if (exact)
        c.detail.limit = 0;
    const std::string message =
        c.path() + " at " + seconds(f.stamp) + " was refused: " + c.edge() + " has " + near +
        (exact ? ", not at exactly that stamp" : ", farther than tolerance = " + seconds(f.limit)) +
        store::likely_meant(f.stamp, f.before < 0 ? f.after : f.before,
                            f.after < 0 ? f.before : f.after);
    throw NoSampleNear(message, std::move(c.detail));
}

[[noreturn]] void raise_not_finite(Context& c) {
    c.detail.reason = "not finite";
    const StampNs stamp = c.failure.stamp;
    const std::string message = c.path() + (stamp < 0 ? "" : " at " + seconds(stamp)) +
                                " is not finite: the translations between the two frames are too "
                                "large for 64-bit floating point";
    throw InvalidTransform(message, std::move(c.detail));
}

}  // namespace

const FrameRef& store::unknown_of(const Failure& failure, const Question& question) {
    const int argument = failure.argument;
    return argument == 0 ? question.target : (argument == 1 ? question.source : question.fixed);
}

void store::throw_unknown_frame(std::string_view name, CommitNumber commit,
                                const std::string& hint) {
    ErrorDetail detail;
    detail.frame = name;
    detail.commit = commit;
    throw UnknownFrame(
        "frame " + quoted(name) + " does not exist in commit " + std::to_string(commit) + hint,
        std::move(detail));
}

void store::raise_failure(const Failure& failure, const Question& question,
                          const NameOfHandle& name, const std::string& hint) {
    using lookup::Half;
    Context c{failure, question.target.name, question.source.name, {}, {}, {}, {}};
    const bool own_edge = question.kind == Question::kOwnEdge;
    const std::string parent = own_edge ? name(failure.other) : std::string();
    if (own_edge)
        c.target = parent;
    c.detail.target = c.target;
    c.detail.source = c.source;
    if (failure.half != Half::kWhole) {
        c.whole = " (of " + transform_name(c.target, c.source) + ")";
        (failure.half == Half::kSource ? c.target : c.source) = question.fixed.name;
    }
    c.frame = name(failure.frame);
    c.other = name(failure.other);
    c.detail.stamp = known(failure.stamp);
    c.detail.oldest = known(failure.oldest);
    c.detail.newest = known(failure.newest);
    c.detail.before = known(failure.before);
    c.detail.after = known(failure.after);
    if (failure.limit < lookup::kNoLimit)
        c.detail.limit = known(failure.limit);
    c.detail.commit = failure.commit;
    if (failure.code == ErrorCode::kUnknownFrame)
        own_edge ? throw_unknown_frame(c.source, failure.commit, hint)
                 : raise_unknown(c, question, hint);
    if (failure.code == ErrorCode::kDisconnected && own_edge)
        raise_no_parent(c);
    if (failure.code == ErrorCode::kDisconnected)
        raise_disconnected(c, name(failure.edge), name(failure.parent));
    if (failure.code == ErrorCode::kInvalidTransform)
        raise_not_finite(c);
    c.detail.edge = c.frame;
    c.detail.parent = c.other;
    if (failure.code == ErrorCode::kGapTooLarge)
        raise_gap(c);
    if (failure.code == ErrorCode::kStale)
        raise_stale(c);
    if (failure.code == ErrorCode::kNoSampleNear)
        raise_not_near(c);
    raise_extrapolation(c);
}

void StoreReader::raise(const Failure& failure, const Question& question) const {
    if (failure.code == ErrorCode::kSnapshotTooOld)
        store::throw_unreadable(*store_, failure.commit);
    const auto name_of = [this](FrameHandle frame) {
        return frame.id == kNoFrame ? std::string()
                                    : store::name_of_frame(*store_, frame.id, frame.generation);
    };
    std::string hint;
    if (failure.code == ErrorCode::kUnknownFrame)
        hint =
            store::did_you_mean(*store_, failure.commit, store::unknown_of(failure, question).name);
    store::raise_failure(failure, question, name_of, hint);
}

}  // namespace tfdb
