// Every interleaving of two-phase locking under each rule, and with broken promises.
#include "tfdb/engines/two_phase.hpp"

#include "tfdb/engines/engines.sched.hpp"

namespace tfdb::txn::engines {

namespace {

template <LockRule Rule>
class Ruled : public TwoPhaseSession<ForestMemory> {
public:
    static constexpr LockRule kRule = Rule;
    using TwoPhaseSession<ForestMemory>::TwoPhaseSession;
};

using NoWait = Ruled<LockRule::kNoWait>;
using WaitDie = Ruled<LockRule::kWaitDie>;
using WoundWait = Ruled<LockRule::kWoundWait>;

/// `lie` changes the loads of one word of each slot.
template <class S, class WordOf>
MakeFlaw<S> in_slots(WordOf word_of, Lies::Lie lie) {
    return [=](Stage<S>& stage) -> std::unique_ptr<sched::Interceptor> {
        auto flaw = std::make_unique<Lies>([](const sched::Word&) { return true; }, lie);
        for (unsigned slot = 0; slot < SyncTuning<ForestMemory>::kSlots; ++slot)
            word_of(stage, slot).intercept(flaw.get());
        return flaw;
    };
}
template <class S>
MakeFlaw<S> ages_are(std::uint64_t age) {
    return in_slots<S>(
        [](auto& stage, unsigned slot) -> auto& { return stage.shared.gate.age(slot); },
        [age](std::uint64_t) { return age; });
}

template <class S>
sched::Program crossing_writers(const MakeFlaw<S>& flaw) {
    return acted<S>({writer<S>(20), writer<S>(21, {kBase, kOdom})}, newest_is<S>(21, 21, 8), flaw);
}
template <class S>
sched::Program reader_without_lock() {
    return acted<S>({reader<S>(), writer<S>(20)}, newest_is<S>(20, 20, 6),
                    in_region<S>([](Stage<S>& stage) {
                        return std::make_unique<Pretends>(0, lock_of(stage, kBase));
                    }));
}

}  // namespace

TFDB_SCHED(no_wait_stands) {
    must_stand<NoWait>({kBase, kOdom});
}

TFDB_SCHED(no_wait_flaws_are_found) {
    sched::Walk walk;
    walk.must_fail("a reader without its lock", "both edges of one batch",
                   reader_without_lock<NoWait>());
    walk.must_fail(
        "a writer without locks", "no sample was lost",
        acted<NoWait>({writer<NoWait>(20), writer<NoWait>(21)}, newest_is<NoWait>(21, 21, 8),
                      in_region<NoWait>([](Stage<NoWait>& stage) {
                          return std::make_unique<Pretends>(0, locks_of(stage));
                      })));
}

TFDB_SCHED(wait_die_stands) {
    must_stand<WaitDie>({kBase, kOdom});
}

TFDB_SCHED(wait_die_flaws_are_found) {
    sched::Walk walk;
    walk.must_fail("a junior that waits", "deadlock",
                   crossing_writers<WaitDie>(ages_are<WaitDie>(~std::uint64_t{0})));
    walk.must_fail("a reader without its lock", "both edges of one batch",
                   reader_without_lock<WaitDie>());
}

TFDB_SCHED(wound_wait_stands) {
    must_stand<WoundWait>({kBase, kOdom}, bounded(2));
}

TFDB_SCHED(wound_wait_flaws_are_found) {
    sched::Walk walk;
    const auto no_wounds = in_slots<WoundWait>(
        [](auto& stage, unsigned slot) -> auto& { return stage.shared.gate.state(slot); },
        [](std::uint64_t state) { return state & ~std::uint64_t{1}; });
    walk.must_fail("a session that ignores its wound", "deadlock",
                   crossing_writers<WoundWait>(no_wounds));
    walk.must_fail("a senior that does not wound", "deadlock",
                   crossing_writers<WoundWait>(ages_are<WoundWait>(0)));
    walk.must_fail("a reader without its lock", "both edges of one batch",
                   reader_without_lock<WoundWait>());
}

}  // namespace tfdb::txn::engines
