// Two-phase locking, wait-die: the older waits for the younger, the younger starts again.
#pragma once

#include "tfdb/engines/seniority.hpp"
#include "tfdb/engines/two_phase.hpp"

namespace tfdb::txn {

/// Waits only for its juniors, so no cycle can arise; a restart keeps its age, so that in the end
/// it is the oldest.
/// Threads: one. Guarantee: as TwoPhase's.
template <class M>
class WaitDieSession : public TwoPhase<M, WaitDieSession<M>> {
    using Base = TwoPhase<M, WaitDieSession<M>>;

public:
    static constexpr bool kAgesMatter = true;

    WaitDieSession(typename Base::Shared& shared, const SessionOptions& options)
        : Base(shared, options), seniority_(options) {}
    ~WaitDieSession() { this->end(false); }

    [[nodiscard]] std::uint64_t age() const { return seniority_.age(); }

private:
    friend Base;

    void take_place() { seniority_.take_place(this->shared_, this->slot_); }
    [[nodiscard]] bool must_stop() const { return false; }
    [[nodiscard]] bool may_wait_for(typename Base::FrameLock&,
                                    const typename Base::Attempt& refused, bool) {
        return all_of_holders(refused.others(this->slot_), [&](unsigned other) {
            return seniority_.senior_to(this->shared_, this->slot_, other);
        });
    }

    Seniority<M> seniority_;
};

}  // namespace tfdb::txn
