// Words with one promise broken: walks of locks over them must find the resulting errors.
#pragma once

#include <cstdint>

#include "tfdb/testing/sched/walk.hpp"

namespace tfdb::sync::flaws {

/// A correct word; each flaw below breaks one promise of it.
using Sound = sched::Word;

struct SplitCompareExchange : sched::Word {
    bool compare_exchange(std::uint64_t& expected, std::uint64_t desired) {
        const std::uint64_t found = load_acquire();
        if (found != expected) {
            expected = found;
            return false;
        }
        store_release(desired);
        return true;
    }
};

struct SplitOrderedExchange : SplitCompareExchange {
    bool compare_exchange_ordered(std::uint64_t& expected, std::uint64_t desired) {
        return SplitCompareExchange::compare_exchange(expected, desired);
    }
    bool compare_exchange(std::uint64_t& expected, std::uint64_t desired) {
        return sched::Word::compare_exchange(expected, desired);
    }
};

struct SplitExchange : sched::Word {
    std::uint64_t exchange(std::uint64_t desired) {
        const std::uint64_t found = load_acquire();
        store_release(desired);
        return found;
    }
};

struct SplitFetchAdd : sched::Word {
    std::uint64_t fetch_add(std::uint64_t delta) {
        const std::uint64_t found = load_acquire();
        store_release(found + delta);
        return found;
    }
};

struct SilentNotify : sched::Word {
    void notify_one() {}
    void notify_all() {}
    void wake_one() {}
    void wake_all() {}
};

/// Wakes one thread instead of all.
struct NarrowNotify : sched::Word {
    void notify_all() { notify_one(); }
    void wake_all() { wake_one(); }
};

/// Sleeps regardless of the value, as a condition variable without its mutex would.
struct BlindWait : sched::Word {
    void wait(std::uint64_t) const { sched::Word::wait(load_acquire()); }
    Woken sleep(std::uint64_t, std::int64_t longest_ns) const {
        return sched::Word::sleep(load_acquire(), longest_ns);
    }
};

inline constexpr char kDeadlock[] = "deadlock";

}  // namespace tfdb::sync::flaws
