// The layout of one frame's history in the region: header words, versions, slots.
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

/// Words of a frame's header, 8 bytes each. A lookup near the newest sample reads line 1 only.
enum HeaderWord : unsigned {
    kTail = 0,         // the segment with the newest samples: see SegmentWord
    kDirectory = 1,    // block with the list of segments before the tail, or 0
    kTopology = 2,     // the one parent, flags, depth hint: see Topology
    kSince = 3,        // older snapshots see the version at kOlder instead
    kBorn = 4,         // commit that created the frame << kFrameBits | generation
    kRate = 5,         // samples per ns in the tail, a double's bits: for guesses
    kChanged = 6,      // last commit that wrote here; too high by one after an abort
    kForgotten = 7,    // snapshots from this commit on miss no evicted sample
    kOlder = 8,        // block with the version before the last clear: see VersionWord
    kReshaped = 9,     // last commit that changed more than the tail's end; as kChanged
    kParentFrom = 10,  // the parent is constant from this stamp on
    kLate = 11,        // number of out-of-order samples
    kDied = 12,        // commit that removed the frame, 0 while it exists
    kName = 13,        // block of the name: length, then bytes
    kChildren = 14,    // number of frames whose newest parent is this one
    kAuthority = 15,   // id of the last writer
    kLock = 16,        // for engines that lock frames
    kNextFree = 17,    // id + 1 of the next removed frame whose slot waits for reuse
    kCorrected = 18,   // older snapshots miss samples that others of equal stamp replaced
    kLateSince = 19,   // commit that last changed kLate; too high by one after an abort
    kLateBefore = 20,  // kLate before that commit
    kSource = 21,      // sources of the frame and its samples: see SourceWord
    kHeaderWords = 24,
};

inline constexpr std::size_t kHeaderBytes = kHeaderWords * 8;
static_assert(kHeaderBytes % memory::kLineBytes == 0, "headers are whole cache lines");

/// The numbers of the sources whose commits were applied here: the one that created the frame, and
/// the one that stored its edge's samples. 0: a writer of this store.
struct SourceWord {
    static constexpr unsigned kBits = 20;
    /// Replaces a number in a store that never applied a source's commits, so that none is
    /// recorded.
    static constexpr std::uint64_t kNoSources = ~std::uint64_t{0};
    /// The source has removed the frame, which has stayed for a child of a local writer.
    static constexpr std::uint64_t kLeft = std::uint64_t{1} << 63;
    static constexpr std::uint64_t pack(std::uint64_t maker, std::uint64_t writer) {
        return writer << kBits | maker;
    }
    static constexpr std::uint64_t maker(std::uint64_t word) {
        return word & ((std::uint64_t{1} << kBits) - 1);
    }
    static constexpr std::uint64_t writer(std::uint64_t word) { return (word & ~kLeft) >> kBits; }
    static constexpr std::uint64_t with_writer(std::uint64_t word, std::uint64_t writer) {
        return (word & kLeft) | pack(maker(word), writer);
    }
};

/// Stamps with a special meaning.
inline constexpr StampNs kNoStamp = -1;
inline constexpr StampNs kStaticStamp = -2;  // the pose is valid at every stamp

/// History of a store that never evicts.
inline constexpr StampNs kForever = clock::kMaxStamp;

constexpr StampNs as_stamp(std::uint64_t word) {
    return static_cast<StampNs>(word);
}
constexpr std::uint64_t as_word(StampNs stamp) {
    return static_cast<std::uint64_t>(stamp);
}

/// Sizes that affect only speed. Tests that explore every interleaving specialise them to be tiny.
template <class Memory>
struct Tuning {
    static constexpr unsigned kFirstLog2 = 3;     // capacity of an edge's first segment
    static constexpr unsigned kFullLog2 = 8;      // ... of all later ones
    static constexpr unsigned kSmallLog2 = 6;     // ... of those that late samples split
    static constexpr unsigned kLargestLog2 = 11;  // ... if many samples are reserved at once
    static constexpr unsigned kFanLog2 = 3;       // nodes of a directory per parent node
    static constexpr std::size_t kKept = std::size_t{1} << 18;  // retired bytes kept for readers
    static constexpr unsigned kFirstNamesLog2 = 6;              // entries of the first name table
};

/// The word that holds most of what a path needs of a frame.
struct Topology {
    static constexpr std::uint64_t kParentMask = kNoFrame;
    // the parent must be read from the samples
    static constexpr std::uint64_t kMixedParents = 1ULL << 20;
    static constexpr std::uint64_t kCleared = 1ULL << 22;   // this version began with a clear
    static constexpr std::uint64_t kMortal = 1ULL << 23;    // the frame was removed: see kDied
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

/// Words of the block that holds a version replaced by a clear. It never changes; memory keeps
/// words 5 to 7 of a retired block.
enum VersionWord : unsigned {
    kOldTail = 0,
    kOldDirectory = 1,
    kOldTopology = 2,
    kOldSince = 3,
    kOldOlder = 4,
    kOldEnd = 8,  // of the directory, which keeps growing if the clear is rolled back
};
inline constexpr std::size_t kVersionBytes = 128;
/// Flag in kOlder: the clear was rolled back, and the version continues in the header. The clear's
/// block holds the version's first commit, and stays until the next clear.
inline constexpr std::uint64_t kTakenBack = 1;

/// First word of a slot: the sample's commit and parent.
struct SlotWord {
    /// Commit of a sample that was rolled back: newer than every readable state.
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
