// Every interleaving of concurrent commits with lock-free readers, and of commits that run out of
// memory.
#include "tfdb/engines/parallel_commit.hpp"

#include "tfdb/engines/engines.sched.hpp"
#include "tfdb/engines/silo.hpp"
#include "tfdb/engines/two_phase.hpp"

namespace tfdb::txn::engines {

namespace {

/// A batch that runs out of memory after the first edge has grown: nothing is stored, and no commit
/// happens.
template <class S>
Body<S> breaker(StampNs stamp) {
    return [=](Stage<S>& stage, unsigned thread) {
        (void)stage.write(thread, stamp, {kOdom, kBase}, true);
    };
}

/// Holds a snapshot, taken alone, and reads it twice without locks.
template <class S>
Body<S> holder() {
    return [](Stage<S>& stage, unsigned thread) {
        S session(stage.shared, Stage<S>::in_slot(thread));
        session.begin(Mode::kAlone);
        stage.store.word(graph::kHeldPins).fetch_add(1);
        const CommitNumber held = stage.shared.committed();
        session.end(true);
        StampNs seen = history::kNoStamp;
        for (int i = 0; i < 2; ++i) {
            lookup::Answer answer;
            lookup::Failure failure;
            if (lookup::lookup_latest(stage.store.view(held), kMap, kBase, {}, 0, answer,
                                      failure) != lookup::Outcome::kOk) {
                continue;  // overtaken
            }
            require(answer.edges.size() == 2, "the path");
            require(answer.edges[0].before == answer.edges[1].before, "both edges of one batch");
            require(seen < 0 || answer.edges[0].before == seen, "the same again");
            seen = answer.edges[0].before;
        }
        stage.store.word(graph::kHeldPins).fetch_add(~std::uint64_t{0});
    };
}

}  // namespace

TFDB_SCHED(parallel_commit_without_room_is_none) {
    sched::Walk walk;
    using Locks = TwoPhaseSession<ForestMemory>;
    using Versions = SiloSession<ForestMemory>;
    walk.must_hold("beside a reader with locks", acted<Locks>({reader<Locks>(), breaker<Locks>(20)},
                                                              newest_is<Locks>(11, 11, 4)));
    walk.must_hold("beside a reader with versions",
                   acted<Versions>({reader<Versions>(), breaker<Versions>(20)},
                                   newest_is<Versions>(11, 11, 4)));
    walk.must_hold("beside another one with versions",
                   acted<Versions>({writer<Versions>(21), breaker<Versions>(20)},
                                   newest_is<Versions>(21, 21, 6)));
}

TFDB_SCHED(parallel_commit_leaves_held_snapshots_alone) {
    sched::Walk walk;
    using S = TwoPhaseSession<ForestMemory>;
    walk.must_hold("a writer", acted<S>({holder<S>(), writer<S>(20)}, newest_is<S>(20, 20, 6)));
    walk.must_hold("one without room",
                   acted<S>({holder<S>(), breaker<S>(20)}, newest_is<S>(11, 11, 4)));
}

TFDB_SCHED(parallel_commit_flaws_are_found) {
    sched::Walk walk;
    using S = TwoPhaseSession<ForestMemory>;
    walk.must_fail("a snapshot that is taken while commits are under way", "engines:0: ",
                   acted<S>({holder<S>(), writer<S>(20)}, newest_is<S>(20, 20, 6),
                            [](Stage<S>& stage) -> std::unique_ptr<sched::Interceptor> {
                                auto flaw = std::make_unique<Lies>(
                                    [](const sched::Word&) { return true; },
                                    [](std::uint64_t) { return std::uint64_t{0}; });
                                stage.shared.gate.claimed(1).intercept(flaw.get());
                                return flaw;
                            }));
}

}  // namespace tfdb::txn::engines
