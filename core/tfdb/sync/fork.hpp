// Detects that this process is a fork of the one in which an object was created.
#pragma once

#include "tfdb/sync/word.hpp"

namespace tfdb::sync {

namespace detail {
extern Word g_forks;
}

/// Starts to count forks. Throws std::bad_alloc.
void watch_forks();

/// The number of forks between this process and the one that first called `watch_forks`. In a child
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
    friend void add_fork_watcher(ForkWatcher& watcher) noexcept;
    friend void remove_fork_watcher(ForkWatcher& watcher) noexcept;
    friend void notify_fork_watchers() noexcept;
    ForkWatcher* next_ = nullptr;
    ForkWatcher* before_ = nullptr;
};
/// Call after `watch_forks`. Both: any thread; they wait while another thread forks.
void add_fork_watcher(ForkWatcher& watcher) noexcept;
void remove_fork_watcher(ForkWatcher& watcher) noexcept;

}  // namespace tfdb::sync
