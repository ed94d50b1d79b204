// Every interleaving of commits with the threads of a watch: each commit that touches a path is
// returned once, in order, and wakes the thread that sleeps until then.
#include "tfdb/store/watch.hpp"

#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "tfdb/store/question_resolver.hpp"
#include "tfdb/store/watcher.hpp"
#include "tfdb/testing/sched/flaws.hpp"
#include "tfdb/txn/forest.sched.hpp"

namespace tfdb {

namespace store::walked {

namespace forest = txn::forest;
using forest::Script;
using forest::Step;

/// A feed of 2^`Log2` commits, and twice as many words.
template <unsigned Log2>
struct WatchMemory : forest::ForestMemory {};

}  // namespace store::walked

template <unsigned Log2>
struct history::Tuning<store::walked::WatchMemory<Log2>>
    : history::Tuning<txn::forest::ForestMemory> {};

template <unsigned Log2>
struct txn::FeedTuning<store::walked::WatchMemory<Log2>> {
    static constexpr unsigned kCommitsLog2 = Log2;
    static constexpr unsigned kWordsLog2 = Log2 + 1;
};

namespace store::walked {

namespace {

/// A store with waits, as one process has it.
template <unsigned Log2>
struct WatchedStore : forest::Forest<WatchMemory<Log2>> {
    using Memory = WatchMemory<Log2>;
    using Word = sched::Word;
    using WaitGroup = sync::BasicWaitGroup<Word, 0, 0>;
    using Waits = BasicWaits<WatchedStore>;

    explicit WatchedStore(const Script& script) : forest::Forest<Memory>(script) {
        txn::Feed<Memory>::put_into(this->frames, this->memory.allocate(txn::Feed<Memory>::kBytes));
        forest::name_words(*this);
        event.rename("event", 0);
    }

    [[nodiscard]] CommitNumber committed() const {
        return this->word(graph::kCommit).load_acquire();
    }
    [[nodiscard]] static bool removed() { return false; }

    void commit(const Step& step, std::size_t number) {
        forest::ForestLock lock(this->word(graph::kCommitLock));
        lock.lock();
        SCHED_REQUIRE(this->apply(step, number));
        lock.unlock();
        if (notifies)
            sync::BasicEventCount<Word>(event).notify();
    }

    bool notifies = true;
    Word event;
    Waits waits{*this, event};
};

using Store = WatchedStore<3>;
/// Two commits lap it.
using SmallStore = WatchedStore<1>;

/// As StoreReader::ask.
template <unsigned Log2>
bool ask(const WatchedStore<Log2>& store, CommitNumber /*held*/, tfdb::Question& question,
         Answer& answer, Failure& failure) {
    constexpr int kTriesBeforePin = 2;
    using lookup::Outcome;
    const auto once = [&] {
        const CommitNumber commit = store.committed();
        const auto view = store.view(commit);
        const auto find = [&](std::string_view name) { return store.names.find(name, commit); };
        const Outcome outcome = QuestionResolver(view, find, question).answer(answer, failure);
        return outcome == Outcome::kFailed ? unless_reused(store, commit, outcome) : outcome;
    };
    Outcome outcome = Outcome::kLapped;
    for (int i = 0; i < kTriesBeforePin && outcome == Outcome::kLapped; ++i)
        outcome = once();
    if (outcome == Outcome::kLapped) {
        using Pins = graph::Pins<WatchMemory<Log2>>;
        const Pins states(store.frames, graph::kHeldPins);
        const Pins reads(store.frames, graph::kReadPins);
        const unsigned state = states.take();
        const unsigned epoch = reads.take();
        outcome = once();
        SCHED_REQUIRE(outcome != Outcome::kLapped);
        reads.drop(epoch);
        states.drop(state);
    }
    return outcome == Outcome::kOk;
}

template <unsigned Log2>
[[noreturn]] void throw_lapped(const WatchedStore<Log2>& /*store*/, CommitNumber /*since*/) {
    throw FeedLapped("lapped");
}
template <unsigned Log2>
[[noreturn]] void raise_ended_wait(const WatchedStore<Log2>& /*store*/, WaitEnd /*end*/) {
    throw BufferClosed("closed");
}

// -- what must be returned, by the naive model --

using Names = std::set<std::string>;
using Places = std::set<std::uint32_t>;

/// The frames whose edges are the path of a pair in a state.
Names path_of(const naive::Model& model, CommitNumber state, const std::string& target,
              const std::string& source) {
    const auto chain = [&](std::string name) {
        std::vector<std::string> found{name};
        while (!(name = model.parent_of(state, name, std::nullopt).value()).empty())
            found.push_back(name);
        return found;
    };
    const std::vector<std::string> all = model.frames(state);
    for (const std::string& name : {target, source}) {
        if (std::find(all.begin(), all.end(), name) == all.end())
            return {};
    }
    const std::vector<std::string> down = chain(target);
    const std::vector<std::string> up = chain(source);
    Names path(down.begin(), down.end());
    for (const std::string& name : up) {
        // Above where both meet all is in both.
        if (const auto [at, first] = path.insert(name); !first)
            path.erase(at);
    }
    return path;
}

bool meet(const Names& a, const Names& b) {
    return std::any_of(a.begin(), a.end(),
                       [&](const std::string& name) { return b.contains(name); });
}

/// Which places of the watched each commit touches.
std::map<CommitNumber, Places> touched_of(const Script& script, const Watched& watched) {
    const naive::Model model = forest::model_of(script);
    std::vector<Step> steps = script.before;
    steps.insert(steps.end(), script.during.begin(), script.during.end());
    std::map<CommitNumber, Places> all;
    for (CommitNumber commit = script.before.size() + 1; commit <= steps.size(); ++commit) {
        const Step& step = steps[commit - 1];
        const std::vector<std::string> before = model.frames(commit - 1);
        const std::vector<std::string> after = model.frames(commit);
        Names names;
        std::set_symmetric_difference(before.begin(), before.end(), after.begin(), after.end(),
                                      std::inserter(names, names.end()));
        for (const Step::Edge& edge : step.edges)
            names.insert(edge.child);
        Places places;
        for (std::uint32_t i = 0; i < watched.frames.size(); ++i) {
            if (names.contains(watched.frames[i]))
                places.insert(i);
        }
        for (std::uint32_t i = 0; i < watched.pairs.size(); ++i) {
            const auto& [target, source] = watched.pairs[i];
            if (meet(names, path_of(model, commit - 1, target, source)) ||
                meet(names, path_of(model, commit, target, source)))
                places.insert(static_cast<std::uint32_t>(watched.frames.size()) + i);
        }
        if (!places.empty())
            all[commit] = places;
    }
    return all;
}

// -- programs --

/// What one thread watches. `exact`: nothing else than what is touched is returned.
struct Follower {
    Watched watched;
    bool exact = false;
    std::size_t limit = ~std::size_t{0};
};

/// Reads on until the last commit that must be returned.
template <class Watcher>
void follow(Watcher& watcher, CommitNumber since, const Follower& follower,
            const std::map<CommitNumber, Places>& touched) {
    const CommitNumber last = touched.rbegin()->first;
    CommitNumber at = since;
    auto expected = touched.begin();
    while (at < last) {
        const std::vector<Touch> found = watcher.next(at, Deadline(std::nullopt), follower.limit);
        SCHED_REQUIRE(!found.empty() && found.size() <= follower.limit);
        for (const Touch& touch : found) {
            SCHED_REQUIRE(touch.commit > at);
            at = touch.commit;
            const bool none_is_left_out = expected == touched.end() || expected->first >= at;
            SCHED_REQUIRE(none_is_left_out);
            if (expected == touched.end() || expected->first > at) {
                SCHED_REQUIRE(!follower.exact);
                continue;
            }
            const Places places(touch.what.begin(), touch.what.end());
            const bool all_places = std::includes(places.begin(), places.end(),
                                                  expected->second.begin(), expected->second.end());
            SCHED_REQUIRE(all_places && (!follower.exact || places == expected->second));
            ++expected;
        }
    }
}

template <class AnyStore>
void write(AnyStore& store, const Script& script) {
    for (std::size_t step = 0; step < script.during.size(); ++step)
        store.commit(script.during[step], script.before.size() + step);
}

template <class Watcher = BasicWatcher<Store>, class Waits = Store::Waits>
sched::Program watching(const Script& script, const std::vector<Follower>& followers,
                        bool notifies = true) {
    std::vector<std::map<CommitNumber, Places>> touched;
    for (const Follower& follower : followers)
        touched.push_back(touched_of(script, follower.watched));
    return [=](sched::Run& run) {
        Store store(script);
        Waits waits(store, store.event);
        store.notifies = notifies;
        for (std::size_t step = 0; step < script.before.size(); ++step)
            store.commit(script.before[step], step);
        std::vector<std::unique_ptr<Watcher>> watchers;
        run.thread("writer", [&] { write(store, script); });
        for (std::size_t i = 0; i < followers.size(); ++i) {
            watchers.push_back(std::make_unique<Watcher>(store, waits, followers[i].watched));
            run.thread("watcher", [&, i] {
                follow(*watchers[i], script.before.size(), followers[i], touched[i]);
            });
        }
        run.join();
    };
}

Step set(StampNs stamp, const std::vector<std::pair<std::string, std::string>>& edges) {
    Step step;
    for (const auto& [parent, child] : edges)
        step.edges.push_back({parent, child, stamp});
    return step;
}
Step set_static(const std::vector<std::pair<std::string, std::string>>& edges) {
    Step step = set(0, edges);
    step.kind = Step::kSetStatic;
    return step;
}
Step removal(const std::string& name) {
    return {.kind = Step::kRemove, .edges = {}, .name = name};
}

const Follower kPair{.watched = {.frames = {}, .pairs = {{"map", "base"}}}};
const Follower kFrame{.watched = {.frames = {"base"}, .pairs = {}}};

/// An edge beside the path, and the two of it.
const Script kSamples{
    .history = {},
    .before = {set(10, {{"map", "odom"}, {"odom", "base"}, {"map", "tip"}})},
    .during = {set(20, {{"map", "tip"}}), set(30, {{"map", "odom"}}), set(40, {{"odom", "base"}})},
    .questions = {}};
const Script kOnPath{.history = {},
                     .before = {set(10, {{"map", "odom"}, {"odom", "base"}})},
                     .during = {set(20, {{"map", "odom"}})},
                     .questions = {}};
/// `base` goes from `odom` to `tip`, which then belongs to its path.
const Script kMoved{.history = {},
                    .before = {set_static({{"map", "odom"}, {"odom", "base"}, {"map", "tip"}})},
                    .during = {set_static({{"tip", "base"}}), set(30, {{"map", "other"}}),
                               set_static({{"map", "tip"}})},
                    .questions = {}};
const Script kRemoved{.history = {},
                      .before = {set(10, {{"map", "odom"}, {"odom", "base"}})},
                      .during = {removal("base"), set(20, {{"map", "base"}})},
                      .questions = {}};
/// Another frame gets its slot in between.
const Script kReused{
    .history = {},
    .before = {set(10, {{"map", "odom"}, {"odom", "base"}})},
    .during = {removal("base"), set(20, {{"map", "tip"}}), set(30, {{"tip", "base"}})},
    .questions = {}};
/// In one commit.
const Script kRemade{
    .history = {},
    .before = {set(10, {{"map", "odom"}, {"odom", "base"}})},
    .during = {{.kind = Step::kSet, .edges = {{"map", "base", 20}}, .name = "base"},
               set(30, {{"map", "base"}})},
    .questions = {}};
const Script kBorn{.history = {},
                   .before = {set(10, {{"map", "odom"}})},
                   .during = {set(20, {{"map", "tip"}}), set(10, {{"odom", "base"}})},
                   .questions = {}};

Follower exactly(Follower follower, std::size_t limit = ~std::size_t{0}) {
    follower.exact = true;
    follower.limit = limit;
    return follower;
}

Script first_of(Script script) {
    script.during.resize(1);
    return script;
}

/// For programs that are too long to be walked to their end.
sched::Walk bounded() {
    sched::Options options;
    options.preemptions = sched::to_the_end() ? 2 : 1;
    return sched::Walk(options);
}

}  // namespace

TFDB_SCHED(watch_returns_the_commits_of_its_path) {
    sched::Walk walk;
    walk.must_hold("samples of a frame", watching(kSamples, {exactly(kFrame)}));
    walk.must_hold("a sample on the path", watching(kOnPath, {exactly(kPair)}));
    walk.must_hold("a frame that is made", watching(kBorn, {exactly(kPair)}));
    bounded().must_hold("samples on the path and beside it", watching(kSamples, {exactly(kPair)}));
    bounded().must_hold("one at a time", watching(kSamples, {exactly(kPair, 1)}));
}

TFDB_SCHED(watch_follows_its_path) {
    sched::Walk walk;
    walk.must_hold("another parent", watching(first_of(kMoved), {kPair}));
    walk.must_hold("removed", watching(first_of(kRemoved), {kPair}));
    bounded().must_hold("another parent, then that one", watching(kMoved, {kPair}));
    bounded().must_hold("removed and made again", watching(kRemoved, {kPair}));
    bounded().must_hold("removed and made again in one commit", watching(kRemade, {kPair}));
    bounded().must_hold("another frame in its slot", watching(kReused, {kPair}));
    bounded().must_hold("another frame in its slot, by the name", watching(kReused, {kFrame}));
}

TFDB_SCHED(watches_wake_each_other) {
    bounded().must_hold("of a frame and of a path", watching(kRemoved, {kFrame, kPair}));
    bounded().must_hold("of paths that the same commits touch", watching(kMoved, {kPair, kPair}));
}

/// Both threads get all, whichever reads for the other.
TFDB_SCHED(watch_of_two_threads_returns_all_to_each) {
    const auto touched = touched_of(kRemoved, kPair.watched);
    bounded().must_hold("removed and made again", [=](sched::Run& run) {
        Store store(kRemoved);
        for (std::size_t step = 0; step < kRemoved.before.size(); ++step)
            store.commit(kRemoved.before[step], step);
        BasicWatcher<Store> watcher(store, store.waits, kPair.watched);
        run.thread("writer", [&] { write(store, kRemoved); });
        for (int i = 0; i < 2; ++i) {
            run.thread("watcher", [&] { follow(watcher, kRemoved.before.size(), kPair, touched); });
        }
        run.join();
    });
}

TFDB_SCHED(watch_that_is_closed_ends_its_thread) {
    bounded().must_hold("beside a commit that touches nothing", [](sched::Run& run) {
        Store store(kBorn);
        store.commit(kBorn.before.front(), 0);
        BasicWatcher<Store> watcher(store, store.waits, kPair.watched);
        run.thread("writer", [&] { store.commit(kBorn.during.front(), 1); });
        run.thread("watcher", [&] {
            bool closed = false;
            try {
                (void)watcher.next(1, Deadline(std::nullopt), 1);
            } catch (const WatchClosed&) {
                closed = true;
            }
            SCHED_REQUIRE(closed);
        });
        run.thread("closes", [&] { watcher.close(); });
        run.join();
    });
}

/// What was overwritten is refused, and only that; a thread that begins anew misses nothing more.
TFDB_SCHED(watch_that_is_lapped_raises) {
    const auto touched = touched_of(kSamples, kPair.watched);
    int lapped = 0;
    bounded().must_hold("three commits in a feed of two", [&](sched::Run& run) {
        SmallStore store(kSamples);
        store.commit(kSamples.before.front(), 0);
        BasicWatcher<SmallStore> watcher(store, store.waits, kPair.watched);
        run.thread("writer", [&] { write(store, kSamples); });
        run.thread("watcher", [&] {
            CommitNumber at = 1;
            while (at < touched.rbegin()->first) {
                const CommitNumber safe = store.committed();
                const auto expected = touched.upper_bound(at);
                try {
                    const auto found = watcher.next(at, Deadline(std::nullopt), 1);
                    SCHED_REQUIRE(found.front().commit == expected->first);
                    at = found.front().commit;
                } catch (const FeedLapped&) {
                    SCHED_REQUIRE(txn::Feed<SmallStore::Memory>(store.frames).floor().peek() >
                                  at + 1);
                    at = safe;
                    ++lapped;
                }
            }
        });
        run.join();
    });
    SCHED_EXPECT(lapped > 0);
}

/// A wait for an answer, whose frame goes and comes.
TFDB_SCHED(wait_for_an_answer_is_woken_by_its_commit) {
    const auto waiting = [](const Script& script, StampNs stamp) {
        return [=](sched::Run& run) {
            Store store(script);
            for (std::size_t step = 0; step < script.before.size(); ++step)
                store.commit(script.before[step], step);
            run.thread("writer", [&] { write(store, script); });
            run.thread("waits", [&, stamp] {
                const WaitEnd end =
                    store.waits.wait(at_stamp("map", "base", stamp, {}), Deadline(std::nullopt));
                SCHED_REQUIRE(end == WaitEnd::kCame);
            });
            run.join();
        };
    };
    bounded().must_hold("for a frame that is missing", waiting(kBorn, 10));
    bounded().must_hold("for a frame that is made again", waiting(kRemoved, 20));
}

namespace {

/// Enters the frames only when all that was committed has been read.
struct EntersLate : Store::Waits {
    using Store::Waits::BasicWaits;

    Looked look_at(Wait& /*watch*/, const std::vector<FrameId>& frames) {
        frames_ = frames;
        return {};
    }
    WaitEnd sleep(Wait& watch, std::uint64_t /*wakeups*/, Deadline deadline) {
        const Looked looked = Store::Waits::look_at(watch, frames_);
        return Store::Waits::sleep(watch, looked.wakeups, deadline);
    }

private:
    std::vector<FrameId> frames_;
};

/// Takes what was committed meanwhile for what it has looked at.
struct LooksAway : Store::Waits {
    LooksAway(const Store& store, sched::Word& event) : Store::Waits(store, event), store_(store) {}

    Looked look_at(Wait& watch, const std::vector<FrameId>& frames) {
        Looked looked = Store::Waits::look_at(watch, frames);
        if (looked.quiet_until != 0)
            looked.quiet_until = store_.committed();
        return looked;
    }

private:
    const Store& store_;
};

/// Enters the first path for good.
struct KeepsItsPath : BasicTouches<Store> {
    using BasicTouches<Store>::BasicTouches;

    const std::vector<FrameId>& frames() {
        if (first_.empty())
            first_ = BasicTouches<Store>::frames();
        return first_;
    }

private:
    std::vector<FrameId> first_;
};

}  // namespace

TFDB_SCHED(watch_flaws_are_found) {
    const std::string lost = "deadlock";
    sched::Walk walk;
    walk.must_fail("frames that are entered after the feed was read", lost,
                   watching<BasicWatcher<Store, EntersLate>, EntersLate>(kBorn, {kPair}));
    walk.must_fail("a path that is looked up once", lost,
                   watching<BasicWatcher<Store, Store::Waits, KeepsItsPath>>(kMoved, {kPair}));
    walk.must_fail("a commit that wakes no thread", lost, watching(kBorn, {kPair}, false));
    walk.must_fail("a commit that was not looked at", lost,
                   watching<BasicWatcher<Store, LooksAway>, LooksAway>(kSamples, {kPair}));
}

}  // namespace store::walked

}  // namespace tfdb
