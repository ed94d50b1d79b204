// Event shared by processes; notifying costs one load if no thread waits.
#pragma once

#include "tfdb/sync/word.hpp"

namespace tfdb::sync {

/// A word that counts its notifications, with a bit that is set while a thread listens. It does not
/// count listeners, so a killed listener leaves nothing to clean up.
///
/// A listener calls `arm`, checks the condition, then calls `sleep`. A writer makes the change,
/// unlocks its lock, then calls `notify`.
/// Threads: any, of any process that has the word mapped.
/// Guarantee: all but `sleep` are wait-free. No change is missed: the check after `arm` sees it, or
/// its `notify` ends the sleep.
template <class Word>
class BasicEventCount {
public:
    explicit BasicEventCount(Word& word) noexcept : word_(word) {}

    /// Call before checking the condition; pass the result to `sleep`.
    [[nodiscard]] std::uint64_t arm() noexcept {
        std::uint64_t found = word_.load_relaxed();
        while ((found & kListened) == 0 && !word_.compare_exchange(found, found | kListened)) {
        }
        Word::fence_full();
        return found | kListened;
    }
    /// Sleeps for at most this time; returns at once after a `notify` since `arm`.
    Woken sleep(std::uint64_t armed, std::int64_t longest_ns) const noexcept {
        return word_.sleep(armed, longest_ns);
    }
    /// Call right after the operation that unlocks the change: that operation is the fence.
    void notify() noexcept {
        Word::fence_full_after_exchange();
        std::uint64_t found = word_.load_relaxed();
        // If the exchange fails, another thread notifies, and a later `arm` is followed by a later
        // check.
        if ((found & kListened) != 0 &&
            word_.compare_exchange(found, found + kOneNotify - kListened))
            word_.wake_all();
    }

private:
    static constexpr std::uint64_t kListened = 1;
    static constexpr std::uint64_t kOneNotify = 2;

    Word& word_;
};

using EventCount = BasicEventCount<Word>;

}  // namespace tfdb::sync
