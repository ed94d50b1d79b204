#include "tfdb/sync/fork.hpp"

#include <pthread.h>

#include <new>

namespace tfdb::sync {

namespace detail {
Word g_forks;
}

void watch_forks() {
    // The child has this one thread only.
    static const int failed =
        ::pthread_atfork(nullptr, nullptr, [] { detail::g_forks.fetch_add(1); });
    if (failed != 0)
        throw std::bad_alloc();
}

}  // namespace tfdb::sync
