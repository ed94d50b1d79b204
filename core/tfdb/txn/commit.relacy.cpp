// Commits, names and lookups in the C++ memory model: one writer, one reader, random weak
// executions of hand-made and random scripts, checked by the naive model.
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

using ForestMemory = relacy::Memory<7, 12288>;

template <>
struct history::Tuning<ForestMemory> {
    static constexpr unsigned kFirstLog2 = 0;
    static constexpr unsigned kFullLog2 = 1;
    static constexpr unsigned kFanLog2 = 1;
    static constexpr unsigned kSmallLog2 = 1;
    static constexpr unsigned kLargestLog2 = 2;
    static constexpr std::size_t kKept = 0;
    static constexpr unsigned kFirstNamesLog2 = 2;
};

namespace txn::forest {

namespace {

constexpr unsigned kIdleSteps = 800;

/// The input of the simulation. Relacy constructs the simulated object itself, so it reads the
/// input here.
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
        // The writer takes many more steps: the reader starts at any point of it.
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

/// Runs the script; empty if all executions keep the promises, otherwise Relacy's report of the
/// first violation.
std::string simulate(const Script& script, unsigned long executions) {
    const naive::Model model = model_of(script);
    model.remember();  // inside, memory belongs to Relacy for one execution
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

/// Words lie where Forest puts them: the root's block first, then the headers.
constexpr Offset root_word(graph::StoreWord word) {
    return 64 + 8 * Offset{word};
}
constexpr Offset header_word(FrameId id, history::HeaderWord word) {
    return 64 + graph::kStoreBytes + id * history::kHeaderBytes + 8 * Offset{word};
}

/// Without the order that `weakness` removes, some execution must break a promise.
void needs(const std::string& name, const Script& script, const relacy::Weakness& weakness) {
    relacy::g_weakness = weakness;
    const bool found = !simulate(script, iterations()).empty();
    relacy::g_weakness = {};
    std::printf("  without %s: %s\n", name.c_str(), found ? "violated" : "NOT FOUND");
    std::fflush(stdout);
    CHECK(found);
}

const Step kChain = set(10, {{"map", "odom"}, {"odom", "base"}});
const Script kBatch{
    {}, {kChain}, {set(20, {{"map", "odom"}, {"odom", "base"}})}, {{"map", "base", 20}}};
const Script kLatest{
    {}, {kChain}, {set(20, {{"map", "odom"}, {"odom", "base"}})}, {{"map", "base", std::nullopt}}};
const Script kFirst{{}, {}, {kChain}, {{"map", "base", 10}}};
const Script kReuse{{},
                    {kChain},
                    {{Step::kRemove, {}, "base"}, set(10, {{"map", "tip"}})},
                    {{"map", "base", 10}, {"map", "tip", 10}}};
const Script kMove{{}, {kChain}, {set(20, {{"map", "base"}})}, {{"map", "base", std::nullopt}}};
constexpr FrameId kBase = 2;  // frames are numbered in order of creation

}  // namespace

TFDB_TEST(commits_hold_in_the_memory_model) {
    for (const Script* script : {&kBatch, &kFirst, &kReuse, &kMove}) {
        holds(*script, iterations() / 4);
    }
}

TFDB_TEST(every_memory_order_of_commits_is_needed) {
    needs("release of commit", kBatch, {.store = root_word(graph::kCommit)});
    needs("acquire of commit", kFirst, {.load = root_word(graph::kCommit)});
    needs("release of tail", kBatch, {.store = header_word(kBase, history::kTail)});
    needs("acquire of tail", kLatest, {.load = header_word(kBase, history::kTail)});
    needs("release of born", kReuse, {.store = header_word(kBase, history::kBorn)});
    needs("the reader's fence", kReuse, {.no_acquire_fence = true});
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
