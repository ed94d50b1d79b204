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

/// Called in a forked child before any other code.
/// Threads: the child's only one. Guarantee: that of the implementation.
class ForkWatcher {
public:
    ForkWatcher() = default;
    ForkWatcher(const ForkWatcher&) = delete;
    ForkWatcher& operator=(const ForkWatcher&) = delete;
    virtual void forked() noexcept = 0;

protected:
    ~ForkWatcher() = default;

private:
    friend void tell_of_forks(ForkWatcher& watcher) noexcept;
    friend void tell_no_more(ForkWatcher& watcher) noexcept;
    friend void tell_all() noexcept;
    ForkWatcher* next_ = nullptr;
    ForkWatcher* before_ = nullptr;
};
/// After `watch_forks`. Both: any thread; they wait while another one forks.
void tell_of_forks(ForkWatcher& watcher) noexcept;
void tell_no_more(ForkWatcher& watcher) noexcept;

}  // namespace tfdb::sync
