// The words of a store's own header: the commit word, the lock, the frame table, the name table.
#pragma once

#include <cstddef>

#include "tfdb/base/types.hpp"

namespace tfdb::graph {

/// Words of the root block. Each of the first three has a cache line of its own.
enum StoreWord : unsigned {
    kCommit = 0,       // newest published commit: the one linearization point
    kPins = 8,         // how many snapshots are held, in three counts: see Pins
    kPinFloors = 11,   // what those are not older than
    kPinHint = 14,     // which count the next snapshot goes to
    kCommitLock = 16,  // see sync::CommitLock
    kLanes = 17,       // who waits for it with priority: see sync::PriorityLock
    kFrameCount = 24,  // slots of the frame table ever used
    kFreeHead = 25,    // id + 1 of the frame that was removed first and waits for reuse
    kFreeTail = 26,
    kNames = 27,         // where the name table is: a history::RingWord
    kNamesFilled = 28,   // its entries in use, dead ones included
    kRecycleFloor = 29,  // older snapshots may miss frames whose slots were reused
    kNormalised = 30,
    kFreeFull = 31,  // id + 1 of the first removed frame that still has its name and its samples
    kStoreWords = 32,
};

inline constexpr std::size_t kStoreBytes = kStoreWords * 8;

}  // namespace tfdb::graph
