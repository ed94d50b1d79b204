// A writer of a shared store dies at each of its stores, and so does the process that repairs it.
// The next repair restores the last commit's state, and readers run concurrently.
#include "tfdb/txn/repair.hpp"

#include <algorithm>
#include <cstdio>
#include <limits>
#include <string>

#include "tfdb/testing/sched/flaws.hpp"
#include "tfdb/txn/author.sched.hpp"
#include "tfdb/txn/forest.sched.hpp"

namespace tfdb::txn::forest {

namespace {

constexpr std::size_t kNever = std::numeric_limits<std::size_t>::max();
constexpr CommitNumber kFresh = kMaxCommit;
constexpr std::size_t kWriter = 0;
constexpr std::size_t kRepairer = 1;

struct Died {
    bool writer = false;
    bool repairer = false;
};

Step set(StampNs stamp, const std::vector<std::pair<std::string, std::string>>& edges) {
    Step step;
    for (const auto& [parent, child] : edges)
        step.edges.push_back({parent, child, stamp});
    return step;
}
Step of_kind(Step::Kind kind, Step step) {
    step.kind = kind;
    return step;
}
Step removal(const std::string& name) {
    return {Step::kRemove, {}, name};
}
Step clearing() {
    return {Step::kClear, {}, {}};
}

/// The number of stores after which the writer dies, and the first repairer; whether a reader holds
/// the state from before; and the following steps.
struct Deaths {
    std::size_t writer = kNever;
    std::size_t repairer = kNever;
    bool held = false;
    std::vector<Step> after = {set(100, {{"y", "z"}}), set(110, {{"y", "z"}}),
                               set(120, {{"y", "z"}}), set(130, {{"y", "z"}})};
};
void repair(WalkedForest& forest) {
    Repair<ForestMemory>(forest.frames, forest.history, forest).run();
}

std::uint32_t count_alive(const WalkedForest& forest, CommitNumber commit) {
    std::uint32_t alive = 0;
    for (FrameId id = 0; id < forest.frames.count(); ++id)
        alive += forest.frames.alive(id, commit) ? 1 : 0;
    return alive;
}

void check_children(WalkedForest& forest, CommitNumber last) {
    std::array<std::uint64_t, kFrames> children{};
    const Commit<ForestMemory> commit(forest.frames, forest.scratch, forest.history, forest);
    for (FrameId id = 0; id < forest.frames.count(); ++id) {
        const FrameId parent =
            forest.frames.alive(id, last) ? commit.newest_parent(id) : FrameId{kNoFrame};
        if (parent < kFrames)
            ++children[parent];
    }
    for (FrameId id = 0; id < forest.frames.count(); ++id) {
        SCHED_REQUIRE(!forest.frames.alive(id, last) ||
                      forest.frames.word(id, history::kChildren).peek() == children[id]);
    }
}

/// No slot is lost: the maximum number of frames can be created; the commit is then undone.
void check_slots(WalkedForest& forest, CommitNumber last) {
    const std::uint32_t alive = count_alive(forest, last);
    Commit<ForestMemory> commit(forest.frames, forest.scratch, forest.history, forest);
    std::uint32_t made = 0;
    try {
        for (;; ++made)
            (void)commit.frame("new" + std::to_string(made));
    } catch (const CapacityExceeded&) {
        SCHED_REQUIRE(alive + made == kFrames);
    }
}

/// No block has two uses.
void check_blocks(WalkedForest& forest) {
    std::vector<Offset> blocks = forest.memory.out_of_use();
    const auto visit = [&](Offset block, std::size_t) { blocks.push_back(block); };
    forest.names.visit_blocks(visit);
    for (FrameId id = 0; id < forest.frames.count(); ++id) {
        history::EdgeSegments<ForestMemory>(forest.memory, forest.frames.header(id))
            .visit_blocks(visit, [](std::uint64_t) {});
    }
    std::sort(blocks.begin(), blocks.end());
    SCHED_REQUIRE(std::adjacent_find(blocks.begin(), blocks.end()) == blocks.end());
}

void check_whole(WalkedForest& forest, const naive::Model& model, const Script& script,
                 CommitNumber held) {
    const CommitNumber last = forest.word(graph::kCommit).peek();
    for (const Question& question : script.questions) {
        SCHED_REQUIRE(ask(forest, model, last, question, require));
        SCHED_REQUIRE(held == kFresh || ask(forest, model, held, question, require));
    }
    check_children(forest, last);
    check_blocks(forest);
    if (held == kFresh)
        check_slots(forest, last);
}

/// The committed steps of a script, then steps that reuse the numbers and blocks of the uncommitted
/// ones, then the rest. `committed`: number of committed steps.
Script continued(const Script& script, const std::vector<Step>& after, CommitNumber last,
                 std::size_t& committed) {
    std::vector<Step> all = script.before;
    all.insert(all.end(), script.during.begin(), script.during.end());
    committed = 0;
    for (CommitNumber done = 0; done < last; ++committed)
        done += all[committed].kind == Step::kSetCycle ? 0 : 1;
    Script whole = script;
    whole.before.assign(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(committed));
    whole.during = after;
    whole.during.insert(whole.during.end(), all.begin() + static_cast<std::ptrdiff_t>(committed),
                        all.end());
    return whole;
}

/// Continues after the deaths as if the last uncommitted step had never begun.
void go_on(WalkedForest& forest, const Script& script, const std::vector<Step>& after,
           CommitNumber held) {
    const CommitNumber last = forest.word(graph::kCommit).peek();
    std::size_t committed = 0;
    const Script whole = continued(script, after, last, committed);
    const naive::Model model = model_of(whole);
    check_whole(forest, model, script, held);
    for (std::size_t step = 0; step < whole.during.size(); ++step) {
        (void)forest.apply(whole.during[step], committed + step);
        check_whole(forest, model, script, held);
    }
    SCHED_REQUIRE(forest.word(graph::kCommit).peek() == model.commit());
}

/// The writer, two repairers one after another, and optionally a concurrent reader; then the store
/// continues.
sched::Program program_with_deaths(const Script& script, const Deaths& deaths, Died& died,
                                   const Reader& reader, const MakeFlaw& make_flaw) {
    const auto model = std::make_shared<const naive::Model>(model_of(script));
    return [=, &died](sched::Run& run) {
        WalkedForest forest(script);
        name_words(forest);
        for (std::size_t step = 0; step < script.before.size(); ++step)
            (void)forest.apply(script.before[step], step);
        const graph::Pins<ForestMemory> pins(forest.frames, graph::kHeldPins);
        CommitNumber held = kFresh;
        if (deaths.held) {
            held = forest.word(graph::kCommit).peek();
            (void)pins.take(held);
        }
        sched::Word writer_gone(0, "writer_gone");
        sched::Word repairer_gone(0, "repairer_gone");
        const std::unique_ptr<sched::Interceptor> flaw = make_flaw ? make_flaw(forest) : nullptr;
        sched::Dies repairer(kRepairer, deaths.repairer, repairer_gone, flaw.get());
        sched::Dies writer(kWriter, deaths.writer, writer_gone, &repairer);
        forest.memory.intercept(&writer);
        run.thread("writer", [&] {
            for (std::size_t step = 0; step < script.during.size(); ++step)
                (void)forest.apply(script.during[step], script.before.size() + step);
            writer_gone.store_release(1);
        });
        run.thread("repairer", [&] {
            writer_gone.wait_while(0);
            repair(forest);
            repairer_gone.store_release(1);
        });
        run.thread("second", [&] {
            repairer_gone.wait_while(0);
            repair(forest);
        });
        if (reader)
            run.thread("reader", [&] { reader(forest, *model, script); });
        run.join();
        died = {run.died(kWriter), run.died(kRepairer)};
        forest.memory.intercept(nullptr);
        if (!reader)  // it changes nothing
            go_on(forest, script, deaths.after, held);
    };
}

struct Tally {
    std::uint64_t executions = 0;
    std::size_t writers = 0;    // stores at which the writer died
    std::size_t repairers = 0;  // the maximum number of stores of one repair
};

std::string explore(const Script& script, const Deaths& deaths, Died& died, Tally& tally,
                    const Reader& reader, const MakeFlaw& flaw, const sched::Options& options) {
    const sched::Outcome outcome =
        sched::explore(program_with_deaths(script, deaths, died, reader, flaw), options);
    tally.executions += outcome.executions;
    if (outcome.violation.empty() && outcome.complete)
        return {};
    const auto at = [](std::size_t death) {
        return death == kNever ? std::string("never") : std::to_string(death);
    };
    return "killed after (" + at(deaths.writer) + ", " + at(deaths.repairer) + ") stores: " +
           (outcome.violation.empty() ? "not walked to the end" : outcome.violation) + "\n" +
           outcome.schedule;
}

/// Both die at each of their stores, in all pairs. Returns the failures.
std::string kill_both(const Script& script, Tally& tally, Deaths deaths,
                      const MakeFlaw& flaw = {}) {
    Died died{.writer = true, .repairer = true};
    for (deaths.writer = 0; died.writer; ++deaths.writer) {
        died.repairer = true;
        for (deaths.repairer = 0; died.repairer; ++deaths.repairer) {
            std::string found = explore(script, deaths, died, tally, {}, flaw, {});
            if (!found.empty())
                return found;
            tally.repairers = std::max(tally.repairers, deaths.repairer);
        }
        tally.writers = deaths.writer;
    }
    return {};
}

/// The writer dies at some of its stores, beside a reader.
std::string kill_beside(const Script& script, Tally& tally, const Reader& reader,
                        const sched::Options& options) {
    constexpr std::size_t kApart = 17;
    Died died{.writer = true, .repairer = false};
    Deaths deaths;
    for (deaths.writer = 0; died.writer; deaths.writer += kApart) {
        std::string found = explore(script, deaths, died, tally, reader, {}, options);
        if (!found.empty())
            return found;
        tally.writers = deaths.writer;
    }
    return {};
}

void outlived(const std::string& name, const Script& script, const Reader& reader = {},
              Deaths deaths = {}) {
    Tally alone;
    Tally beside;
    sched::Options options;
    options.preemptions = 1;
    std::string found = kill_both(script, alone, deaths);
    deaths.held = true;
    if (found.empty())
        found = kill_both(script, alone, deaths);
    if (found.empty() && reader)
        found = kill_beside(script, beside, reader, options);
    if (!found.empty())
        throw sched::Failure{name + ", " + found};
    std::printf(
        "  %-44s %8llu executions: writer killed at %zu stores, repair at up to %zu; "
        "%llu beside a reader\n",
        name.c_str(), static_cast<unsigned long long>(alone.executions), alone.writers,
        alone.repairers, static_cast<unsigned long long>(beside.executions));
    std::fflush(stdout);
}

const std::vector<Step> kChain{set(10, {{"map", "odom"}, {"odom", "base"}})};

}  // namespace

TFDB_SCHED(repair_of_appends) {
    outlived("two edges",
             {.history = {},
              .before = kChain,
              .during = {set(20, {{"map", "odom"}, {"odom", "base"}})},
              .questions = {{"map", "base", 10}, {"map", "base", std::nullopt}}},
             ask_fresh);
    outlived("edges that grow", {.history = {},
                                 .before = {kChain[0], set(20, {{"map", "odom"}})},
                                 .during = {set(30, {{"map", "odom"}}), set(40, {{"map", "odom"}})},
                                 .questions = {{"map", "odom", 15}, {"map", "odom", 35}}});
    outlived("edges that forget",
             {.history = 15,
              .before = {set(10, {{"map", "odom"}}), set(20, {{"map", "odom"}})},
              .during = {set(50, {{"map", "odom"}}), set(60, {{"map", "odom"}})},
              .questions = {{"map", "odom", 15}, {"map", "odom", 55}}},
             ask_fresh);
}

TFDB_SCHED(repair_of_late_samples) {
    Script script{.history = {},
                  .before = {},
                  .during = {set(15, {{"map", "odom"}}), set(12, {{"map", "odom"}})},
                  .questions = {{"map", "odom", 18}}};
    for (const StampNs stamp : {10, 30, 40})
        script.before.push_back(set(stamp, {{"map", "odom"}}));
    outlived("one after another", script);
    outlived("before all others",
             {.history = {},
              .before = script.before,
              .during = {set(5, {{"map", "odom"}})},
              .questions = {{"map", "odom", 8}}},
             ask_fresh);
}

TFDB_SCHED(repair_of_frames) {
    outlived("frames made", {.history = {},
                             .before = {set(10, {{"map", "odom"}})},
                             .during = {set(10, {{"odom", "base"}, {"base", "tip"}})},
                             .questions = {{"map", "tip", 10}, {"map", "odom", 10}}});
    outlived("the first frames of all", {.history = {},
                                         .before = {},
                                         .during = {set(10, {{"map", "odom"}})},
                                         .questions = {{"map", "odom", 10}}});
    outlived("a frame removed", {.history = {},
                                 .before = kChain,
                                 .during = {removal("base")},
                                 .questions = {{"map", "base", 10}, {"map", "odom", 10}}});
    outlived("a frame removed and its slot used again",
             {.history = {},
              .before = kChain,
              .during = {removal("base"), set(10, {{"map", "tip"}})},
              .questions = {{"map", "base", 10}, {"map", "tip", 10}}},
             ask_fresh);
    outlived("another parent",
             {.history = {},
              .before = kChain,
              .during = {set(20, {{"map", "base"}})},
              .questions = {{"map", "base", 20}, {"odom", "base", 10}}},
             ask_fresh);
}

TFDB_SCHED(repair_of_clears) {
    outlived("cleared", {.history = {},
                         .before = {kChain[0], set(20, {{"map", "odom"}})},
                         .during = {clearing()},
                         .questions = {{"map", "base", 10}, {"map", "odom", 20}}});
    outlived("cleared and filled again",
             {.history = {},
              .before = kChain,
              .during = {clearing(), set(5, {{"map", "odom"}})},
              .questions = {{"map", "odom", 5}}},
             ask_fresh);
    outlived("static after moving",
             {.history = {},
              .before = {kChain[0], set(20, {{"map", "odom"}})},
              .during = {of_kind(Step::kSetStatic, set(0, {{"map", "odom"}}))},
              .questions = {{"odom", "map", 5}, {"map", "base", 10}}});
    outlived("a held state beside it",
             {.history = {},
              .before = {kChain[0], set(20, {{"map", "odom"}})},
              .during = {clearing(), set(5, {{"map", "odom"}})},
              .questions = {{"map", "odom", 15}, {"map", "odom", 15}}},
             ask_held);
}

TFDB_SCHED(repair_of_what_was_refused) {
    const Step is_static = of_kind(Step::kSetStatic, set(0, {{"map", "odom"}}));
    outlived("a clear, then another one",
             {.history = {},
              .before = {is_static, set(10, {{"odom", "base"}})},
              .during = {of_kind(Step::kSetCycle, set(20, {{"base", "odom"}})),
                         set(20, {{"odom", "base"}}), set(20, {{"map", "odom"}})},
              .questions = {{"map", "odom", 20}}},
             {}, {.after = {is_static, is_static, is_static, set(50, {{"y", "z"}})}});
    outlived("a cycle with a new frame",
             {.history = {},
              .before = {set(10, {{"map", "odom"}})},
              .during = {of_kind(Step::kSetCycle, set(20, {{"odom", "tip"}, {"tip", "odom"}})),
                         set(20, {{"odom", "tip"}})},
              .questions = {{"map", "tip", 20}}});
}

TFDB_SCHED(repair_of_random_scripts) {
    Tally tally;
    constexpr std::uint64_t kScripts = 12;
    for (std::uint64_t seed = 1; seed <= kScripts; ++seed) {
        Author author(seed);
        const Script script = author.script();
        const std::string found = kill_both(script, tally, {.held = seed % 2 == 0});
        if (!found.empty())
            throw sched::Failure{"seed " + std::to_string(seed) + ", " + describe(script) + ": " +
                                 found};
    }
    std::printf("  %llu scripts: %llu executions\n", static_cast<unsigned long long>(kScripts),
                static_cast<unsigned long long>(tally.executions));
}

TFDB_SCHED(repair_flaws_are_found) {
    const Script appends{.history = {},
                         .before = kChain,
                         .during = {set(20, {{"map", "odom"}, {"odom", "base"}})},
                         .questions = {{"map", "odom", std::nullopt}}};
    const auto found = [&](const std::string& name, const Script& script, const MakeFlaw& flaw) {
        Tally tally;
        const std::string what = kill_both(script, tally, {}, flaw);
        if (what.empty())
            throw sched::Failure{name + ": the seeded bug was not found"};
        std::printf("  %-44s bug found, %s\n", name.c_str(),
                    what.substr(0, what.find('\n')).c_str());
    };
    // A repair does not change these words of a frame.
    const auto leaves = [](FrameId id, const std::vector<history::HeaderWord>& words) {
        return [=](const WalkedForest& forest) {
            std::vector<const sched::Word*> left;
            for (const history::HeaderWord word : words)
                left.push_back(&forest.frames.word(id, word));
            return std::make_unique<sched::Forgets>([left](const sched::Word& word, std::uint64_t) {
                return sched::Run::inside_thread()->current() != kWriter &&
                       std::find(left.begin(), left.end(), &word) != left.end();
            });
        };
    };
    constexpr FrameId kOdom = 1;
    constexpr FrameId kBase = 2;
    found("what was appended is not taken back", appends, leaves(kOdom, {history::kTail}));
    Script removes = appends;
    removes.during = {removal("base")};
    removes.questions = {{"map", "base", 10}};
    found("who was removed does not come back", removes,
          leaves(kBase, {history::kDied, history::kTopology}));
    found("children are not counted anew", removes, leaves(kOdom, {history::kChildren}));
    Script clears = appends;
    clears.before.push_back(set(20, {{"map", "odom"}}));
    clears.during = {clearing()};
    found("a clear is not taken back", clears, leaves(kOdom, {history::kTail}));
}

}  // namespace tfdb::txn::forest
