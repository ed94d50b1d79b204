// Two-phase locking, no-wait: the paper's engine.
#pragma once

#include "tfdb/engines/two_phase.hpp"

namespace tfdb::txn {

/// Who is refused a lock for writing lets go of everything, and starts again once that lock has
/// changed hands; readers wait. No cycle can arise: who has a lock for writing never waits.
/// Threads: one. Guarantee: as TwoPhase's.
template <class M>
class NoWaitSession : public TwoPhase<M, NoWaitSession<M>> {
    using Base = TwoPhase<M, NoWaitSession<M>>;

public:
    static constexpr bool kAgesMatter = false;

    using Base::Base;
    ~NoWaitSession() { this->end(false); }

    [[nodiscard]] std::uint64_t age() const { return 0; }

private:
    friend Base;

    void take_place() {}
    [[nodiscard]] bool must_stop() const { return false; }
    [[nodiscard]] bool may_wait_for(typename Base::FrameLock&, const typename Base::Attempt&,
                                    bool exclusive) const {
        return !exclusive;
    }
};

}  // namespace tfdb::txn
