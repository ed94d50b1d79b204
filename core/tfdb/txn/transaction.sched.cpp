// Every interleaving of small transactions: committed ones have read and written as in serial
// execution in the order of their commits; and each seeded bug violates that.
#include <algorithm>
#include <array>
#include <functional>
#include <string>
#include <vector>

#include "tfdb/testing/sched/flaws.hpp"
#include "tfdb/txn/commit_transaction.hpp"
#include "tfdb/txn/forest.sched.hpp"
#include "tfdb/txn/snapshot_session.hpp"
#include "tfdb/txn/workspace.hpp"

namespace tfdb::txn::forest {

namespace {

/// The store functions that `commit_transaction` needs.
class WalkedStore {
public:
    WalkedStore(WalkedForest& forest, std::function<void()> before_commit)
        : frames(forest.frames),
          history(forest.history),
          forest_(forest),
          before_commit_(std::move(before_commit)) {}
    static void check_writable(const Commit<ForestMemory>& /*commit*/) {}
    [[nodiscard]] Commit<ForestMemory> start_commit() {
        before_commit_();
        return {forest_.frames, forest_.scratch, forest_.history, forest_};
    }
    [[nodiscard]] history::Readers& readers() { return forest_; }
    [[nodiscard]] std::uint64_t author_number(std::string_view) const { return 0; }

    const graph::Frames<ForestMemory>& frames;
    StampNs history;

private:
    WalkedForest& forest_;
    std::function<void()> before_commit_;
};

using Sound = SnapshotSession<ForestMemory, ForestLock>;

/// Validates before it waits for its turn.
struct Hasty : Sound {
    using Sound::Sound;
    void become_alone() {}
    void take_turn() { Sound::become_alone(); }
};

/// A transaction of a walk: `log` holds everything that it has seen.
template <class S, class Reads>
class Small {
public:
    Small(WalkedForest& forest, Mode mode)
        : forest_(forest),
          lock_(forest.word(graph::kCommitLock)),
          workspace_(forest.frames, forest.history, mode, forest.frames, lock_, forest.history,
                     0U) {}

    /// The number that the pose was made from, or a negative number for an error code.
    double ask(const std::string& target, const std::string& source, std::optional<StampNs> stamp) {
        lookup::Answer answer;
        lookup::Failure failure;
        const Outcome found = workspace_.steadily([&](const auto& view) {
            return lookup::lookup(view, view.find(target), view.find(source), stamp, {}, answer,
                                  failure);
        });
        require(found != Outcome::kLapped, "what is pinned can be read");
        const double seen = found == Outcome::kOk ? answer.pose.translation.x
                                                  : -1.0 - static_cast<double>(failure.code);
        log += " " + std::to_string(seen);
        return seen;
    }
    void put(const std::string& parent, const std::string& child, StampNs stamp, double number) {
        typename WriteSet<ForestMemory>::Sample sample;
        sample.stamp = stamp;
        sample.parent = find_or_make(parent);
        const Pose pose{{number, -number, 0.5}, {0.6, 0.0, 0.0, 0.8}};
        sample.payload = std::bit_cast<std::array<std::uint64_t, 7>>(pose);
        sample.authority = workspace_.writes().authority("walk");
        const FrameId id = find_or_make(child);
        EdgeKind kind;
        require(workspace_.look_at(id, stamp, kind) == Outcome::kOk, "what is pinned can be read");
        workspace_.put(id, sample);
    }
    /// Only a frame without children is removed.
    void remove(const std::string& name) {
        FrameId id = kNoFrame;
        std::vector<FrameId> children;
        const bool there = workspace_.find(name, id) == Outcome::kOk;
        if (there)
            (void)workspace_.children_of(id, children);
        const bool goes = there && children.empty();
        log += goes ? " goes" : " stays";
        if (goes)
            workspace_.writes().remove(id);
    }

    void commit() {
        WalkedStore store(forest_, [this] {
            if constexpr (std::is_same_v<S, Hasty>)
                workspace_.session().take_turn();
        });
        wrote = !workspace_.writes().empty();
        outcome = commit_transaction(workspace_.session(), workspace_.reads(), workspace_.writes(),
                                     store);
    }

    std::string log;
    CommitOutcome outcome;
    bool wrote = false;

private:
    using Outcome = lookup::Outcome;

    [[nodiscard]] FrameId find_or_make(const std::string& name) {
        FrameId id = kNoFrame;
        return workspace_.find(name, id) == Outcome::kOk ? id : workspace_.writes().make(name);
    }

    WalkedForest& forest_;
    ForestLock lock_;
    Workspace<S, Reads> workspace_;
};

template <class S, class Reads>
using Bodies = std::vector<std::function<void(Small<S, Reads>&)>>;

/// The end of a transaction: its observations, and its place in the order of commits.
struct Ended {
    std::size_t body = 0;
    CommitOutcome::Kind kind = CommitOutcome::kConflict;
    CommitNumber place = 0;
    bool wrote = false;
    std::string log;
};

template <class S, class Reads>
Ended run_one(WalkedForest& forest, const Bodies<S, Reads>& bodies, std::size_t which,
              Mode mode = Mode::kBesideOthers) {
    Small<S, Reads> small(forest, mode);
    bodies[which](small);
    small.commit();
    return {which, small.outcome.kind, small.outcome.commit, small.wrote, small.log};
}

std::string describe_state(const WalkedForest& forest, const std::vector<Question>& questions) {
    const CommitNumber commit = forest.word(graph::kCommit).load_acquire();
    std::string text;
    for (const Question& question : questions) {
        lookup::Answer answer;
        lookup::Failure failure;
        const lookup::Outcome outcome = lookup::lookup(
            forest.view(commit), forest.names.find(question.target, commit),
            forest.names.find(question.source, commit), question.stamp, {}, answer, failure);
        text += outcome == lookup::Outcome::kOk
                    ? " " + std::to_string(answer.pose.translation.x)
                    : " error " + std::to_string(static_cast<int>(failure.code));
    }
    return text;
}

/// Runs the committed ones serially in another store.
template <class S, class Reads>
std::string replay(const Script& script, const Bodies<S, Reads>& bodies,
                   const std::vector<Ended>& ended) {
    WalkedForest forest(script);
    for (std::size_t step = 0; step < script.before.size(); ++step)
        (void)forest.apply(script.before[step], step);
    for (const Ended& one : ended) {
        const Ended again = run_one(forest, bodies, one.body);
        sched::Run::require(again.kind == one.kind, "one after another it ends so, too", __FILE__,
                            __LINE__);
        sched::Run::require(again.log == one.log, "each saw what it would have seen alone",
                            __FILE__, __LINE__);
    }
    return describe_state(forest, script.questions);
}

/// Each body in its own thread; if `alone`, the first one runs alone and must not abort.
template <class S, class Reads>
sched::Program beside(const Script& script, Bodies<S, Reads> (*make_bodies)(), bool alone = false) {
    return [=](sched::Run& run) {
        WalkedForest forest(script);
        name_words(forest);
        for (std::size_t step = 0; step < script.before.size(); ++step)
            SCHED_REQUIRE(forest.apply(script.before[step], step));
        const Bodies<S, Reads> bodies = make_bodies();
        std::vector<Ended> ended(bodies.size());
        for (std::size_t i = 0; i < bodies.size(); ++i) {
            run.thread("transaction" + std::to_string(i), [&, i] {
                const bool by_itself = alone && i == 0;
                ended[i] =
                    run_one(forest, bodies, i, by_itself ? Mode::kAlone : Mode::kBesideOthers);
            });
        }
        run.join();
        SCHED_REQUIRE(forest.word(graph::kHeldPins).peek() == 0);
        SCHED_REQUIRE(forest.word(graph::kCommitLock).peek() == 0);
        sched::Run::require(!alone || ended[0].kind == CommitOutcome::kCommitted,
                            "who runs alone does not lose", __FILE__, __LINE__);
        std::vector<Ended> committed;
        for (const Ended& one : ended) {
            if (one.kind != CommitOutcome::kConflict)
                committed.push_back(one);
        }
        sched::Run::require(!committed.empty(), "somebody gets through", __FILE__, __LINE__);
        // A read-only transaction comes right after the commit that it read.
        std::stable_sort(committed.begin(), committed.end(), [](const Ended& a, const Ended& b) {
            return a.place != b.place ? a.place < b.place : a.wrote && !b.wrote;
        });
        const std::string state = describe_state(forest, script.questions);
        sched::Run::require(state == replay(script, bodies, committed),
                            "the state is that of one after another", __FILE__, __LINE__);
    };
}

Step set(StampNs stamp, const std::vector<std::pair<std::string, std::string>>& edges) {
    Step step;
    for (const auto& [parent, child] : edges)
        step.edges.push_back({parent, child, stamp});
    return step;
}

/// Both read an edge's newest sample and add one to it.
template <class S, class Reads>
Bodies<S, Reads> increments() {
    const auto body = [](Small<S, Reads>& tx) {
        const double seen = tx.ask("map", "a", std::nullopt);
        tx.put("map", "a", 20, seen + 1.0);
    };
    return {body, body};
}
const Script& increments_script() {
    static const Script script{.history = {},
                               .before = {set(10, {{"map", "a"}})},
                               .during = {},
                               .questions = {{"map", "a", std::nullopt}}};
    return script;
}

/// Each reads at past stamps where the other one writes.
template <class S, class Reads>
Bodies<S, Reads> late_skew() {
    return {[](Small<S, Reads>& tx) {
                const double seen = tx.ask("map", "a", 15);
                tx.put("map", "b", 15, seen + 100.0);
            },
            [](Small<S, Reads>& tx) {
                const double seen = tx.ask("b", "map", 15);
                tx.put("map", "a", 15, seen + 100.0);
            }};
}
const Script& late_skew_script() {
    static const Script script{
        .history = {},
        .before = {set(10, {{"map", "a"}, {"map", "b"}}), set(20, {{"map", "a"}, {"map", "b"}})},
        .during = {},
        .questions = {{"map", "a", 15}, {"map", "b", 15}}};
    return script;
}

/// The same at exactly the stamp of a sample, which is replaced.
template <class S, class Reads>
Bodies<S, Reads> replacing_skew() {
    return {[](Small<S, Reads>& tx) {
                const double seen = tx.ask("map", "a", 10);
                tx.put("map", "b", 10, seen + 100.0);
            },
            [](Small<S, Reads>& tx) {
                const double seen = tx.ask("b", "map", 10);
                tx.put("map", "a", 10, seen + 100.0);
            }};
}

/// Each creates a frame unless the other one's frame exists.
template <class S, class Reads>
Bodies<S, Reads> naming_skew() {
    const auto body = [](const std::string& mine, const std::string& other) {
        return [=](Small<S, Reads>& tx) {
            const double seen = tx.ask("map", other, 10);
            tx.put("map", mine, 10, seen + 100.0);
        };
    };
    return {body("c", "d"), body("d", "c")};
}

/// One removes a leaf, the other adds a child to it.
template <class S, class Reads>
Bodies<S, Reads> removing_skew() {
    return {[](Small<S, Reads>& tx) { tx.remove("b"); },
            [](Small<S, Reads>& tx) {
                const double seen = tx.ask("map", "a", 10);
                tx.put("b", "a", 20, seen + 1.0);
            }};
}
const Script& removing_script() {
    static const Script script{.history = {},
                               .before = {set(10, {{"map", "a"}, {"map", "b"}})},
                               .during = {},
                               .questions = {{"map", "a", 20}, {"map", "b", 10}}};
    return script;
}

/// One advances so far that the history evicts what the other one has read.
template <class S, class Reads>
Bodies<S, Reads> forgetting_skew() {
    return {[](Small<S, Reads>& tx) {
                const double seen = tx.ask("map", "a", 12);
                tx.put("map", "b", 12, seen + 100.0);
            },
            [](Small<S, Reads>& tx) {
                const double seen = tx.ask("b", "map", 12);
                tx.put("map", "a", 60, seen + 100.0);
            }};
}
const Script& forgetting_script() {
    static const Script script{
        .history = 30,
        .before = {set(10, {{"map", "a"}, {"map", "b"}}), set(20, {{"map", "a"}, {"map", "b"}})},
        .during = {},
        .questions = {{"map", "a", 12}, {"map", "b", 12}, {"map", "a", std::nullopt}}};
    return script;
}

/// Never validates.
struct Careless : Sound {
    using Sound::Sound;
    static constexpr bool kIsolates = false;
};
/// Validates against the current state instead of the state that was read.
struct Hindsight : Sound {
    using Sound::Sound;
    [[nodiscard]] CommitNumber read_as_of() {
        const CommitNumber now = view().frames().store_word(graph::kCommit).load_acquire();
        return now;
    }
};
/// Excludes the ends of its read ranges.
struct ExclusiveReads : ReadSet {
    void note_range(std::size_t place, history::StampRange range) {
        constexpr StampNs kDawn = std::numeric_limits<StampNs>::min();
        constexpr StampNs kDusk = std::numeric_limits<StampNs>::max();
        if (range.from != kDawn)
            ++range.from;
        if (range.to != kDusk)
            --range.to;
        ReadSet::note_range(place, range);
    }
};
/// Ignores names that did not exist.
struct BlindToNames : ReadSet {
    void note_absent(std::string_view) {}
};
/// Ignores evictions of used samples.
struct BlindToRetention : ReadSet {
    void note_used(std::size_t, StampNs) {}
};
/// Ignores that there were no children.
struct BlindToChildren : ReadSet {
    void note_children(FrameId, const std::vector<FrameId>&) {}
};

/// Reads concurrently, but claims to be alone.
struct Boastful : Sound {
    using Sound::Sound;
    void begin(Mode) { Sound::begin(Mode::kBesideOthers); }
};

/// One reads two edges, each of which another transaction moves.
template <class S, class Reads>
Bodies<S, Reads> reading_two() {
    const auto move = [](const std::string& child) {
        return [=](Small<S, Reads>& tx) {
            tx.put("map", child, 20, 5.0);
            (void)tx.ask("map", child, std::nullopt);
        };
    };
    return {[](Small<S, Reads>& tx) {
                (void)tx.ask("map", "a", std::nullopt);
                (void)tx.ask("b", "map", std::nullopt);
            },
            move("a"), move("b")};
}

constexpr char kSaw[] = "each saw what it would have seen alone";

}  // namespace

TFDB_SCHED(transactions_are_as_one_after_another) {
    sched::Walk walk;
    walk.must_hold("lost update", beside(increments_script(), increments<Sound, ReadSet>));
    walk.must_hold("phantom in the past", beside(late_skew_script(), late_skew<Sound, ReadSet>));
    walk.must_hold("replaced sample", beside(late_skew_script(), replacing_skew<Sound, ReadSet>));
    walk.must_hold("new names", beside(increments_script(), naming_skew<Sound, ReadSet>));
    walk.must_hold("removal", beside(removing_script(), removing_skew<Sound, ReadSet>));
    walk.must_hold("retention", beside(forgetting_script(), forgetting_skew<Sound, ReadSet>));
}

TFDB_SCHED(transactions_of_three_threads) {
    // Three complete walks would take an hour; one preemption suffices to show it.
    sched::Options options;
    options.preemptions = 1;
    sched::Walk walk(options);
    walk.must_hold("a reader of two edges",
                   beside(late_skew_script(), reading_two<Sound, ReadSet>));
}

TFDB_SCHED(transactions_that_run_alone_never_lose) {
    sched::Walk walk;
    walk.must_hold("lost update", beside(increments_script(), increments<Sound, ReadSet>, true));
    walk.must_hold("removal", beside(removing_script(), removing_skew<Sound, ReadSet>, true));
    walk.must_hold("new names", beside(increments_script(), naming_skew<Sound, ReadSet>, true));
}

TFDB_SCHED(transactions_flaws_are_found) {
    sched::Walk walk;
    walk.must_fail("validation left out", kSaw,
                   beside<Careless>(increments_script(), increments<Careless, ReadSet>));
    walk.must_fail("validated against the wrong commit", kSaw,
                   beside<Hindsight>(increments_script(), increments<Hindsight, ReadSet>));
    walk.must_fail("validated before it has the lock", kSaw,
                   beside<Hasty>(increments_script(), increments<Hasty, ReadSet>));
    walk.must_fail("alone without the lock", kSaw,
                   beside<Boastful>(increments_script(), increments<Boastful, ReadSet>, true));
    walk.must_fail(
        "the ends of a dependency left out", kSaw,
        beside<Sound, ExclusiveReads>(late_skew_script(), replacing_skew<Sound, ExclusiveReads>));
    walk.must_fail(
        "names that were not there left out", kSaw,
        beside<Sound, BlindToNames>(increments_script(), naming_skew<Sound, BlindToNames>));
    walk.must_fail("retention left out", kSaw,
                   beside<Sound, BlindToRetention>(forgetting_script(),
                                                   forgetting_skew<Sound, BlindToRetention>));
    walk.must_fail(
        "children left out", kSaw,
        beside<Sound, BlindToChildren>(removing_script(), removing_skew<Sound, BlindToChildren>));
}

}  // namespace tfdb::txn::forest
