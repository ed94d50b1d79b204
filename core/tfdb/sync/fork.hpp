// Whether this process is a fork of the one in which something was made.
#pragma once

#include "tfdb/sync/word.hpp"

namespace tfdb::sync {

namespace detail {
extern Word g_forks;
}

/// From the first call on, forks are counted. Throws std::bad_alloc.
void watch_forks();

/// How many forks lie between this process and the one that called `watch_forks` first. In a child
/// it is greater than in its parent before any other code of the child runs.
/// Threads: any. Guarantee: wait-free.
[[nodiscard]] inline std::uint64_t forks() noexcept {
    return detail::g_forks.load_relaxed();
}

}  // namespace tfdb::sync
