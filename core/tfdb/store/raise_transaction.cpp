#include "tfdb/store/raise.hpp"

#include "tfdb/store/validate.hpp"

namespace tfdb::store {
namespace {

std::string describe(const history::EdgeChange& change) {
    using history::Change;
    switch (change.change) {
        case Change::kNone:
            return "changed";
        case Change::kNewer:
            return "a newer sample at " + seconds(change.stamp);
        case Change::kLate:
            return "a late sample at " + seconds(change.stamp);
        case Change::kReparent:
            return "re-parented at " + seconds(change.stamp);
        case Change::kStatic:
            return "a static pose was stored";
        case Change::kCleared:
            return "cleared";
        case Change::kForgotten:
            return "the retained history now begins at " + seconds(change.stamp);
    }
    return "more new samples than are kept";
}

}  // namespace

void throw_conflict(const txn::ReadConflict& conflict, CommitNumber since, const NameOf& name) {
    ErrorDetail detail;
    detail.commit = since;
    const std::string frame =
        conflict.kind == txn::ReadConflict::kNewName ? conflict.name : name(conflict.frame);
    std::string what = "frame " + quoted(frame);
    detail.frame = frame;
    switch (conflict.kind) {
        case txn::ReadConflict::kRemoved:
            detail.reason = "removed";
            break;
        case txn::ReadConflict::kNewName:
            detail.reason = "a new frame of that name";
            break;
        case txn::ReadConflict::kChildren:
            detail.reason = "other children";
            break;
        case txn::ReadConflict::kNone:
        case txn::ReadConflict::kEdge:
            detail.edge = frame;
            detail.reason = describe(conflict.change);
            if (conflict.change.stamp >= 0)
                detail.stamp = conflict.change.stamp;
            what = "the edge of " + what;
    }
    const std::string message = "the data that the transaction read at commit " +
                                std::to_string(since) + " have changed: " + what + ": " +
                                detail.reason + "; nothing was stored, run it again";
    throw Conflict(message, std::move(detail));
}

void throw_lost(std::string_view reason, CommitNumber since) {
    ErrorDetail detail;
    detail.reason = reason;
    detail.commit = since;
    const std::string message =
        "the transaction was aborted: " + detail.reason + "; nothing was stored, run it again";
    throw Conflict(message, std::move(detail));
}

void throw_cycle_of(const txn::CommitOutcome& outcome, std::string_view authority,
                    const NameOf& name) {
    const std::string parent = name(outcome.parent);
    const std::string child = name(outcome.child);
    const bool is_static = outcome.stamp == history::kStaticStamp;
    const TransformView transform{parent, child, is_static ? 0 : outcome.stamp, {}};
    Error fault = cycle_fault(transform, 0, is_static, authority);
    fault.detail().index.reset();
    throw CycleError(fault.what(), std::move(fault.detail()));
}

}  // namespace tfdb::store
