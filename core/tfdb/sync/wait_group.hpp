// One waiting thread watches the event for all waiting threads of its process.
#pragma once

#include <algorithm>
#include <vector>

#include "tfdb/sync/commit_lock.hpp"
#include "tfdb/sync/event_count.hpp"

namespace tfdb::sync {

/// The first waiting thread listens to the event and checks the conditions of all waiting threads.
/// The others sleep on their own words until their condition holds or they become the leader. So a
/// change wakes one thread of a process, and no extra thread is needed.
/// Threads: any. Guarantee: `wait` blocks; however it ends, it hands the lead on. After the event
/// woke a thread, it does not listen again for `RestNs`: rapid changes are checked together, and
/// cost their writers almost nothing. `Spins`: of the lock.
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

    /// Returns after `end` was called for the waiter, or after its deadline. `look()` ends
    /// the waiters whose condition holds after all changes so far. The caller must have checked its
    /// own condition before, and must not have unlocked since. `deadline` gives the remaining time,
    /// `left()`, and whether a signal may end the wait, `heeds_signals()`. Each signal calls its
    /// `signalled()` without the lock. An exception from any of these ends the wait.
    template <class Look, class Deadline>
    void wait(Waiter& waiter, Look look, Deadline& deadline) {
        for (;;) {
            if (stay(waiter, look, deadline) != Woken::kInterrupted)
                return;
            // Other threads may proceed while the signal is handled.
            const Unlocked unlocked(*this);
            deadline.signalled();
        }
    }
    void end(Waiter& waiter) noexcept {
        waiter.word_.store_release(kEnded);
        waiter.word_.wake_all();
    }
    /// Call after `end` of any waiter: it also notifies the thread that listens to the event.
    void notify() noexcept { event_.notify(); }

private:
    static constexpr std::uint64_t kWaits = 0;
    static constexpr std::uint64_t kLeads = 1;  // now or soon
    static constexpr std::uint64_t kEnded = 2;
    // Bounds the sleep: a writer may be killed between its commit and the event, and a signal may
    // arrive just before the sleep.
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

    template <class Look, class Deadline>
    Woken stay(Waiter& waiter, Look& look, Deadline& deadline) {
        const Present present(*this, waiter);
        while (!waiter.ended() && deadline.left() > 0) {
            if (leader_ == nullptr)
                leader_ = &waiter;
            std::uint64_t found = kLeads;
            (void)waiter.word_.compare_exchange(found, kWaits);
            const Woken woken = leader_ == &waiter ? lead(waiter, look, deadline)
                                                   : sleep(waiter.word_, kWaits, deadline.left());
            if (woken == Woken::kInterrupted && deadline.heeds_signals() && !waiter.ended())
                return woken;
        }
        return Woken::kChanged;
    }

    /// Sleeps until the next notification or signal.
    template <class Look, class Deadline>
    Woken lead(Waiter& waiter, Look& look, Deadline& deadline) {
        if constexpr (RestNs > 0) {
            const std::int64_t rest = rests_until_ - steady_now();
            if (rest > 0)
                return sleep(waiter.word_, kWaits, std::min(rest, deadline.left()));
        }
        const std::uint64_t armed = event_.arm();
        look();
        if (waiter.ended())
            return Woken::kChanged;
        const Woken woken = sleep(event_, armed, deadline.left());
        if constexpr (RestNs > 0) {
            if (woken == Woken::kChanged)
                rests_until_ = steady_now() + RestNs;
        }
        if (!waiter.ended())
            look();
        return woken;
    }

    /// A sleep longer than the limit ends as if by a signal.
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
    std::vector<Waiter*> present_;  // except those in a signal handler
    std::int64_t rests_until_ = 0;
};

using WaitGroup = BasicWaitGroup<Word>;

}  // namespace tfdb::sync
