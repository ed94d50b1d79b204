// Commits, names and lookups in the C++ memory model: one writer, one reader, random weak
// executions of hand-made and random scripts, judged by the naive model.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <ostream>
#include <string>

#include "tfdb/testing/check.hpp"
#include "tfdb/txn/author.sched.hpp"
// After all others: it redefines `assert` and more.
#include "tfdb/testing/relacy/memory.hpp"

namespace tfdb {

using ForestMemory = relacy::Memory<7, 6144>;

template <>
struct history::Tuning<ForestMemory> {
    static constexpr unsigned kFirstLog2Capacity = 1;
    static constexpr unsigned kMaxRuns = 2;
    static constexpr std::uint64_t kSlackLimit = 1;
    static constexpr unsigned kFirstNamesLog2 = 2;
};

namespace txn::forest {

namespace {

constexpr unsigned kIdleSteps = 256;

/// What the simulation runs. Relacy makes the simulated object itself, so it finds it here.
struct Task {
    const Script* script = nullptr;
    const naive::Model* model = nullptr;
};
Task g_task;

void require(bool holds, const char*) {
    RL_ASSERT(holds);
}

struct Commits : rl::test_suite<Commits, 2> {
    Forest<ForestMemory> forest{*g_task.script};

    void before() { apply(g_task.script->before, 0); }

    void thread(unsigned index) {
        if (index == 0) {
            apply(g_task.script->during, g_task.script->before.size());
            return;
        }
        // The writer takes many more steps: the reader starts anywhere beside it.
        for (unsigned steps = rl::rand(kIdleSteps); steps > 0; --steps) {
            (void)forest.memory.word(0).load_relaxed();
        }
        for (const Question& question : g_task.script->questions) {
            (void)asked(question);
        }
    }

    void after() {
        for (const Question& question : g_task.script->questions) {
            RL_ASSERT(asked(question));
        }
    }

    void apply(const std::vector<Step>& steps, std::size_t number) {
        for (const Step& step : steps) {
            const bool stored = forest.apply(step, number++);
            RL_ASSERT(stored == (step.kind != Step::kSetCycle));
        }
    }

    bool asked(const Question& question) {
        const CommitNumber commit = forest.word(graph::kCommit).load_acquire();
        return ask(forest, *g_task.model, commit, question, require);
    }
};

unsigned long iterations() {
    const char* const wish = std::getenv("TFDB_RELACY_ITERATIONS");
    return wish == nullptr ? 20'000 : std::strtoul(wish, nullptr, 10);
}

/// Runs the script; empty if no execution breaks a promise, else Relacy's account of the first.
std::string simulate(const Script& script, unsigned long executions) {
    const naive::Model model = model_of(script);
    g_task = {&script, &model};
    relacy::Account account;
    relacy::Account ignored;
    std::ostream output(&account);
    std::ostream progress(&ignored);
    rl::test_params params;
    params.iteration_count = executions;
    params.output_stream = &output;
    params.progress_stream = &progress;
    params.execution_depth_limit = 50'000;
    return rl::simulate<Commits>(params) ? std::string() : account.text();
}

void holds(const Script& script, unsigned long executions) {
    const std::string account = simulate(script, executions);
    CHECK_EQ(account.empty() ? account : describe(script) + account, std::string());
}

Step set(StampNs stamp, std::vector<std::pair<std::string, std::string>> edges) {
    Step step;
    for (auto& [parent, child] : edges) {
        step.edges.push_back({parent, child, stamp});
    }
    return step;
}

}  // namespace

TFDB_TEST(commits_hold_in_the_memory_model) {
    const Step chain = set(10, {{"map", "odom"}, {"odom", "base"}});
    const Step removal{Step::kRemove, {}, "base"};
    const Step tip = set(10, {{"map", "tip"}});
    holds({{}, {chain}, {set(20, {{"map", "odom"}, {"odom", "base"}})}, {{"map", "base", 20}}},
          iterations() / 4);
    holds({{}, {}, {chain}, {{"map", "base", 10}}}, iterations() / 4);
    holds({{}, {chain}, {removal, tip}, {{"map", "base", 10}, {"map", "tip", 10}}},
          iterations() / 4);
    holds({{}, {chain}, {set(20, {{"map", "base"}})}, {{"map", "base", std::nullopt}}},
          iterations() / 4);
}

TFDB_TEST(random_commits_hold_in_the_memory_model) {
    constexpr std::uint64_t kSeed = 1;
    constexpr std::uint64_t kScripts = 30;
    for (std::uint64_t seed = kSeed; seed < kSeed + kScripts; ++seed) {
        holds(Author(seed).script(), iterations() / 40);
    }
    std::printf("  %llu scripts from seed %llu, %lu executions each\n",
                static_cast<unsigned long long>(kScripts), static_cast<unsigned long long>(kSeed),
                iterations() / 40);
}

}  // namespace txn::forest

}  // namespace tfdb
