// The groups of rows; each prints its own.
#pragma once

#include <cstddef>
#include <string>

#include "measure.hpp"

namespace bench {

void lookup_rows(const Options& options);
void write_rows(const Options& options);
void thread_rows(const Options& options);
void history_rows(const Options& options);

/// Runs one operation `count` times after its set-up and nothing else: for counting instructions.
/// `what` is "<contender> <operation>", e.g. "tf2 lookup mid". False if there is no such thing.
bool run_for_counting(const std::string& what, int chain, std::size_t count);

/// Calls of malloc and its relatives so far, by any thread.
std::size_t allocations();

}  // namespace bench
