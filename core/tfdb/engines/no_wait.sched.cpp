// Every interleaving of no-wait two-phase locking, and of what it would be with a promise broken.
#include "tfdb/engines/no_wait.hpp"

#include "tfdb/engines/engines.sched.hpp"

namespace tfdb::txn::engines {

namespace {

using S = NoWaitSession<ForestMemory>;

/// Its writers wait for what they are refused, as they must not.
/// Threads: one. Guarantee: none.
template <class M>
class WaitingSession : public TwoPhase<M, WaitingSession<M>> {
    using Base = TwoPhase<M, WaitingSession<M>>;

public:
    static constexpr bool kAgesMatter = false;

    using Base::Base;
    ~WaitingSession() { this->end(false); }

private:
    friend Base;

    void take_place() {}
    [[nodiscard]] bool must_stop() const { return false; }
    [[nodiscard]] bool may_wait_for(typename Base::FrameLock&, const typename Base::Attempt&,
                                    bool) const {
        return true;
    }
};

}  // namespace

TFDB_SCHED(no_wait_stands) {
    must_stand<S>({kBase, kOdom});
}

TFDB_SCHED(no_wait_flaws_are_found) {
    using Waiting = WaitingSession<ForestMemory>;
    sched::Walk walk;
    walk.must_fail("writers that wait while they hold", "deadlock",
                   acted<Waiting>({writer<Waiting>(20), writer<Waiting>(21, {kBase, kOdom})},
                                  newest_is<Waiting>(21, 21, 8)));
    walk.must_fail("a lock of a reader that is not there", "both edges of one batch",
                   acted<S>({reader<S>(), writer<S>(20)}, newest_is<S>(20, 20, 6),
                            in_region<S>([](Stage<S>& stage) {
                                return std::make_unique<Pretends>(0, lock_of(stage, kBase));
                            })));
    walk.must_fail("a writer without locks", "no sample was lost",
                   acted<S>({writer<S>(20), writer<S>(21)}, newest_is<S>(21, 21, 8),
                            in_region<S>([](Stage<S>& stage) {
                                return std::make_unique<Pretends>(0, locks_of(stage));
                            })));
}

}  // namespace tfdb::txn::engines
