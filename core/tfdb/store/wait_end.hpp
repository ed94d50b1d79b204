// The outcome of a wait.
#pragma once

#include <cstdint>

namespace tfdb {

enum class WaitEnd : std::uint8_t {
    kCame,      // the awaited answer or commit arrived
    kTimedOut,  // it did not arrive in time
    kClosed,    // waits have been ended
    kRemoved,   // the store's name was removed meanwhile
    kStopped,   // waits were stopped: as kTimedOut, but at once
};

struct EndedWait {
    std::uint64_t number = 0;
    WaitEnd how = WaitEnd::kCame;
};

}  // namespace tfdb
