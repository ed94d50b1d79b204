// The outcome of a wait.
#pragma once

#include <cstdint>

namespace tfdb {

enum class WaitEnd : std::uint8_t {
    kCame,      // the awaited answer or commit arrived
    kTimedOut,  // it did not arrive in time
    // Of the ends of all waits, an earlier one replaces a later one.
    kClosed,   // waits have been ended
    kRemoved,  // the store was removed
    kStopped,  // waits were stopped: as kTimedOut, but at once
};

struct EndedWait {
    std::uint64_t number = 0;
    WaitEnd how = WaitEnd::kCame;
};

}  // namespace tfdb
