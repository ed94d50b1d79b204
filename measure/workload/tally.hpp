// What one thread has counted, and all of them together.
#pragma once

#include <cstdint>

#include "histogram.hpp"

namespace tfdb::driver {

/// Operations of one kind. `done` counts those that ended within the measurement; `latency` also
/// has those that were still under way at its end, so that a starved one is not lost.
struct Lane {
    Histogram latency;
    std::uint64_t done = 0;
    std::uint64_t edges = 0;   // of those
    std::uint64_t failed = 0;  // the store had no answer, or refused
    std::uint64_t lost = 0;    // attempts of transactions that ended in a conflict
    std::uint64_t due = 0;     // operations with a deadline, those that were skipped included
    std::uint64_t met = 0;

    void add(const Lane& other) {
        latency.add(other.latency);
        done += other.done;
        edges += other.edges;
        failed += other.failed;
        lost += other.lost;
        due += other.due;
        met += other.met;
    }
};

struct Tally {
    Lane reads;
    Lane writes;
    Histogram age;     // now minus the oldest stamp used
    Histogram spread;  // newest minus oldest stamp used

    void add(const Tally& other) {
        reads.add(other.reads);
        writes.add(other.writes);
        age.add(other.age);
        spread.add(other.spread);
    }
};

}  // namespace tfdb::driver
