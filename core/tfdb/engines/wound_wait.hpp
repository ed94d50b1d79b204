// Two-phase locking, wound-wait: the older makes the younger start again, the younger waits.
#pragma once

#include "tfdb/engines/seniority.hpp"
#include "tfdb/engines/two_phase.hpp"

namespace tfdb::txn {

/// Wounds the juniors that hold what it wants, then waits for all. Who is wounded finds out when it
/// next asks for a lock or waits for one; who needs no further lock ends as if nothing had been.
/// Any cycle would have a junior in it that holds what a senior waits for, and that is wounded.
/// Threads: one. Guarantee: as TwoPhase's.
template <class M>
class WoundWaitSession : public TwoPhase<M, WoundWaitSession<M>> {
    using Base = TwoPhase<M, WoundWaitSession<M>>;

public:
    static constexpr bool kAgesMatter = true;

    WoundWaitSession(typename Base::Shared& shared, const SessionOptions& options)
        : Base(shared, options), seniority_(options) {}
    ~WoundWaitSession() { this->end(false); }

    [[nodiscard]] std::uint64_t age() const { return seniority_.age(); }

private:
    friend Base;
    using FrameLock = typename Base::FrameLock;

    // A slot's state: how many sessions it has had, and whether the present one is wounded.
    static constexpr std::uint64_t kWounded = 1;
    static constexpr std::uint64_t kOneSession = 2;

    void take_place() {
        seniority_.take_place(this->shared_, this->slot_);
        auto& state = this->shared_.gate.state(this->slot_);
        state.store_relaxed((state.load_relaxed() | kWounded) + 1);
    }
    [[nodiscard]] bool must_stop() const {
        return (this->shared_.gate.state(this->slot_).load_relaxed() & kWounded) != 0;
    }
    [[nodiscard]] bool may_wait_for(FrameLock& lock, const typename Base::Attempt& refused, bool) {
        bool tell = false;
        (void)all_of_holders(refused.others(this->slot_), [&](unsigned other) {
            tell |= seniority_.senior_to(this->shared_, this->slot_, other) && wound(lock, other);
            return true;
        });
        if (tell)
            this->shared_.event.notify_all();
        return !must_stop();
    }

    /// True if it was not wounded before. Not whoever came into the slot after the holder.
    [[nodiscard]] bool wound(FrameLock& lock, unsigned other) {
        auto& state = this->shared_.gate.state(other);
        std::uint64_t found = state.load_acquire();
        return (found & kWounded) == 0 && lock.held_by(other) &&
               state.compare_exchange(found, found | kWounded);
    }

    Seniority<M> seniority_;
};

}  // namespace tfdb::txn
