#include "tfdb/store/attempt_errors.hpp"

#include "tfdb/store/validate.hpp"

namespace tfdb::store {
namespace {

constexpr std::size_t kNamedChildren = 8;

std::string by(std::string_view authority) {
    return authority.empty() ? std::string() : " from " + quoted(authority);
}

std::string edge_name(const TransformView& transform) {
    return "T[" + quoted(transform.parent) + "<-" + quoted(transform.child) + "]";
}

ErrorDetail detail_of(const TransformView& transform, std::size_t index,
                      std::string_view authority) {
    ErrorDetail detail;
    detail.edge = transform.child;
    detail.parent = transform.parent;
    detail.authority = authority;
    detail.index = index;
    detail.stamp = transform.stamp;
    return detail;
}

/// The one name of a call was refused.
[[noreturn]] void refuse(Error error) {
    Refusals refusals;
    error.detail().index = 0;
    refusals.add(std::move(error));
    refusals.raise("1 frame");
}

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
        case Change::kUnknown:
            break;
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
    const std::string message = "what the transaction read at commit " + std::to_string(since) +
                                " has changed: " + what + ": " + detail.reason +
                                "; nothing was stored, run it again";
    throw Conflict(message, std::move(detail));
}

void throw_lost(std::string_view reason, CommitNumber since) {
    ErrorDetail detail;
    detail.reason = reason;
    detail.commit = since;
    const std::string message =
        "the transaction lost: " + detail.reason + "; nothing was stored, run it again";
    throw Conflict(message, std::move(detail));
}

void throw_cycle_of(const txn::Settled& settled, std::string_view authority, const NameOf& name) {
    const std::string parent = name(settled.parent);
    const std::string child = name(settled.child);
    const StampNs stamp = settled.stamp < 0 ? 0 : settled.stamp;
    const TransformView transform{parent, child, stamp, {}};
    Error fault = cycle_fault(transform, 0, authority);
    fault.detail().index.reset();
    throw CycleError(fault.what(), std::move(fault.detail()));
}

Error static_conflict(const TransformView& transform, std::size_t index, bool is_static,
                      std::string_view authority) {
    return StaticConflict(edge_name(transform) + by(authority) + " is " +
                              (is_static ? "static, but the edge has moving samples"
                                         : "moving, but the edge is static") +
                              ": remove frame " + quoted(transform.child) + " first",
                          detail_of(transform, index, authority));
}

Error too_old(const TransformView& transform, std::size_t index, StampNs newest, StampNs history,
              std::string_view authority) {
    ErrorDetail detail = detail_of(transform, index, authority);
    detail.newest = newest;
    detail.oldest = newest - history;
    detail.limit = history;
    return TooOld(edge_name(transform) + " at " + seconds(transform.stamp) + by(authority) +
                      " is older than the retained history: stamps from " +
                      seconds(newest - history) + " on are taken",
                  std::move(detail));
}

void throw_frame_unknown(std::string_view name) {
    ErrorDetail detail;
    detail.frame = name;
    refuse(UnknownFrame("frame " + quoted(name) + " does not exist: nothing was removed",
                        std::move(detail)));
}

void throw_frame_in_use(std::string_view name, std::span<const FrameId> children,
                        const NameOf& name_of) {
    ErrorDetail detail;
    detail.frame = name;
    std::string list;
    for (const FrameId child : children) {
        detail.frames.push_back(name_of(child));
        if (detail.frames.size() <= kNamedChildren)
            list += (list.empty() ? "" : ", ") + quoted(detail.frames.back());
    }
    if (detail.frames.size() > kNamedChildren)
        list += ", ...";
    refuse(FrameInUse("frame " + quoted(name) + " is the parent of " + list +
                          ": remove those first, or pass recursive=True",
                      std::move(detail)));
}

}  // namespace tfdb::store
