// EdgeView: finding out what a snapshot sees when it is not simply everything.
#pragma once

#include <algorithm>

#include "tfdb/history/edge_view.hpp"

namespace tfdb::history {

/// Greatest end of [floor, hi) whose last sample is of this snapshot or older. Commits never fall
/// along that range, so gallop back and then halve.
template <class Memory>
std::uint64_t EdgeView<Memory>::walk_back(std::uint64_t floor) const {
    std::uint64_t hidden = hi_;  // everything from here on is too new
    std::uint64_t step = 1;
    std::uint64_t seen = floor;
    while (hidden > floor) {
        const std::uint64_t probe = hidden - floor > step ? hidden - step : floor;
        if (SlotWord::commit(slot_word(probe)) <= snapshot_) {
            seen = probe + 1;
            break;
        }
        hidden = probe;
        step *= 2;
    }
    while (seen < hidden) {
        const std::uint64_t middle = seen + (hidden - seen) / 2;
        if (SlotWord::commit(slot_word(middle)) <= snapshot_) {
            seen = middle + 1;
        } else {
            hidden = middle;
        }
    }
    return seen;
}

template <class Memory>
void EdgeView<Memory>::open_unusual(bool newer) {
    std::uint64_t floor = lo_;
    if ((topology_ & Topology::kRebuilt) != 0) {
        if (snapshot_ < word(kSortedCommit).load_relaxed())
            return open_scan();
        floor = std::max(floor, word(kSortedEnd).load_relaxed());
    }
    if (hi_ < floor)
        floor = hi_;
    if (newer)
        hi_ = walk_back(floor);
    if (hi_ < lo_)
        hi_ = lo_;
    if ((topology_ & Topology::kCleared) != 0) {
        const std::uint64_t cleared = word(kCleared).load_relaxed();
        if (cleared > hi_)
            return open_scan();
        lo_ = std::max(lo_, cleared);
        cleared_ = true;
    }
    if ((topology_ & Topology::kUnordered) != 0)
        mode_ = Mode::kRuns;
}

/// Looks at every sample of the ring, in the order in which they were committed or sorted. Right
/// for any snapshot, and only needed by those older than a clear or a rebuild.
template <class Memory>
void EdgeView<Memory>::open_scan() {
    mode_ = Mode::kScan;
    hi_ = std::max(word(kHead).load_acquire(), lo_);
    for (std::uint64_t i = lo_; i < hi_; ++i) {
        if (!visible(i))
            continue;
        const StampNs stamp = stamp_at(i);
        if (stamp == kClearMarker) {
            lo_ = i + 1;
            cleared_ = true;
            scan_last_ = kNoIndex;
            continue;
        }
        scan_last_ = i;
        scan_static_ = stamp == kStaticStamp;
    }
    if (scan_last_ == kNoIndex)
        hi_ = lo_;
}

}  // namespace tfdb::history
