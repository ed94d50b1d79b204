// Ids and limits shared by every room.
#pragma once

#include <cstddef>
#include <cstdint>

namespace tfdb {

/// Byte offset inside a store's region. Zero is never a valid block.
using Offset = std::uint64_t;

/// Number of a commit; the empty store is commit 0.
using CommitNumber = std::uint64_t;

/// A frame's slot in the frame table. It is reused only after the frame was removed.
using FrameId = std::uint32_t;

inline constexpr unsigned kFrameBits = 20;
inline constexpr unsigned kCommitBits = 44;

/// "No frame": also the greatest value of the frame field of a packed word.
inline constexpr FrameId kNoFrame = (FrameId{1} << kFrameBits) - 1;
inline constexpr std::uint32_t kMaxFrames = kNoFrame;
inline constexpr CommitNumber kMaxCommit = (CommitNumber{1} << kCommitBits) - 1;
inline constexpr std::size_t kMaxNameBytes = 1024;

static_assert(kFrameBits + kCommitBits == 64, "commit and frame share one 64-bit word");

}  // namespace tfdb
