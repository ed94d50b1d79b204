// Two-phase locking, as far as its three ways to handle a conflict share it.
#pragma once

#include <span>
#include <utility>

#include "tfdb/engines/frame_lock.hpp"
#include "tfdb/engines/gate_session.hpp"
#include "tfdb/engines/guarded_view.hpp"

namespace tfdb::txn {

/// Shared locks on what is read, exclusive ones on what is written, all held to the end: what was
/// read is of one state, that of now. `Engine` is the session derived from it, and answers
/// `may_wait_for` (a lock that was refused) and `kAgesMatter`.
/// Threads: one. Guarantee: strict two-phase locking; no deadlock if `may_wait_for` allows none; a
/// frame is waited for a bounded number of times, then the session gives up.
template <class M, class Engine>
class TwoPhase : public GateSession<M, Engine> {
public:
    using Base = GateSession<M, Engine>;
    using View = GuardedView<Engine>;
    using FrameLock = sync::BasicFrameLock<typename M::Word>;
    static constexpr bool kWritesBesideOthers = true;
    static constexpr bool kIsolates = true;

    using Base::Base;

    [[nodiscard]] auto view() {
        return GuardedView<Engine>(engine(), this->shared_.frames, this->shared_.history);
    }
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

    /// Who was refused a lock, and has let go of all others, waits until that one has changed
    /// hands: to ask again before would be to be refused again.
    void pause() {
        const FrameId id = std::exchange(refused_, kNoFrame);
        if (!Tuning::kAwaitsChange || id == kNoFrame || !await_change(id))
            Base::pause();
    }

    void start() {
        given_up_ = false;
        engine().take_place();
    }
    void let_go() {
        bool tell = false;
        auto& held = this->scratch().held;
        for (; !held.empty(); held.pop_back()) {
            FrameLock lock(this->lock_word(held.back()));
            tell |= lock.release(this->slot_);
        }
        if (tell)
            this->shared_.event.notify_all();
    }

protected:
    using Attempt = typename FrameLock::Attempt;

    ~TwoPhase() = default;

private:
    using Tuning = typename Base::Shared::Tuning;

    [[nodiscard]] Engine& engine() { return static_cast<Engine&>(*this); }

    [[nodiscard]] bool get(FrameId id, bool exclusive) {
        if (given_up_ || engine().must_stop()) [[unlikely]]
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
        // Who sleeps judged by the ages of those that held it then.
        if (Engine::kAgesMatter && attempt.waited())
            this->shared_.event.notify_all();
        return true;
    }

    [[nodiscard]] Attempt request(FrameLock& lock, bool exclusive) {
        return exclusive ? lock.try_exclusive(this->slot_) : lock.try_shared(this->slot_);
    }

    [[nodiscard]] Attempt wait_for(FrameLock& lock, Attempt attempt, bool exclusive) {
        if (!engine().may_wait_for(lock, attempt, exclusive))
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
            } else if (!engine().may_wait_for(lock, attempt, exclusive)) {
                // Only from the mark on is it certain for whom this would wait.
                this->shared_.event.cancel();
                return attempt;
            } else {
                this->shared_.event.wait(epoch);
                if (engine().must_stop())
                    return attempt;
            }
            attempt = request(lock, exclusive);
        }
        return attempt;
    }

    /// False if it had changed already.
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

    bool given_up_ = false;
    FrameId refused_ = kNoFrame;
    Attempt refused_by_{};
};

}  // namespace tfdb::txn
