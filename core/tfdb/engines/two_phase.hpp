// Two-phase locking, with three rules for a refused lock: no-wait, wait-die, wound-wait.
#pragma once

#include <span>
#include <utility>

#include "tfdb/engines/frame_lock.hpp"
#include "tfdb/engines/gate_session.hpp"
#include "tfdb/engines/guarded_view.hpp"
#include "tfdb/engines/seniority.hpp"

namespace tfdb::txn {

/// Shared locks on read frames, exclusive locks on written frames, all held to the end: the session
/// reads one state, the current one. `shared.rule` decides which sessions wait for a refused lock;
/// no rule allows a cycle of waits:
/// - kNoWait (the paper's): readers wait. A writer releases everything and restarts once the lock's
///   state has changed, so a holder of an exclusive lock never waits.
/// - kWaitDie: the senior waits, the junior restarts. A restart keeps its age, so it becomes the
///   oldest at last.
/// - kWoundWait: the senior wounds the juniors that hold the lock, then waits. A wounded session
///   restarts at its next request or wait; one without a further request ends normally. Any cycle
///   would have a senior wait for a junior, and that junior is wounded.
/// Threads: one. Guarantee: strict two-phase locking without deadlock; a session waits for a frame
/// a bounded number of times, then gives up.
template <class M>
class TwoPhaseSession : public GateSession<M, TwoPhaseSession<M>> {
    using Base = GateSession<M, TwoPhaseSession<M>>;

public:
    using View = GuardedView<TwoPhaseSession>;
    static constexpr bool kWritesBesideOthers = true;
    static constexpr bool kIsolates = true;

    TwoPhaseSession(typename Base::Shared& shared, const SessionOptions& options)
        : Base(shared, options), seniority_(options) {}
    ~TwoPhaseSession() { this->end(false); }

    [[nodiscard]] std::uint64_t age() const { return ages_matter() ? seniority_.age() : 0; }
    [[nodiscard]] View view() { return {*this, this->shared_.frames, this->shared_.history}; }
    [[nodiscard]] bool confirm() { return !given_up_; }
    [[nodiscard]] bool lock(std::span<const FrameId> frames) {
        for (const FrameId id : frames) {
            if (!get(id, true))
                return false;
        }
        return true;
    }

    [[nodiscard]] bool enter(FrameId id) { return this->alone() || get(id, false); }
    void leave(FrameId) {}

    /// After a refused lock, the session has released all others. It waits until the refused lock's
    /// state has changed: an earlier retry would be refused again.
    void pause() {
        const FrameId id = std::exchange(refused_, kNoFrame);
        if (!Tuning::kAwaitsChange || id == kNoFrame || !await_change(id))
            Base::pause();
    }

    void start() {
        given_up_ = false;
        if (ages_matter())
            seniority_.take_place(this->shared_, this->slot_);
        if (rule() == LockRule::kWoundWait)
            unwound();
    }
    void release_locks() {
        bool tell = false;
        auto& held = this->scratch().held;
        for (; !held.empty(); held.pop_back()) {
            FrameLock lock(this->lock_word(held.back()));
            tell |= lock.release(this->slot_);
        }
        if (tell)
            this->shared_.event.notify_all();
    }

private:
    friend Base;
    using FrameLock = sync::BasicFrameLock<typename M::Word>;
    using Attempt = typename FrameLock::Attempt;
    using Tuning = typename Base::Shared::Tuning;

    // A slot's state: its number of sessions so far, and whether the current one is wounded.
    static constexpr std::uint64_t kWounded = 1;

    [[nodiscard]] LockRule rule() const { return this->shared_.rule; }
    [[nodiscard]] bool ages_matter() const { return rule() != LockRule::kNoWait; }

    /// Starts a new session in the slot, without a wound.
    void unwound() {
        auto& state = this->shared_.gate.state(this->slot_);
        state.store_relaxed((state.load_relaxed() | kWounded) + 1);
    }
    [[nodiscard]] bool wounded() const {
        return rule() == LockRule::kWoundWait &&
               (this->shared_.gate.state(this->slot_).load_relaxed() & kWounded) != 0;
    }
    /// True if the holder was not wounded before. It never wounds a later session in the slot.
    [[nodiscard]] bool wound(FrameLock& lock, unsigned other) {
        auto& state = this->shared_.gate.state(other);
        std::uint64_t found = state.load_acquire();
        return (found & kWounded) == 0 && lock.held_by(other) &&
               state.compare_exchange(found, found | kWounded);
    }
    [[nodiscard]] bool senior_to(unsigned other) const {
        return seniority_.senior_to(this->shared_, this->slot_, other);
    }

    [[nodiscard]] bool may_wait_for(FrameLock& lock, const Attempt& refused, bool exclusive) {
        const std::uint64_t holders = refused.others(this->slot_);
        switch (rule()) {
            case LockRule::kNoWait:
                return !exclusive;
            case LockRule::kWaitDie:
                return all_of_holders(holders, [&](unsigned other) { return senior_to(other); });
            case LockRule::kWoundWait:
                break;
        }
        bool tell = false;
        (void)all_of_holders(holders, [&](unsigned other) {
            tell |= senior_to(other) && wound(lock, other);
            return true;
        });
        if (tell)
            this->shared_.event.notify_all();
        return !wounded();
    }

    [[nodiscard]] bool get(FrameId id, bool exclusive) {
        if (given_up_ || wounded()) [[unlikely]]
            return give_up();
        FrameLock lock(this->lock_word(id));
        auto& held = this->scratch().held;
        if (held.size() == held.capacity())
            held.reserve(2 * held.size() + 16);  // once granted, nothing may throw
        Attempt attempt = request(lock, exclusive);
        if (!attempt) [[unlikely]] {
            attempt = wait_for(lock, attempt, exclusive);
            if (!attempt) {
                refused_ = id;
                refused_by_ = attempt;
                return give_up();
            }
        }
        if ((attempt.found & FrameLock::bit(this->slot_)) == 0)
            held.push_back(id);
        // A sleeper judged the ages of the holders at that time; they have changed.
        if (ages_matter() && attempt.waited())
            this->shared_.event.notify_all();
        return true;
    }

    [[nodiscard]] Attempt request(FrameLock& lock, bool exclusive) {
        return exclusive ? lock.try_exclusive(this->slot_) : lock.try_shared(this->slot_);
    }

    [[nodiscard]] Attempt wait_for(FrameLock& lock, Attempt attempt, bool exclusive) {
        if (!may_wait_for(lock, attempt, exclusive))
            return attempt;
        this->count(sync::SlotCount::kLockWaits);
        for (int spin = 0; spin < Tuning::kSpins && !attempt; ++spin) {
            sync::spin_pause();
            attempt = request(lock, exclusive);
        }
        for (int waits = 0; waits < Tuning::kWaitsBeforeRetry && !attempt; ++waits) {
            const auto epoch = this->shared_.event.prepare();
            if (!lock.mark_waited(attempt)) {
                this->shared_.event.cancel();
            } else if (!may_wait_for(lock, attempt, exclusive)) {
                // The holders are certain only after the mark.
                this->shared_.event.cancel();
                return attempt;
            } else {
                this->shared_.event.wait(epoch);
                if (wounded())
                    return attempt;
            }
            attempt = request(lock, exclusive);
        }
        return attempt;
    }

    /// False if the lock had already changed.
    [[nodiscard]] bool await_change(FrameId id) {
        for (int spin = 0; spin < Tuning::kSpins; ++spin) {
            if (this->lock_word(id).load_relaxed() != refused_by_.found)
                return false;
            sync::spin_pause();
        }
        FrameLock lock(this->lock_word(id));
        const auto epoch = this->shared_.event.prepare();
        if (lock.mark_waited(refused_by_)) {
            this->shared_.event.wait(epoch);
            return true;
        }
        this->shared_.event.cancel();
        return false;
    }

    bool give_up() {
        given_up_ = true;
        return false;
    }

    Seniority<M> seniority_;
    bool given_up_ = false;
    FrameId refused_ = kNoFrame;
    Attempt refused_by_{};
};

}  // namespace tfdb::txn
