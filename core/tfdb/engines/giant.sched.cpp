// Every interleaving of the single mutex, and with a broken promise.
#include "tfdb/engines/giant.hpp"

#include "tfdb/engines/engines.sched.hpp"

namespace tfdb::txn::engines {

namespace {

using S = GiantSession<ForestMemory>;

}  // namespace

TFDB_SCHED(giant_stands) {
    must_stand<S>({kBase, kOdom});
}

TFDB_SCHED(giant_flaws_are_found) {
    sched::Walk walk;
    // A reader without the mutex would still see one state: edges keep what a snapshot needs.
    walk.must_fail("a writer without the mutex", "engines:0: ",
                   acted<S>({writer<S>(20), writer<S>(30)}, newest_is<S>(30, 30, 8),
                            in_region<S>([](Stage<S>& stage) {
                                return std::make_unique<Pretends>(
                                    0, [word = &stage.store.word(graph::kCommitLock)](
                                           const sched::Word& at) { return &at == word; });
                            })));
}

}  // namespace tfdb::txn::engines
