// The implementation of a watch: it reads the feed, and sleeps until a commit touches its subjects.
#pragma once

#include <mutex>
#include <vector>

#include "tfdb/base/error.hpp"
#include "tfdb/store/touches.hpp"
#include "tfdb/store/waits.hpp"

namespace tfdb::store {

/// A Watch in the process that created it. Only interleaving walks use other template arguments.
/// Threads: any. Guarantee: as Watch.
template <class Store, class Waits = BasicWaits<Store>, class Touches = BasicTouches<Store>>
class BasicWatcher {
public:
    BasicWatcher(const Store& store, Waits& waits, const Watched& watched)
        : store_(store), waits_(waits), touches_(store, watched) {}

    [[nodiscard]] std::vector<Touch> next(CommitNumber after, Deadline deadline,
                                          std::size_t limit) {
        for (;;) {
            check_open();
            std::uint64_t wakeups = 0;
            std::vector<Touch> touched = read(after, limit, wakeups);
            if (!touched.empty() || deadline.left() <= 0)
                return touched;
            const WaitEnd end = waits_.sleep(wait_, wakeups, deadline);
            if (end == WaitEnd::kClosed || end == WaitEnd::kRemoved)
                raise_ended_wait(store_, end);
            if (end != WaitEnd::kCame)
                return touched;
        }
    }
    void close() {
        closed_.store_release(1);
        leave();
    }
    /// Call before destruction: the waits stop checking for it. Does nothing in a child of the
    /// process that created it, whose waits are its own.
    void leave() {
        if (is_at_home())
            waits_.leave(wait_);
    }
    [[nodiscard]] bool is_at_home() const { return waits_.forks() == sync::forks(); }
    [[nodiscard]] bool is_closed() const { return closed_.load_acquire() != 0; }
    void check_open() const {
        if (is_closed())
            throw WatchClosed("the watch is closed: make another by Buffer.watch()");
    }

private:
    using Word = typename Store::Word;
    using Lock = typename Store::WaitGroup::Lock;

    /// The commits after `after`, up to `Waits::last`, that touched a subject. If there are none,
    /// the waits check for all frames that the next one may touch, since before the feed was read.
    /// `wakeups`: for `Waits::sleep`.
    [[nodiscard]] std::vector<Touch> read(CommitNumber after, std::size_t limit,
                                          std::uint64_t& wakeups) {
        const std::lock_guard<Lock> guard(lock_);
        touches_.begin(after);
        const auto looked = waits_.look_at(wait_, touches_.frames());
        touches_.skip(looked.quiet_after, looked.quiet_until);
        wakeups = looked.wakeups;
        if (after >= looked.last)
            return {};
        std::vector<Touch> touched = touches_.read(limit);
        std::erase_if(touched, [&](const Touch& touch) { return touch.commit > looked.last; });
        return touched;
    }

    const Store& store_;
    Waits& waits_;
    Word closed_{};
    typename Waits::Wait wait_{closed_};
    Word lock_word_{};
    Lock lock_{lock_word_};
    Touches touches_;  // requires the lock
};

}  // namespace tfdb::store
