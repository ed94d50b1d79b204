#include "tfdb/sync/fork.hpp"

#include <pthread.h>

#include <mutex>
#include <new>

#include "tfdb/sync/commit_lock.hpp"

namespace tfdb::sync {

namespace detail {
Word g_forks;
}

namespace {

// Held by the forking thread during the fork, so that the child gets a consistent list.
Word g_lock_word;
ForkWatcher* g_first = nullptr;

CommitLock list_lock() {
    return CommitLock(g_lock_word);
}

}  // namespace

void notify_fork_watchers() noexcept {
    for (ForkWatcher* at = g_first; at != nullptr; at = at->next_)
        at->forked();
}

void add_fork_watcher(ForkWatcher& watcher) noexcept {
    CommitLock lock = list_lock();
    const std::lock_guard guard(lock);
    watcher.next_ = g_first;
    if (g_first != nullptr)
        g_first->before_ = &watcher;
    g_first = &watcher;
}

void remove_fork_watcher(ForkWatcher& watcher) noexcept {
    CommitLock lock = list_lock();
    const std::lock_guard guard(lock);
    (watcher.before_ == nullptr ? g_first : watcher.before_->next_) = watcher.next_;
    if (watcher.next_ != nullptr)
        watcher.next_->before_ = watcher.before_;
}

void watch_forks() {
    // The child has only this thread.
    static const int failed =
        ::pthread_atfork([] { list_lock().lock(); }, [] { list_lock().unlock(); },
                         [] {
                             detail::g_forks.fetch_add(1);
                             notify_fork_watchers();
                             list_lock().unlock();
                         });
    if (failed != 0)
        throw std::bad_alloc();
}

}  // namespace tfdb::sync
