// The interface of every engine: reads and writes of one operation or transaction.
#pragma once

#include <concepts>
#include <cstdint>
#include <span>

#include "tfdb/base/types.hpp"
#include "tfdb/lookup/view.hpp"

namespace tfdb::txn {

/// Concurrent with other sessions, as the engine orders it; or without any other writer.
enum class Mode : std::uint8_t { kBesideOthers, kAlone };

/// One operation or transaction in progress, created from its store's engine and reused by its next
/// attempts. All calls except `pause` happen between `begin` and `end`; the destructor ends an open
/// one.
///
/// A lookup: begin, read through `view`, `confirm`, end. If `view` answers kLapped or `confirm` is
/// false, the attempt ends: end(false), pause, begin again.
/// A concurrent write: begin, `lock` the frames, `confirm`, append with `take_ticket`, end(true).
/// All other writes: begin(kAlone), or `become_alone` once it turns out to be needed, then
/// txn::Commit.
template <class S>
concept Session = requires(S session, const S& constant, Mode mode, std::span<const FrameId> frames,
                           bool committed) {
    typename S::Memory;
    requires lookup::View<typename S::View>;
    /// Whether writes that only append to existing edges may run concurrently.
    { S::kWritesBesideOthers } -> std::convertible_to<bool>;
    /// Whether transactions are validated: false only for engines without isolation.
    { S::kIsolates } -> std::convertible_to<bool>;

    {session.begin(mode)};
    /// The forest as this session may read it. If its `open` returns false: end the attempt.
    { session.view() } -> std::same_as<typename S::View>;
    /// Whether all reads since `begin` are of one state that is still current (of the snapshot, if
    /// reads use one).
    { session.confirm() } -> std::same_as<bool>;
    /// A commit n such that everything read since `begin` is as commit n left it. Valid only if a
    /// later `confirm` is true.
    { session.read_as_of() } -> std::same_as<CommitNumber>;
    /// Locks frames (ascending, without duplicates) for writing. False: end the attempt.
    { session.lock(frames) } -> std::same_as<bool>;
    /// The number of the commit that appends to the locked frames.
    { session.take_ticket() } -> std::same_as<CommitNumber>;
    /// Releases its locks and continues alone. Earlier reads may be outdated: validate them against
    /// a `read_as_of` from before the call.
    {session.become_alone()};
    { constant.alone() } -> std::same_as<bool>;
    {session.end(committed)};
    /// Waits briefly before the next attempt, longer each time.
    {session.pause()};
};

}  // namespace tfdb::txn
