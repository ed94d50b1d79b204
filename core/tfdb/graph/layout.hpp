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
    kHeldPins = 8,     // held states: see Pins
    kCommitLock = 16,  // see sync::CommitLock
    kFrameCount = 24,  // slots of the frame table ever used
    kFreeHead = 25,    // id + 1 of the frame that was removed first and waits for reuse
    kFreeTail = 26,
    kNames = 27,         // where the name table is: see TableWord
    kNamesFilled = 28,   // its entries in use, dead ones included
    kRecycleFloor = 29,  // older snapshots may miss frames whose slots were reused
    kNormalised = 30,
    kFreeFull = 31,    // id + 1 of the first removed frame that still has its name and its samples
    kReadPins = 32,    // reads under way that were overtaken before: see Pins
    kHeldBytes = 40,   // that held states alone still show
    kGivenUp = 41,     // older states were given up, for they kept too much
    kFeed = 42,        // where the change feed is, 0 if none is kept: see txn::Feed
    kFeedFloor = 43,   // the oldest commit that is whole in it
    kFeedLimit = 44,   // up to this position its ring has room
    kLifeNumber = 45,  // of the store's epoch, in which its commits are numbered: see wire::Epoch
    kLifeHigh = 46,
    kLifeLow = 47,
    // What a store was made with.
    kFrameTable = 48,
    kMaxFrameCount = 49,
    kHistory = 50,
    kSnapshotMemory = 51,
    kAuthorities = 52,  // the newest of a list of names: see store::Authorities
    kPositions = 53,    // the newest of a list: see store::Positions
    kOrigin = 55,  // of a frozen store: a text on what it was made from, or 0: see store::freeze
    kStoreWords = 56,
};

/// Words of one set of pins, with those that keep two sets in different cache lines.
inline constexpr unsigned kPinWords = 8;

/// The word that leads to the name table. The version makes a block that was freed and used
/// again a different word.
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
    /// No table has more entries, whatever a damaged word says.
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
