// Every interleaving of locks on single frames, and with a broken promise.
#include "tfdb/engines/fine.hpp"

#include "tfdb/engines/engines.sched.hpp"

namespace tfdb::txn::engines {

namespace {

using S = FineSession<ForestMemory>;

/// Reads one edge: its newest sample is consistent.
Body<S> reader_of_one() {
    return [](Stage<S>& stage, unsigned thread) {
        S session(stage.shared, Stage<S>::in_slot(thread));
        lookup::Answer answer;
        lookup::Failure failure;
        CommitNumber as_of = 0;
        const auto outcome = read_through(session, as_of, [&](const auto& view) {
            return lookup::lookup_latest(view, kMap, kOdom, {}, 0, answer, failure);
        });
        require(outcome == lookup::Outcome::kOk, "an answer");
        const auto number = static_cast<double>(answer.edges[0].before);
        require(number == 11 || answer.pose.translation.x == 10 * number + 1, "a whole sample");
    };
}

}  // namespace

TFDB_SCHED(fine_keeps_single_frames_whole) {
    sched::Walk walk;
    walk.must_hold("a reader of one frame beside a writer",
                   acted<S>({reader_of_one(), writer<S>(20)}, newest_is<S>(20, 20, 6)));
    walk.must_hold("a reader beside one who is alone",
                   acted<S>({reader<S>(), extender<S>()}, newest_is<S>(30, 30, 6)));
    // Each thread locks every frame twice, to reserve space and to store its sample.
    sched::Walk few = bounded(2);
    few.must_hold("two writers", acted<S>({writer<S>(20), writer<S>(21)}, newest_is<S>(21, 21, 8)));
    walk.must_hold("a writer beside one who is alone",
                   acted<S>({writer<S>(20), extender<S>()}, newest_is<S>(30, 30, 8)));
}

TFDB_SCHED(fine_is_not_atomic) {
    sched::Walk walk;
    walk.must_fail("a reader of two frames beside a writer", "both edges of one batch",
                   acted<S>({reader<S>(), writer<S>(20)}, newest_is<S>(20, 20, 6)));
    walk.must_fail(
        "two who read, then write the same", "the newest stamps",
        acted<S>({incrementer<S>(kOdom), incrementer<S>(kOdom)}, newest_is<S>(13, 11, 6)));
    walk.must_fail("a writer without locks", "no sample was lost",
                   acted<S>({writer<S>(20), writer<S>(21)}, newest_is<S>(21, 21, 8),
                            in_region<S>([](Stage<S>& stage) {
                                return std::make_unique<Pretends>(0, locks_of(stage));
                            })));
}

}  // namespace tfdb::txn::engines
