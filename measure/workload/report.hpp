// The one line that a driver prints.
#pragma once

#include <string>

#include "options.hpp"
#include "store.hpp"
#include "tally.hpp"

namespace tfdb::driver {

struct Outcome {
    double elapsed = 0.0;  // seconds measured
    Tally tally;
    StoreCounters counters;  // of the measurement alone
    double worst_value = 0.0;
    double edges_per_read = 0.0;
};

/// JSON without line breaks: parameters as they were used, then what was measured.
std::string to_json(const Options& options, const Outcome& outcome);

}  // namespace tfdb::driver
