// The word by which readers of the silo engine detect a concurrent write of a frame.
#pragma once

#include "tfdb/sync/word.hpp"

namespace tfdb::sync {

/// A lock and a version in one word: bit 0 locked, bit 1 a thread waits, the version above. After
/// S. Tu et al., "Speedy Transactions in Multicore In-Memory Databases" (2013).
/// Threads: any read; only its holder may store the guarded data, and unlock.
/// Guarantee: all but `lock` are wait-free. If `unchanged` is true, all data loaded between
/// `version` and the call are of one state. If two threads each lock one frame and then check the
/// other's frame, at most one of them gets `unchanged`.
template <class Word, int Spins = 100>
class BasicVersionLock {
public:
    explicit BasicVersionLock(Word& word) noexcept : word_(word) {}

    /// Load the guarded data after it, and only if it is not `locked`.
    [[nodiscard]] std::uint64_t version() const noexcept { return word_.load_acquire(); }
    static constexpr bool locked(std::uint64_t version) { return (version & kLocked) != 0; }

    /// True if it was not locked since `version` returned this unlocked version.
    [[nodiscard]] bool unchanged(std::uint64_t version) const noexcept {
        Word::fence_acquire();
        return word_.load_ordered() == version;
    }
    /// The same for a thread that has locked it since: whether it was not locked in between.
    [[nodiscard]] bool unchanged_until_mine(std::uint64_t version) const noexcept {
        return (word_.load_relaxed() & ~kWaited) == (version | kLocked);
    }

    [[nodiscard]] bool try_lock() noexcept {
        std::uint64_t found = word_.load_relaxed();
        if ((found & kLocked) != 0 || !word_.compare_exchange_ordered(found, found | kLocked))
            return false;
        Word::fence_release();  // a reader of later stores sees the lock at its end
        return true;
    }

    /// Spins, then sleeps on the event. Several locks must be taken in one global order.
    template <class Event>
    void lock(Event& event) noexcept {
        for (int i = 0; i < Spins; ++i) {
            if (try_lock())
                return;
            spin_pause();
        }
        while (!try_lock()) {
            const auto epoch = event.prepare();
            if (mark_waited())
                event.wait(epoch);
            else
                event.cancel();
        }
    }

    /// Unlocks, with a new version if data were stored. True: the caller must `notify_all` the
    /// event.
    [[nodiscard]] bool unlock(bool changed) noexcept {
        const std::uint64_t version = word_.load_relaxed() & ~(kLocked | kWaited);
        return (word_.exchange(version + (changed ? kOneVersion : 0)) & kWaited) != 0;
    }

private:
    static constexpr std::uint64_t kLocked = 1;
    static constexpr std::uint64_t kWaited = 2;
    static constexpr std::uint64_t kOneVersion = 4;

    /// False if it is unlocked.
    bool mark_waited() noexcept {
        std::uint64_t found = word_.load_relaxed();
        while ((found & kLocked) != 0) {
            if (word_.compare_exchange(found, found | kWaited))
                return true;
        }
        return false;
    }

    Word& word_;
};

using VersionLock = BasicVersionLock<Word>;

}  // namespace tfdb::sync
