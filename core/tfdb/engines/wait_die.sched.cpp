// Every interleaving of wait-die, and of what it would be with a promise broken.
#include "tfdb/engines/wait_die.hpp"

#include "tfdb/engines/engines.sched.hpp"

namespace tfdb::txn::engines {

namespace {

using S = WaitDieSession<ForestMemory>;

}  // namespace

TFDB_SCHED(wait_die_stands) {
    must_stand<S>({kBase, kOdom});
}

TFDB_SCHED(wait_die_flaws_are_found) {
    sched::Walk walk;
    const auto everybody_is_junior = [](Stage<S>& stage) -> std::unique_ptr<sched::Interceptor> {
        auto flaw = std::make_unique<Lies>([](const sched::Word&) { return true; },
                                           [](std::uint64_t) { return ~std::uint64_t{0}; });
        for (unsigned slot = 0; slot < SyncTuning<ForestMemory>::kSlots; ++slot)
            stage.shared.gate.age(slot).intercept(flaw.get());
        return flaw;
    };
    walk.must_fail("a junior that waits", "deadlock",
                   acted<S>({writer<S>(20), writer<S>(21, {kBase, kOdom})}, newest_is<S>(21, 21, 8),
                            everybody_is_junior));
    walk.must_fail("a lock of a reader that is not there", "both edges of one batch",
                   acted<S>({reader<S>(), writer<S>(20)}, newest_is<S>(20, 20, 6),
                            in_region<S>([](Stage<S>& stage) {
                                return std::make_unique<Pretends>(0, lock_of(stage, kBase));
                            })));
}

}  // namespace tfdb::txn::engines
