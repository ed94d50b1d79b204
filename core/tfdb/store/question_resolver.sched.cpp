// Every interleaving of a question by names with commits that remove its frame and make it again:
// names and answer are of one state.
#include "tfdb/store/question_resolver.hpp"

#include "tfdb/testing/sched/flaws.hpp"
#include "tfdb/txn/forest.sched.hpp"

namespace tfdb::store {

namespace {

namespace forest = txn::forest;
using forest::WalkedForest;

constexpr StampNs kAsked = 10;

/// Removes `base` and makes it again, in one commit: every state has a frame of that name.
const forest::Step kRemake{
    .kind = forest::Step::kSet, .edges = {{"map", "base", kAsked}}, .name = "base"};
const forest::Script kScript{
    .history = {},
    .before = {{.kind = forest::Step::kSet, .edges = {{"map", "base", kAsked}}, .name = {}}},
    .during = {kRemake, kRemake},
    .questions = {}};

/// In which state a name is looked up, given the state that answers.
using StateOfNames = std::function<CommitNumber(const WalkedForest&, CommitNumber)>;

/// As StoreReader::ask; false: overtaken.
bool ask(const WalkedForest& store, tfdb::Question& question, const StateOfNames& state_of_names) {
    const CommitNumber commit = store.word(graph::kCommit).load_acquire();
    const auto view = store.view(commit);
    const auto find = [&](std::string_view name) {
        return store.names.find(name, state_of_names(store, commit));
    };
    Answer answer;
    Failure failure;
    const lookup::Outcome outcome = QuestionResolver(view, find, question).answer(answer, failure);
    if (outcome == lookup::Outcome::kLapped)
        return false;
    forest::ForestMemory::fence_acquire();
    if (outcome == lookup::Outcome::kFailed &&
        commit < store.word(graph::kRecycleFloor).load_relaxed()) {
        return false;
    }
    forest::require(outcome == lookup::Outcome::kOk, "every state has the frame");
    forest::require(forest::near(answer.pose, forest::pose_of(commit - 1, 0)),
                    "the pose of the state that was asked");
    forest::require(answer.commit == commit, "the state");
    return true;
}

/// The reader's handles are of the first state, whose frame the writer replaces twice.
sched::Program program(const StateOfNames& state_of_names) {
    return [=](sched::Run& run) {
        WalkedForest store(kScript);
        forest::name_words(store);
        SCHED_REQUIRE(store.apply(kScript.before.front(), 0));
        tfdb::Question question = at_stamp("map", "base", kAsked, {});
        SCHED_REQUIRE(ask(store, question, state_of_names));
        run.thread("writer", [&] {
            for (std::size_t step = 0; step < kScript.during.size(); ++step) {
                forest::ForestLock lock(store.word(graph::kCommitLock));
                lock.lock();
                SCHED_REQUIRE(store.apply(kScript.during[step], 1 + step));
                lock.unlock();
            }
        });
        run.thread("reader", [&] {
            if (ask(store, question, state_of_names))
                return;
            forest::ForestLock lock(store.word(graph::kCommitLock));
            lock.lock();
            forest::require(ask(store, question, state_of_names),
                            "no reader that holds the lock is overtaken");
            lock.unlock();
        });
        run.join();
    };
}

CommitNumber that_answers(const WalkedForest& /*store*/, CommitNumber commit) {
    return commit;
}
CommitNumber newest(const WalkedForest& store, CommitNumber /*commit*/) {
    return store.word(graph::kCommit).load_acquire();
}

}  // namespace

TFDB_SCHED(question_by_names_is_answered_from_the_state_that_has_them) {
    sched::Walk().must_hold("a frame made again, twice", program(that_answers));
}

TFDB_SCHED(question_with_names_of_another_state_is_found) {
    sched::Walk().must_fail("names of the newest state", "snapshot:", program(newest));
}

}  // namespace tfdb::store
