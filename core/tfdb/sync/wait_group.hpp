// One waiting thread watches for all waiters of its process.
#pragma once

#include <algorithm>
#include <vector>

#include "tfdb/sync/commit_lock.hpp"
#include "tfdb/sync/event_count.hpp"

namespace tfdb::sync {

/// The first waiting thread listens to the event and looks for all waiting threads; the others
/// sleep on words of their own, until what they wait for has come or they lead. So a change wakes
/// one thread of a process, however many wait there, and no thread is needed beside those. Threads:
/// any. Guarantee: `wait` blocks; each of its ends hands the lead on. A thread that was woken by
/// the event does not listen again for `RestNs`: changes that come without a pause are looked at
/// together, and cost their writers next to nothing. `Spins`: of the lock.
template <class Word, std::int64_t RestNs = 1'000'000, int Spins = 100>
class BasicWaitGroup {
public:
    using Lock = BasicCommitLock<Word, Spins>;

    /// A waiting thread.
    /// Threads: the group's lock is held. Guarantee: wait-free.
    class Waiter {
    public:
        [[nodiscard]] bool ended() const { return word_.load_relaxed() == kEnded; }

    private:
        friend class BasicWaitGroup;
        Word word_;
    };
    /// Threads: one. Guarantee: the lock is held for its lifetime.
    class Locked {
    public:
        explicit Locked(BasicWaitGroup& group) : group_(group) { group_.lock_.lock(); }
        ~Locked() { group_.lock_.unlock(); }
        Locked(const Locked&) = delete;
        Locked& operator=(const Locked&) = delete;

    private:
        BasicWaitGroup& group_;
    };

    explicit BasicWaitGroup(Word& event) : event_(event) {}

    // -- all of these: the lock is held --

    /// Returns once `end` was called for the waiter, or its patience is at an end. `look()` ends
    /// the waiters whose condition holds after all changes until then; the caller has looked for
    /// itself before, and not unlocked since. `patience` says how long
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
    /// After `end` of any: also the one that listens to the event is told.
    void tell() noexcept { event_.notify(); }

private:
    static constexpr std::uint64_t kWaits = 0;
    static constexpr std::uint64_t kLeads = 1;  // from now on, or soon
    static constexpr std::uint64_t kEnded = 2;
    // A writer may be killed between its commit and the event, and a signal come just before the
    // sleep.
    static constexpr std::int64_t kLongestSleepNs = 100'000'000;

    /// Threads: one. Guarantee: the lock is free for its lifetime.
    class Unlocked {
    public:
        explicit Unlocked(BasicWaitGroup& group) : group_(group) { group_.lock_.unlock(); }
        ~Unlocked() { group_.lock_.lock(); }
        Unlocked(const Unlocked&) = delete;
        Unlocked& operator=(const Unlocked&) = delete;

    private:
        BasicWaitGroup& group_;
    };
    /// Threads: one. Guarantee: a thread that leaves hands the lead on.
    class Present {
    public:
        Present(BasicWaitGroup& group, Waiter& waiter) : group_(group), waiter_(waiter) {
            group_.present_.push_back(&waiter);
        }
        ~Present() {
            auto& present = group_.present_;
            present.erase(std::find(present.begin(), present.end(), &waiter_));
            if (group_.leader_ == &waiter_)
                group_.leader_ = nullptr;
            if (group_.leader_ == nullptr && !present.empty())
                group_.appoint(*present.front());
        }
        Present(const Present&) = delete;
        Present& operator=(const Present&) = delete;

    private:
        BasicWaitGroup& group_;
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
            const Woken woken = leader_ == &waiter ? lead(waiter, look, patience)
                                                   : sleep(waiter.word_, kWaits, patience.left());
            if (woken == Woken::kInterrupted && patience.heeds_signals() && !waiter.ended())
                return woken;
        }
        return Woken::kChanged;
    }

    /// Until the next notification, or a signal.
    template <class Look, class Patience>
    Woken lead(Waiter& waiter, Look& look, Patience& patience) {
        if constexpr (RestNs > 0) {
            const std::int64_t rest = rests_until_ - steady_now();
            if (rest > 0)
                return sleep(waiter.word_, kWaits, std::min(rest, patience.left()));
        }
        const std::uint64_t armed = event_.arm();
        look();
        if (waiter.ended())
            return Woken::kChanged;
        const Woken woken = sleep(event_, armed, patience.left());
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

    BasicEventCount<Word> event_;
    Word lock_word_;
    Lock lock_{lock_word_};
    Waiter* leader_ = nullptr;
    std::vector<Waiter*> present_;  // those not in a signal handler
    std::int64_t rests_until_ = 0;
};

using WaitGroup = BasicWaitGroup<Word>;

}  // namespace tfdb::sync
