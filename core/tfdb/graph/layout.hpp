// The words of a store's own header: the commit word, the lock, the frame table, the name table.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "tfdb/base/types.hpp"
#include "tfdb/memory/memory.hpp"

namespace tfdb::graph {

/// Words of the root block. Each of the first three has a cache line of its own.
enum StoreWord : unsigned {
    kCommit = 0,       // newest published commit: the one linearization point
    kEpoch = 1,        // see history::AsOf
    kHeldPins = 8,     // pins of held states: see Pins
    kCommitLock = 16,  // see sync::CommitLock
    kFrameCount = 24,  // frame table slots that were ever used
    kFreeHead = 25,    // id + 1 of the frame that was removed first and whose slot waits for reuse
    kFreeTail = 26,
    kNames = 27,         // block of the name table: see TableWord
    kNamesFilled = 28,   // used entries of the name table, including dead ones
    kRecycleFloor = 29,  // older snapshots may lack frames whose slots were reused
    kNormalised = 30,
    kFreeFull = 31,    // id + 1 of the first removed frame that still has its name and samples
    kReadPins = 32,    // pins of repeated reads, which a writer overtook before: see Pins
    kHeldBytes = 40,   // bytes that only held states still show
    kGivenUp = 41,     // older held states were dropped because they kept too much memory
    kFeed = 42,        // block of the change feed, 0 if the store keeps none: see txn::Feed
    kFeedFloor = 43,   // the oldest commit that the feed holds completely
    kFeedLimit = 44,   // the position up to which its ring has space
    kLifeNumber = 45,  // of the store's epoch, which numbers its commits: see wire::Epoch
    kLifeHigh = 46,
    kLifeLow = 47,
    // Options of the store.
    kFrameTable = 48,
    kMaxFrameCount = 49,
    kHistory = 50,
    kSnapshotMemory = 51,
    kAuthorities = 52,  // newest entry of a list of names: see store::Authorities
    kPositions = 53,    // newest entry of a list: see store::Positions
    kOrigin = 55,       // of a frozen store: a text about its source, or 0: see store::freeze
    kStoreWords = 56,
};

/// Words of one set of pins, including padding that puts two sets into different cache lines.
inline constexpr unsigned kPinWords = 8;

/// The word that points to the name table. Its version distinguishes a block that was freed and
/// reused.
struct TableWord {
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
    /// Upper bound of a table's entries, even if a damaged word claims more.
    static constexpr unsigned kMostLog2 = kFrameBits + 6;
    static constexpr std::uint64_t capacity(std::uint64_t word) {
        return std::uint64_t{1} << std::min(log2_capacity(word), kMostLog2);
    }
    static constexpr std::uint64_t version(std::uint64_t word) {
        return word & ((std::uint64_t{1} << kVersionBits) - 1);
    }
    static constexpr bool empty(std::uint64_t word) { return block(word) == 0; }
};

inline constexpr std::size_t kStoreBytes = kStoreWords * 8;

}  // namespace tfdb::graph
