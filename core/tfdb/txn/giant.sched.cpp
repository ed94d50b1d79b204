// Every interleaving of the one mutex, and of what it would be with a promise broken.
#include "tfdb/txn/giant.hpp"

#include "tfdb/txn/engines.sched.hpp"

namespace tfdb::txn::engines {

namespace {

using S = GiantSession<ForestMemory>;

}  // namespace

TFDB_SCHED(giant_stands) {
    must_stand<S>({kBase, kOdom});
}

TFDB_SCHED(giant_flaws_are_found) {
    sched::Walk walk;
    walk.must_fail("a reader without the mutex", "engines:0: ",
                   acted<S>({reader<S>(), writer<S>(20)}, newest_is<S>(20, 20, 6),
                            in_region<S>([](Stage<S>& stage) {
                                return std::make_unique<Pretends>(
                                    0, [word = &stage.store.word(graph::kCommitLock)](
                                           const sched::Word& at) { return &at == word; });
                            })));
}

}  // namespace tfdb::txn::engines
