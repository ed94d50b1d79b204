// Every error of the core: one class per thing that can go wrong, with machine-readable fields.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace tfdb {

enum class ErrorCode : std::uint8_t {
    kUnknownFrame,
    kDisconnected,
    kExtrapolation,
    kGapTooLarge,
    kStale,
    kNoSampleNear,
    kInvalidTransform,
    kTooOld,
    kStaticConflict,
    kRepeatedStamp,
    kCycle,
    kFrameInUse,
    kInvalidStamp,
    kInvalidName,
    kInvalidArgument,
    kCorruptMessage,
    kSnapshotTooOld,
    kSnapshotClosed,
    kWatchClosed,
    kCapacityExceeded,
    kConflict,
    kTransactionClosed,
    kTransactionActive,
    kWrongThread,
    kForked,
    kFeedLapped,
    kGone,
    kOutOfOrder,
    kFenced,
    kNotSupported,
    kNoSuchStore,
    kStoreExists,
    kCorruptStore,
    kReadOnly,
    kLockTimeout,
    kBufferClosed,
    kWaitTimeout,
};

/// A rejected member of a batch, and the reason.
struct RefusedMember {
    std::size_t index = 0;  // in the batch
    ErrorCode code = ErrorCode::kInvalidTransform;
    std::string message;
    std::string reason;
};

/// The fields of an error. Only those that the code's class documents are filled.
struct ErrorDetail {
    std::string target;     // frame into which the lookup transforms
    std::string source;     // frame from which it transforms; of ReadOnly: the frame's owner
    std::string edge;       // child frame of the edge that failed
    std::string parent;     // its parent at that stamp
    std::string frame;      // the frame that the error is about
    std::string authority;  // name of the writer
    std::vector<std::string> frames;    // children in use, frames of a cycle, or the two roots
    std::string expectation;            // name whose lifespan has ended
    std::string reason;                 // "past", "future", "no data", or which field and why
    std::optional<std::int64_t> stamp;  // requested or rejected, ns
    // Stamps; commit numbers for change queries.
    std::optional<std::int64_t> oldest;
    std::optional<std::int64_t> newest;
    std::optional<std::int64_t> before;
    std::optional<std::int64_t> after;
    std::optional<std::int64_t> limit;    // max_gap, max_age, tolerance, history, ns
    std::optional<std::uint64_t> index;   // position in the batch
    std::optional<std::uint64_t> offset;  // position in the message's bytes
    std::optional<std::uint64_t> commit;  // requested snapshot
    std::optional<std::uint64_t> since;   // commit after which changes were requested
    std::string path;                     // of a store's file
    std::optional<std::int64_t> pid;      // of the process that holds the lock or the store
    std::vector<RefusedMember> refused;   // every refused member of a batch, in its order
};

/// Root of all errors. Threads: a value. Guarantee: after a throw the store is unchanged.
class Error : public std::runtime_error {
public:
    Error(ErrorCode code, const std::string& message, ErrorDetail detail = {})
        : std::runtime_error(message), code_(code), detail_(std::move(detail)) {}

    [[nodiscard]] ErrorCode code() const noexcept { return code_; }
    [[nodiscard]] const ErrorDetail& detail() const noexcept { return detail_; }
    [[nodiscard]] ErrorDetail& detail() noexcept { return detail_; }

private:
    ErrorCode code_;
    ErrorDetail detail_;
};

/// One class for each code, so that C++ callers can catch a single kind.
template <ErrorCode Code>
class ErrorOf : public Error {
public:
    explicit ErrorOf(const std::string& message, ErrorDetail detail = {})
        : Error(Code, message, std::move(detail)) {}
};

using UnknownFrame = ErrorOf<ErrorCode::kUnknownFrame>;
using Disconnected = ErrorOf<ErrorCode::kDisconnected>;
using Extrapolation = ErrorOf<ErrorCode::kExtrapolation>;
using GapTooLarge = ErrorOf<ErrorCode::kGapTooLarge>;
using Stale = ErrorOf<ErrorCode::kStale>;
using NoSampleNear = ErrorOf<ErrorCode::kNoSampleNear>;
using InvalidTransform = ErrorOf<ErrorCode::kInvalidTransform>;
using TooOld = ErrorOf<ErrorCode::kTooOld>;
using StaticConflict = ErrorOf<ErrorCode::kStaticConflict>;
using RepeatedStamp = ErrorOf<ErrorCode::kRepeatedStamp>;
using CycleError = ErrorOf<ErrorCode::kCycle>;
using FrameInUse = ErrorOf<ErrorCode::kFrameInUse>;
using InvalidStamp = ErrorOf<ErrorCode::kInvalidStamp>;
using InvalidName = ErrorOf<ErrorCode::kInvalidName>;
using InvalidArgument = ErrorOf<ErrorCode::kInvalidArgument>;
using SnapshotTooOld = ErrorOf<ErrorCode::kSnapshotTooOld>;
using SnapshotClosed = ErrorOf<ErrorCode::kSnapshotClosed>;
using WatchClosed = ErrorOf<ErrorCode::kWatchClosed>;
using CapacityExceeded = ErrorOf<ErrorCode::kCapacityExceeded>;
using Conflict = ErrorOf<ErrorCode::kConflict>;
using TransactionClosed = ErrorOf<ErrorCode::kTransactionClosed>;
using TransactionActive = ErrorOf<ErrorCode::kTransactionActive>;
using WrongThread = ErrorOf<ErrorCode::kWrongThread>;
using Forked = ErrorOf<ErrorCode::kForked>;
using FeedLapped = ErrorOf<ErrorCode::kFeedLapped>;
using Gone = ErrorOf<ErrorCode::kGone>;
using OutOfOrder = ErrorOf<ErrorCode::kOutOfOrder>;
using Fenced = ErrorOf<ErrorCode::kFenced>;
using NotSupported = ErrorOf<ErrorCode::kNotSupported>;
using NoSuchStore = ErrorOf<ErrorCode::kNoSuchStore>;
using StoreExists = ErrorOf<ErrorCode::kStoreExists>;
using CorruptStore = ErrorOf<ErrorCode::kCorruptStore>;
using ReadOnly = ErrorOf<ErrorCode::kReadOnly>;
using LockTimeout = ErrorOf<ErrorCode::kLockTimeout>;
using BufferClosed = ErrorOf<ErrorCode::kBufferClosed>;
using WaitTimeout = ErrorOf<ErrorCode::kWaitTimeout>;

/// A message whose bytes contradict its format. Fields: offset, reason.
class CorruptMessage : public ErrorOf<ErrorCode::kCorruptMessage> {
public:
    CorruptMessage(std::size_t offset, const std::string& reason)
        : ErrorOf("corrupt message at byte " + std::to_string(offset) + ": " + reason,
                  make_detail(offset, reason)) {}

private:
    static ErrorDetail make_detail(std::size_t offset, const std::string& reason) {
        ErrorDetail detail;
        detail.offset = offset;
        detail.reason = reason;
        return detail;
    }
};

}  // namespace tfdb
