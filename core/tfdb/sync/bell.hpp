// What threads of any process sleep on until something was changed, at one load for who changes it.
#pragma once

#include "tfdb/sync/word.hpp"

namespace tfdb::sync {

/// A word that counts how often it rang, with a bit that says whether anybody listens; so nobody
/// has to be counted, and who is killed while it listens leaves nothing behind.
///
/// A listener: `arm`, look whether it still has to wait, then `sleep`. Who changes what listeners
/// look at: change it, unlock whatever lock that needed, then `ring`.
/// Threads: any, of any process that has the word mapped.
/// Guarantee: all but `sleep` are wait-free. No change is missed: it is seen by the look behind
/// `arm`, or its `ring` ends the sleep.
template <class Word>
class BasicBell {
public:
    explicit BasicBell(Word& word) noexcept : word_(word) {}

    /// What one looks at next, one sees as it is now or later. Returns what to sleep on.
    [[nodiscard]] std::uint64_t arm() noexcept {
        std::uint64_t found = word_.load_relaxed();
        while ((found & kListened) == 0 && !word_.compare_exchange(found, found | kListened)) {
        }
        Word::fence_full();
        return found | kListened;
    }
    /// At most so long; not at all where it rang since `arm`.
    Woken sleep(std::uint64_t armed, std::int64_t longest_ns) const noexcept {
        return word_.sleep(armed, longest_ns);
    }
    /// Right behind the operation that unlocks what was changed: that is the fence.
    void ring() noexcept {
        Word::fence_full_after_exchange();
        std::uint64_t found = word_.load_relaxed();
        // Where the exchange fails somebody else rings; who arms after that looks after that.
        if ((found & kListened) != 0 && word_.compare_exchange(found, found + kOneRing - kListened))
            word_.wake_all();
    }

private:
    static constexpr std::uint64_t kListened = 1;
    static constexpr std::uint64_t kOneRing = 2;

    Word& word_;
};

using Bell = BasicBell<Word>;

}  // namespace tfdb::sync
