// Every interleaving of wound-wait, and of what it would be with a promise broken.
#include "tfdb/engines/wound_wait.hpp"

#include "tfdb/engines/engines.sched.hpp"

namespace tfdb::txn::engines {

namespace {

using S = WoundWaitSession<ForestMemory>;

}  // namespace

TFDB_SCHED(wound_wait_stands) {
    must_stand<S>({kBase, kOdom}, bounded(2));
}

TFDB_SCHED(wound_wait_flaws_are_found) {
    sched::Walk walk;
    const auto nobody_is_wounded = [](Stage<S>& stage) -> std::unique_ptr<sched::Interceptor> {
        auto flaw = std::make_unique<Lies>([](const sched::Word&) { return true; },
                                           [](std::uint64_t state) { return state & ~1ULL; });
        for (unsigned slot = 0; slot < SyncTuning<ForestMemory>::kSlots; ++slot)
            stage.shared.gate.state(slot).intercept(flaw.get());
        return flaw;
    };
    walk.must_fail("a wound that is not felt", "deadlock",
                   acted<S>({writer<S>(20), writer<S>(21, {kBase, kOdom})}, newest_is<S>(21, 21, 8),
                            nobody_is_wounded));
    const auto everybody_is_senior = [](Stage<S>& stage) -> std::unique_ptr<sched::Interceptor> {
        auto flaw = std::make_unique<Lies>([](const sched::Word&) { return true; },
                                           [](std::uint64_t) { return std::uint64_t{0}; });
        for (unsigned slot = 0; slot < SyncTuning<ForestMemory>::kSlots; ++slot)
            stage.shared.gate.age(slot).intercept(flaw.get());
        return flaw;
    };
    walk.must_fail("a senior that does not wound", "deadlock",
                   acted<S>({writer<S>(20), writer<S>(21, {kBase, kOdom})}, newest_is<S>(21, 21, 8),
                            everybody_is_senior));
    walk.must_fail("a lock of a reader that is not there", "both edges of one batch",
                   acted<S>({reader<S>(), writer<S>(20)}, newest_is<S>(20, 20, 6),
                            in_region<S>([](Stage<S>& stage) {
                                return std::make_unique<Pretends>(0, lock_of(stage, kBase));
                            })));
}

}  // namespace tfdb::txn::engines
