// What every engine offers: how one operation or transaction reads and writes.
#pragma once

#include <concepts>
#include <cstdint>
#include <span>

#include "tfdb/base/types.hpp"
#include "tfdb/lookup/view.hpp"

namespace tfdb::txn {

/// Beside others, as the engine orders it; or with nothing else that writes under way.
enum class Mode : std::uint8_t { kBesideOthers, kAlone };

/// One operation or transaction in flight, made from its store's engine and reused by its next
/// attempts. All but `pause` happen between `begin` and `end`; the destructor ends what is open.
///
/// A lookup: begin, read through `view`, `confirm`, end. Where `view` answers kLapped or `confirm`
/// is false, the attempt is given up: end(false), pause, begin again.
/// A write beside others: begin, `lock` the frames, `confirm`, append with `take_ticket`,
/// end(true). Anything else: begin(kAlone), or `become_alone` once it turns out to be needed, then
/// txn::Commit.
template <class S>
concept Session = requires(S session, const S& constant, Mode mode, std::span<const FrameId> frames,
                           bool committed) {
    typename S::Memory;
    requires lookup::View<typename S::View>;
    /// Whether writes that only append to existing edges may go beside others.
    { S::kWritesBesideOthers } -> std::convertible_to<bool>;
    /// Whether a transaction is validated: false only where the engine promises no isolation.
    { S::kIsolates } -> std::convertible_to<bool>;

    {session.begin(mode)};
    /// The forest as this session may read it. Its `open` may refuse (false): give up.
    { session.view() } -> std::same_as<typename S::View>;
    /// True if all that was read since `begin` is of one state, and still is that of now (of the
    /// snapshot, where reads come from one).
    { session.confirm() } -> std::same_as<bool>;
    /// A commit n such that everything read since `begin` is as commit n left it. Valid only if
    /// `confirm` is then true.
    { session.read_as_of() } -> std::same_as<CommitNumber>;
    /// Gets frames (ascending, each once) for writing. False: give up.
    { session.lock(frames) } -> std::same_as<bool>;
    /// The number of the commit that appends to the locked frames.
    { session.take_ticket() } -> std::same_as<CommitNumber>;
    /// Lets go of what is held and goes on alone. What was read before may have changed meanwhile:
    /// validate against `read_as_of`, asked before.
    {session.become_alone()};
    { constant.alone() } -> std::same_as<bool>;
    {session.end(committed)};
    /// Waits a little before the next attempt, longer each time.
    {session.pause()};
};

}  // namespace tfdb::txn
