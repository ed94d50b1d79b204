// Counts what a thread asks the heap for, and lets it fail. The counting `new` replaces the
// program's own (allocation.test.cpp), and is left out under sanitizers, which bring theirs.
#pragma once

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define TFDB_COUNTS_ALLOCATIONS 0
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define TFDB_COUNTS_ALLOCATIONS 0
#endif
#endif
#ifndef TFDB_COUNTS_ALLOCATIONS
#define TFDB_COUNTS_ALLOCATIONS 1
#endif

namespace tfdb::allocation {

/// How often this thread has allocated.
extern thread_local long count;
/// How many more of its allocations succeed before one fails; negative: all.
extern thread_local long until_failure;

}  // namespace tfdb::allocation
