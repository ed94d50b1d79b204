// The version lock in the C++ memory model: writers store relaxed words; readers load them and then
// check whether the values count.
#include "tfdb/engines/version_lock.hpp"

#include "tfdb/engines/event.hpp"
// After all others: it redefines `assert` and more.
#include "tfdb/testing/relacy/simulate.hpp"

namespace tfdb::sync {

namespace {

bool g_weak_version = false;  // version() only loads relaxed

/// Two words that change together; that many writers, then readers.
template <unsigned Writers, unsigned Readers>
struct Versions : rl::test_suite<Versions<Writers, Readers>, Writers + Readers> {
    using Lock = BasicVersionLock<relacy::Word, 0>;
    relacy::Word word;
    relacy::Word epochs;
    relacy::Word first;
    relacy::Word second;
    rl::var<int> writers_own;

    void before() {
        word.weaken(g_weak_version, false);
        writers_own($) = 0;
    }

    void thread(unsigned index) {
        for (int turn = 0; turn < 2; ++turn) {
            if (index < Writers)
                write();
            else
                read();
        }
    }

    void write() {
        Lock lock(word);
        BasicEvent<relacy::Word, 0> event(epochs);
        lock.lock(event);
        writers_own($) = writers_own($) + 1;
        first.store_relaxed(first.load_relaxed() + 1);
        second.store_relaxed(second.load_relaxed() + 1);
        if (lock.unlock(true))
            event.notify_all();
    }

    void read() {
        const Lock lock(word);
        const std::uint64_t version = lock.version();
        if (lock.locked(version))
            return;
        const std::uint64_t one = first.load_relaxed();
        const std::uint64_t other = second.load_relaxed();
        if (lock.unchanged(version))
            RL_ASSERT(one == other && one == version / 4);
    }

    void after() {
        RL_ASSERT(word.load_relaxed() == 4 * 2 * Writers);
        RL_ASSERT(first.load_relaxed() == 2 * Writers);
    }
};

/// Each thread reads the other's word, and increases its own if that is still low: at most one may.
struct Skew : rl::test_suite<Skew, 2> {
    using Lock = BasicVersionLock<relacy::Word, 0>;
    relacy::Word versions[2];
    relacy::Word values[2];

    void thread(unsigned index) {
        Lock mine(versions[index]);
        const Lock theirs(versions[1 - index]);
        const std::uint64_t seen = theirs.version();
        const bool low = values[1 - index].load_relaxed() == 0;
        if (!low || theirs.locked(seen) || !mine.try_lock())
            return;
        const bool wins = theirs.unchanged(seen);
        if (wins)
            values[index].store_relaxed(1);
        (void)mine.unlock(wins);
    }

    void after() { RL_ASSERT(values[0].load_relaxed() + values[1].load_relaxed() <= 1); }
};

}  // namespace

TFDB_TEST(version_lock_holds_in_the_memory_model) {
    relacy::holds<Versions<1, 2>>("a writer and two readers");
    relacy::holds<Versions<2, 1>>("two writers and a reader");
    relacy::holds<Versions<3, 0>>("three writers");
    relacy::holds<Skew>("two that read what the other writes");
}

// Relacy's sequentially consistent operations order more than the language's: removing them shows
// whether the rest suffices for whole pairs.
TFDB_TEST(version_lock_needs_its_orders) {
    relacy::holds<Versions<1, 2>>("pairs by acquire and release alone", {.no_total_order = true});
    relacy::needs<Versions<1, 1>>("the reader's fence",
                                  {.no_acquire_fence = true, .no_total_order = true});
    relacy::needs<Versions<1, 1>>("the writer's fence",
                                  {.no_release_fence = true, .no_total_order = true});
    relacy::needs<Versions<2, 0>>("acquire and release of updates",
                                  {.no_total_order = true, .relaxed_updates = true});
    relacy::needs<Skew>("the total order of locks and looks", {.no_total_order = true});
    g_weak_version = true;
    relacy::needs<Versions<1, 1>>("acquire of the version", {.no_total_order = true});
    g_weak_version = false;
}

}  // namespace tfdb::sync
