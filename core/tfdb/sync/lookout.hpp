// Threads that wait for what any process may do: one of them keeps the lookout for all.
#pragma once

#include <algorithm>
#include <vector>

#include "tfdb/sync/bell.hpp"
#include "tfdb/sync/commit_lock.hpp"

namespace tfdb::sync {

/// Whoever waits first listens to the bell and looks, for all who wait; the others sleep on words
/// of their own, until what they wait for has come or the lookout is theirs. So a change wakes one
/// thread of a process, however many wait there, and no thread is needed beside those.
/// Threads: any. Guarantee: `wait` blocks; each of its ends hands the lookout on. Who was woken by
/// the bell does not listen again for `RestNs`: changes that come without a pause are looked at
/// together, and cost those who make them next to nothing. `Spins`: of the lock.
template <class Word, std::int64_t RestNs = 1'000'000, int Spins = 100>
class BasicLookout {
public:
    /// One who waits.
    /// Threads: the lookout's lock is held. Guarantee: wait-free.
    class Waiter {
    public:
        [[nodiscard]] bool ended() const { return word_.load_relaxed() == kEnded; }

    private:
        friend class BasicLookout;
        Word word_;
    };
    /// Threads: one. Guarantee: the lock is held for its lifetime.
    class Locked {
    public:
        explicit Locked(BasicLookout& lookout) : lookout_(lookout) { lookout_.lock_.lock(); }
        ~Locked() { lookout_.lock_.unlock(); }
        Locked(const Locked&) = delete;
        Locked& operator=(const Locked&) = delete;

    private:
        BasicLookout& lookout_;
    };

    explicit BasicLookout(Word& bell) : bell_(bell) {}

    // -- all of these: the lock is held --

    /// Returns once somebody has called `end` for the waiter, or its patience is at an end.
    /// `look()` ends those for whom what they wait for has come, with what was changed until then;
    /// the caller has looked for itself before, and not unlocked since. `patience` says how long
    /// it still waits, `left()`, whether a signal may end that, `heeds_signals()`, and is told of
    /// each, `signalled()`, without the lock. What these throw ends the wait.
    template <class Look, class Patience>
    void wait(Waiter& waiter, Look look, Patience& patience) {
        for (;;) {
            if (stay(waiter, look, patience) != Woken::kInterrupted)
                return;
            // Whatever that does, others may go on meanwhile.
            const Unlocked unlocked(*this);
            patience.signalled();
        }
    }
    void end(Waiter& waiter) noexcept {
        waiter.word_.store_release(kEnded);
        waiter.word_.wake_all();
    }
    /// After `end` of any: also the one that listens to the bell is told.
    void tell() noexcept { bell_.ring(); }

private:
    static constexpr std::uint64_t kWaits = 0;
    static constexpr std::uint64_t kLeads = 1;  // from now on, or soon
    static constexpr std::uint64_t kEnded = 2;
    // A writer may be killed between its commit and the bell, and a signal come just before the
    // sleep.
    static constexpr std::int64_t kLongestSleepNs = 100'000'000;

    /// Threads: one. Guarantee: the lock is free for its lifetime.
    class Unlocked {
    public:
        explicit Unlocked(BasicLookout& lookout) : lookout_(lookout) { lookout_.lock_.unlock(); }
        ~Unlocked() { lookout_.lock_.lock(); }
        Unlocked(const Unlocked&) = delete;
        Unlocked& operator=(const Unlocked&) = delete;

    private:
        BasicLookout& lookout_;
    };
    /// Threads: one. Guarantee: who leaves the lookout without anybody hands it on.
    class Present {
    public:
        Present(BasicLookout& lookout, Waiter& waiter) : lookout_(lookout), waiter_(waiter) {
            lookout_.present_.push_back(&waiter);
        }
        ~Present() {
            auto& present = lookout_.present_;
            present.erase(std::find(present.begin(), present.end(), &waiter_));
            if (lookout_.leader_ == &waiter_)
                lookout_.leader_ = nullptr;
            if (lookout_.leader_ == nullptr && !present.empty())
                lookout_.appoint(*present.front());
        }
        Present(const Present&) = delete;
        Present& operator=(const Present&) = delete;

    private:
        BasicLookout& lookout_;
        Waiter& waiter_;
    };

    void appoint(Waiter& waiter) noexcept {
        std::uint64_t found = kWaits;
        if (waiter.word_.compare_exchange(found, kLeads))
            waiter.word_.wake_all();
    }

    template <class Look, class Patience>
    Woken stay(Waiter& waiter, Look& look, Patience& patience) {
        const Present present(*this, waiter);
        while (!waiter.ended() && patience.left() > 0) {
            if (leader_ == nullptr)
                leader_ = &waiter;
            std::uint64_t found = kLeads;
            (void)waiter.word_.compare_exchange(found, kWaits);
            const Woken woken = leader_ == &waiter ? keep_lookout(waiter, look, patience)
                                                   : sleep(waiter.word_, kWaits, patience.left());
            if (woken == Woken::kInterrupted && patience.heeds_signals() && !waiter.ended())
                return woken;
        }
        return Woken::kChanged;
    }

    /// Until the next ring, or a signal.
    template <class Look, class Patience>
    Woken keep_lookout(Waiter& waiter, Look& look, Patience& patience) {
        if constexpr (RestNs > 0) {
            const std::int64_t rest = rests_until_ - steady_now();
            if (rest > 0)
                return sleep(waiter.word_, kWaits, std::min(rest, patience.left()));
        }
        const std::uint64_t armed = bell_.arm();
        look();
        if (waiter.ended())
            return Woken::kChanged;
        const Woken woken = sleep(bell_, armed, patience.left());
        if constexpr (RestNs > 0) {
            if (woken == Woken::kChanged)
                rests_until_ = steady_now() + RestNs;
        }
        if (!waiter.ended())
            look();
        return woken;
    }

    /// Where it would take longer than one sleeps at a time, it ends as if by a signal.
    template <class On>
    Woken sleep(On& on, std::uint64_t value, std::int64_t left) {
        const Unlocked unlocked(*this);
        const Woken woken = on.sleep(value, std::min(left, kLongestSleepNs));
        return woken == Woken::kTimedOut && left > kLongestSleepNs ? Woken::kInterrupted : woken;
    }

    BasicBell<Word> bell_;
    Word lock_word_;
    BasicCommitLock<Word, Spins> lock_{lock_word_};
    Waiter* leader_ = nullptr;
    std::vector<Waiter*> present_;  // those who are not at a signal
    std::int64_t rests_until_ = 0;
};

using Lookout = BasicLookout<Word>;

}  // namespace tfdb::sync
