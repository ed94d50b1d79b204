// How one frame's history lies in the region: the header's words, the ring's block, the slots.
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
/// touches; line 2 is for the less usual reads; line 3 is the writer's bookkeeping.
enum HeaderWord : unsigned {
    kRing = 0,        // block / 64, log2 capacity, version: see RingWord
    kHead = 1,        // index of the next sample; indices grow for ever, slot = index mod capacity
    kBegin = 2,       // lowest index that is not (about to be) overwritten
    kTopology = 3,    // the one parent, flags, depth hint: see Topology
    kHeadCommit = 4,  // of the sample at head - 1; greater by one after an abort
    kNewest = 5,      // greatest stamp of the segment after the last clear, or kNoStamp
    kRate = 6,        // samples per ns as a double's bits: where to guess
    kBorn = 7,        // commit that made the frame << kFrameBits | generation
    kOrder = 8,       // runs << 32 | slack
    kSortedEnd = 9,   // below it the samples lie in stamp order, not in commit order
    kSortedCommit = 10,  // ... and all of them are of this commit or older
    kCleared = 11,       // index + 1 of the last clear marker
    kEvictSafe = 12,     // snapshots from this commit on miss nothing that was overwritten
    kDied = 13,          // commit that removed the frame, 0 while it lives
    kName = 14,          // block of the name: length, then bytes
    kLock = 15,          // for engines that lock frames
    kChildren = 16,      // how many frames have this one as their newest parent
    kAuthority = 17,     // id of who wrote last
    kLate = 18,          // samples that came out of order
    kNextFree = 19,      // id + 1 of the next removed frame that waits for reuse
    kOrderedFrom = 20,   // from this index on stamps rise strictly
    kParentFrom = 21,    // from this index on the parent is the same
    kTouched = 22,       // attempt that wrote here last: see txn::Commit
    kHeaderWords = 24,
};

inline constexpr std::size_t kHeaderBytes = kHeaderWords * 8;
static_assert(kHeaderBytes % memory::kLineBytes == 0, "headers are whole cache lines");

/// Stamps that are no times.
inline constexpr StampNs kNoStamp = -1;
inline constexpr StampNs kStaticStamp = -2;  // the pose is valid at every stamp
inline constexpr StampNs kClearMarker = -3;  // hides what lies before it

/// History of a store that forgets nothing.
inline constexpr StampNs kForever = clock::kMaxStamp;

inline constexpr std::uint64_t kNoIndex = ~std::uint64_t{0};
inline constexpr unsigned kMaxRuns = 8;

constexpr StampNs as_stamp(std::uint64_t word) {
    return static_cast<StampNs>(word);
}
constexpr std::uint64_t as_word(StampNs stamp) {
    return static_cast<std::uint64_t>(stamp);
}

/// Sizes that matter for speed only. Tests that walk every interleaving specialise them to be tiny.
template <class Memory>
struct Tuning {
    static constexpr unsigned kFirstLog2Capacity = 3;
    static constexpr unsigned kMaxRuns = history::kMaxRuns;
    static constexpr std::uint64_t kSlackLimit = 32;  // lateness in positions that starts no run
    static constexpr unsigned kFirstNamesLog2 = 6;    // entries of the first name table
};

/// The word that says where a ring is. The version makes a block that was freed and used again
/// a different word.
struct RingWord {
    static constexpr unsigned kVersionBits = 24;
    static constexpr unsigned kLog2Bits = 6;

    static constexpr std::uint64_t pack(Offset block, unsigned log2_capacity,
                                        std::uint64_t version) {
        return (block / memory::kLineBytes) << (kLog2Bits + kVersionBits) |
               std::uint64_t{log2_capacity} << kVersionBits |
               (version & ((std::uint64_t{1} << kVersionBits) - 1));
    }
    static constexpr Offset block(std::uint64_t word) {
        return (word >> (kLog2Bits + kVersionBits)) * memory::kLineBytes;
    }
    static constexpr unsigned log2_capacity(std::uint64_t word) {
        return static_cast<unsigned>(word >> kVersionBits) & ((1U << kLog2Bits) - 1);
    }
    static constexpr std::uint64_t capacity(std::uint64_t word) {
        return std::uint64_t{1} << log2_capacity(word);
    }
    static constexpr std::uint64_t version(std::uint64_t word) {
        return word & ((std::uint64_t{1} << kVersionBits) - 1);
    }
    static constexpr bool empty(std::uint64_t word) { return block(word) == 0; }

    /// Stands in while an abort puts the header back. It counts as empty, so only readers of empty
    /// rings need to ask.
    static constexpr std::uint64_t busy(std::uint64_t version) {
        return pack(0, (1U << kLog2Bits) - 1, version);
    }
    static constexpr bool is_busy(std::uint64_t word) { return word == busy(version(word)); }
};

/// The word that tells most of what a path needs to know about a frame.
struct Topology {
    static constexpr std::uint64_t kParentMask = kNoFrame;
    static constexpr std::uint64_t kMixedParents = 1ULL << 20;  // ask the samples for the parent
    static constexpr std::uint64_t kUnordered = 1ULL << 21;     // stamps do not rise strictly
    static constexpr std::uint64_t kStatic = 1ULL << 22;
    static constexpr std::uint64_t kCleared = 1ULL << 23;   // the ring holds a clear marker
    static constexpr std::uint64_t kMortal = 1ULL << 24;    // the frame was removed: see kDied
    static constexpr std::uint64_t kRebuilt = 1ULL << 25;   // see kSortedEnd
    static constexpr std::uint64_t kParented = 1ULL << 26;  // some sample named it as its parent
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

/// First word of a slot: who wrote it and the parent.
struct SlotWord {
    static constexpr std::uint64_t pack(CommitNumber commit, FrameId parent) {
        return commit << kFrameBits | parent;
    }
    static constexpr CommitNumber commit(std::uint64_t word) { return word >> kFrameBits; }
    static constexpr FrameId parent(std::uint64_t word) {
        return static_cast<FrameId>(word & kNoFrame);
    }
};

/// A ring's block: one line with the starts of its runs, the stamps, the slots.
template <class Memory>
struct RingLayout {
    static constexpr std::size_t kSlotBytes = 8 * (1 + Memory::kPayloadWords);

    static constexpr std::size_t bytes(std::uint64_t capacity) {
        return memory::kLineBytes + memory::round_up(8 * capacity, memory::kLineBytes) +
               kSlotBytes * capacity;
    }
    static constexpr Offset stamps(std::uint64_t ring_word) {
        return RingWord::block(ring_word) + memory::kLineBytes;
    }
    static constexpr Offset slots(std::uint64_t ring_word) {
        return stamps(ring_word) +
               memory::round_up(8 * RingWord::capacity(ring_word), memory::kLineBytes);
    }
};

}  // namespace tfdb::history
