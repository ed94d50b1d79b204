// How a wait ended.
#pragma once

#include <cstdint>

namespace tfdb {

enum class WaitEnd : std::uint8_t {
    kCame,      // what was waited for
    kTimedOut,  // it has not
    kClosed,    // no further waits are taken
    kRemoved,   // the store's name was removed meanwhile
    kStopped,   // nothing will be waited for here any more: as kTimedOut, but at once
};

struct EndedWait {
    std::uint64_t number = 0;
    WaitEnd how = WaitEnd::kCame;
};

}  // namespace tfdb
