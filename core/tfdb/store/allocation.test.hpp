// Counts what a thread asks the heap for, and lets it fail. The counting `new` replaces the
// program's own (allocation.test.cpp), and is left out under sanitizers, which bring theirs.
#pragma once

#include "tfdb/testing/sanitized.hpp"

namespace tfdb::allocation {

/// How often this thread has allocated.
extern thread_local long count;
/// How many more of its allocations succeed before one fails; negative: all.
extern thread_local long until_failure;

}  // namespace tfdb::allocation
