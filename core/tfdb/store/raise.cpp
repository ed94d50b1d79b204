// From a Failure to the typed error: names looked up, and a message that a person can act on.
#include <string>

#include "tfdb/store/attempt_errors.hpp"
#include "tfdb/store/impl.hpp"
#include "tfdb/store/validate.hpp"

namespace tfdb {
namespace {

using store::quoted;
using store::seconds;

struct Context {
    const Failure& failure;
    std::string_view target;
    std::string_view source;
    std::string frame;
    std::string other;
    ErrorDetail detail;

    [[nodiscard]] std::string path() const {
        return "T[" + quoted(target) + "<-" + quoted(source) + "]";
    }
    [[nodiscard]] std::string edge() const {
        return "edge T[" + quoted(other) + "<-" + quoted(frame) + "]";
    }
};

std::optional<std::int64_t> known(StampNs stamp) {
    return stamp < 0 ? std::nullopt : std::optional<std::int64_t>(stamp);
}

[[noreturn]] void raise_unknown(Context& c) {
    const int argument = c.failure.argument;
    if (argument == 0)
        c.detail.frame = c.target;
    if (argument == 1)
        c.detail.frame = c.source;
    const std::string role =
        argument == 0 ? "target frame " : (argument == 1 ? "source frame " : "fixed frame ");
    const std::string name = argument == 2 ? std::string() : quoted(c.detail.frame) + " ";
    const std::string message =
        role + name + "does not exist in commit " + std::to_string(c.failure.commit);
    throw UnknownFrame(message, std::move(c.detail));
}

[[noreturn]] void raise_disconnected(Context& c) {
    c.detail.frames = {c.frame, c.other};
    const std::string message = c.path() + " has no answer: the frames are in two trees, " +
                                quoted(c.target) + " under root " + quoted(c.frame) + " and " +
                                quoted(c.source) + " under root " + quoted(c.other);
    throw Disconnected(message, std::move(c.detail));
}

[[noreturn]] void raise_extrapolation(Context& c) {
    const Failure& f = c.failure;
    const bool future = f.direction > 0;
    c.detail.reason = future ? "future" : "past";
    const StampNs end = future ? f.newest : f.oldest;
    const StampNs distance = future ? f.stamp - f.newest : f.oldest - f.stamp;
    const std::string message =
        c.path() + " at " + seconds(f.stamp) + " would need extrapolation by " + seconds(distance) +
        " into the " + c.detail.reason + ": " + c.edge() +
        (future ? " has data up to " : " has data from ") + seconds(end) + " only (it covers " +
        seconds(f.oldest) + " to " + seconds(f.newest) + ")" +
        store::likely_meant(f.stamp, f.oldest, f.newest);
    throw Extrapolation(message, std::move(c.detail));
}

[[noreturn]] void raise_gap(Context& c) {
    const Failure& f = c.failure;
    const std::string message = c.path() + " at " + seconds(f.stamp) + " was refused: " + c.edge() +
                                " has no sample for " + seconds(f.after - f.before) + " between " +
                                seconds(f.before) + " and " + seconds(f.after) +
                                ", more than max_gap = " + seconds(f.limit);
    throw GapTooLarge(message, std::move(c.detail));
}

[[noreturn]] void raise_stale(Context& c) {
    const Failure& f = c.failure;
    const std::string message = c.path() + " at " + seconds(f.stamp) + " was refused: " + c.edge() +
                                " has its newest usable sample at " + seconds(f.before) + ", " +
                                seconds(f.stamp - f.before) +
                                " old, more than max_age = " + seconds(f.limit);
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
        (exact ? ", not at that very stamp" : ", farther than tolerance = " + seconds(f.limit));
    throw NoSampleNear(message, std::move(c.detail));
}

}  // namespace

void store::raise_failure(const Failure& failure, std::string_view target, std::string_view source,
                          CommitNumber committed, const NameOf& name) {
    Context c{failure, target, source, {}, {}, {}};
    c.frame = name(failure.frame);
    c.other = name(failure.other);
    c.detail.target = target;
    c.detail.source = source;
    c.detail.stamp = known(failure.stamp);
    c.detail.oldest = known(failure.oldest);
    c.detail.newest = known(failure.newest);
    c.detail.before = known(failure.before);
    c.detail.after = known(failure.after);
    if (failure.limit < lookup::kNoLimit)
        c.detail.limit = known(failure.limit);
    c.detail.commit = failure.commit;
    if (failure.code == ErrorCode::kUnknownFrame)
        raise_unknown(c);
    if (failure.code == ErrorCode::kDisconnected)
        raise_disconnected(c);
    if (failure.code == ErrorCode::kSnapshotTooOld) {
        store::throw_snapshot_too_old(failure.commit, committed);
    }
    c.detail.edge = c.frame;
    c.detail.parent = c.other;
    if (failure.code == ErrorCode::kGapTooLarge)
        raise_gap(c);
    if (failure.code == ErrorCode::kStale)
        raise_stale(c);
    if (failure.code == ErrorCode::kNoSampleNear)
        raise_not_near(c);
    if (failure.code == ErrorCode::kCycle) {
        const std::string message = c.path() + " runs in a circle at frame " + quoted(c.frame);
        throw CycleError(message, std::move(c.detail));
    }
    raise_extrapolation(c);
}

void Reads::raise(const Failure& failure, std::string_view target, std::string_view source) const {
    store::raise_failure(failure, target, source, impl_->committed(), [this](FrameId id) {
        return id == kNoFrame ? std::string() : impl_->names.name(id);
    });
}

}  // namespace tfdb
