// How one frame's history lies in the region: the header's words, versions, slots.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "tfdb/base/types.hpp"
#include "tfdb/clock/stamp.hpp"
#include "tfdb/memory/memory.hpp"

namespace tfdb::history {

using clock::StampNs;

/// Words of a frame's header, 8 bytes each. Line 1 is all that a lookup near the newest sample
/// touches of it.
enum HeaderWord : unsigned {
    kTail = 0,         // the segment with the newest samples: see SegmentWord
    kDirectory = 1,    // block that lists the segments before the tail, or 0
    kTopology = 2,     // the one parent, flags, depth hint: see Topology
    kSince = 3,        // older snapshots see the version at kOlder instead
    kBorn = 4,         // commit that made the frame << kFrameBits | generation
    kRate = 5,         // samples per ns in the tail, a double's bits: where to guess
    kChanged = 6,      // commit that wrote here last; too new by one after an abort
    kForgotten = 7,    // snapshots from this commit on miss nothing that was evicted
    kOlder = 8,        // block with the version before the last clear: see VersionWord
    kReshaped = 9,     // commit that last changed anything but the tail's end; as kChanged
    kParentFrom = 10,  // from this stamp on the parent is the same
    kLate = 11,        // samples that came out of order
    kDied = 12,        // commit that removed the frame, 0 while it lives
    kName = 13,        // block of the name: length, then bytes
    kChildren = 14,    // how many frames have this one as their newest parent
    kAuthority = 15,   // id of the last writer
    kLock = 16,        // for engines that lock frames
    kNextFree = 17,    // id + 1 of the next removed frame that waits for reuse
    kCorrected = 18,   // older snapshots miss samples that others of the same stamp replaced
    kLateSince = 19,   // commit that last counted in kLate; too new by one after an abort
    kLateBefore = 20,  // what kLate was before that
    kSource = 21,      // where the frame and its samples came from: see SourceWord
    kHeaderWords = 24,
};

inline constexpr std::size_t kHeaderBytes = kHeaderWords * 8;
static_assert(kHeaderBytes % memory::kLineBytes == 0, "headers are whole cache lines");

/// The sources, by number, whose commits were applied here: that of which one made the frame, and
/// that of which one stored the samples of its edge. 0: a writer of this store did.
struct SourceWord {
    static constexpr unsigned kBits = 20;
    /// Instead of a number: nothing was ever applied, so nothing is noted.
    static constexpr std::uint64_t kNoSources = ~std::uint64_t{0};
    static constexpr std::uint64_t pack(std::uint64_t maker, std::uint64_t writer) {
        return writer << kBits | maker;
    }
    static constexpr std::uint64_t maker(std::uint64_t word) {
        return word & ((std::uint64_t{1} << kBits) - 1);
    }
    static constexpr std::uint64_t writer(std::uint64_t word) { return word >> kBits; }
};

/// Stamps with a special meaning.
inline constexpr StampNs kNoStamp = -1;
inline constexpr StampNs kStaticStamp = -2;  // the pose is valid at every stamp

/// History of a store that forgets nothing.
inline constexpr StampNs kForever = clock::kMaxStamp;

constexpr StampNs as_stamp(std::uint64_t word) {
    return static_cast<StampNs>(word);
}
constexpr std::uint64_t as_word(StampNs stamp) {
    return static_cast<std::uint64_t>(stamp);
}

/// Sizes that matter for speed only. Tests that walk every interleaving specialise them to be tiny.
template <class Memory>
struct Tuning {
    static constexpr unsigned kFirstLog2 = 3;     // capacity of an edge's first segment
    static constexpr unsigned kFullLog2 = 8;      // ... of all but the first
    static constexpr unsigned kSmallLog2 = 6;     // ... of those that late samples split
    static constexpr unsigned kLargestLog2 = 11;  // ... where many samples are announced at once
    static constexpr unsigned kFanLog2 = 3;       // nodes of a directory in one node above them
    static constexpr std::size_t kKept = std::size_t{1}
                                         << 18;     // bytes that wait, for readers' sake
    static constexpr unsigned kFirstNamesLog2 = 6;  // entries of the first name table
};

/// The word with most of what a path needs of a frame.
struct Topology {
    static constexpr std::uint64_t kParentMask = kNoFrame;
    static constexpr std::uint64_t kMixedParents = 1ULL << 20;  // ask the samples for the parent
    static constexpr std::uint64_t kCleared = 1ULL << 22;       // this version began with a clear
    static constexpr std::uint64_t kMortal = 1ULL << 23;        // the frame was removed: see kDied
    static constexpr std::uint64_t kParented = 1ULL << 24;  // some sample named it as its parent
    static constexpr std::uint64_t kFlags = 0xFFFULL << kFrameBits;

    static constexpr FrameId parent(std::uint64_t word) {
        return static_cast<FrameId>(word & kParentMask);
    }
    static constexpr std::uint32_t depth(std::uint64_t word) {
        return static_cast<std::uint32_t>(word >> 32);
    }
    static constexpr std::uint64_t with_parent(std::uint64_t word, FrameId parent,
                                               std::uint32_t depth) {
        return (word & kFlags) | parent | std::uint64_t{depth} << 32;
    }
    /// A frame without samples.
    static constexpr std::uint64_t kRoot = kNoFrame;
};

/// Words of the block with a version that a clear replaced. It stays as it is; memory keeps words 5
/// to 7 of a retired block.
enum VersionWord : unsigned {
    kOldTail = 0,
    kOldDirectory = 1,
    kOldTopology = 2,
    kOldSince = 3,
    kOldOlder = 4,
    kOldEnd = 8,  // of the directory, which goes on to grow where the clear is taken back
};
inline constexpr std::size_t kVersionBytes = 128;
/// In kOlder: the clear was taken back, and the version goes on in the header. That clear's block
/// tells since when, and stays until the next clear.
inline constexpr std::uint64_t kTakenBack = 1;

/// First word of a slot: its commit and the parent.
struct SlotWord {
    /// Of a sample that was taken back: newer than every readable state.
    static constexpr CommitNumber kNever = kMaxCommit;

    static constexpr std::uint64_t pack(CommitNumber commit, FrameId parent) {
        return commit << kFrameBits | parent;
    }
    static constexpr CommitNumber commit(std::uint64_t word) { return word >> kFrameBits; }
    static constexpr FrameId parent(std::uint64_t word) {
        return static_cast<FrameId>(word & kNoFrame);
    }
};

}  // namespace tfdb::history
