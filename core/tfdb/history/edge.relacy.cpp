// The edge protocol in the C++ memory model: one writer, two readers, random weak executions. What
// the walk of interleavings (edge.sched.cpp) cannot see: loads of old values and stores that other
// threads see in another order. Each memory order that matters is proved to matter by leaving it
// out.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <ostream>
#include <string>
#include <vector>

#include "tfdb/history/author.sched.hpp"
#include "tfdb/history/script.sched.hpp"
#include "tfdb/testing/check.hpp"
// After all others: it redefines `assert` and more.
#include "tfdb/testing/relacy/memory.hpp"

namespace tfdb::history {

using SmallMemory = relacy::Memory<1, 2048>;

/// Rings that start with two slots, at most two runs, no lateness without a new run.
template <>
struct Tuning<SmallMemory> {
    static constexpr unsigned kFirstLog2Capacity = 1;
    static constexpr unsigned kMaxRuns = 2;
    static constexpr std::uint64_t kSlackLimit = 1;
};

namespace script {

namespace {

constexpr unsigned kReaders = 2;
constexpr unsigned kIdleSteps = 128;

/// What the simulation runs. Relacy makes the simulated object itself, so it finds it here.
struct Task {
    Script script;
    StampNs stamp = 0;
    const Model* model = nullptr;
};
Task g_task;

void require(bool holds, const char*) {
    RL_ASSERT(holds);
}

/// One store, prepared, and its one writer.
struct Scene {
    SmallMemory memory;
    Places places;

    void before() {
        places = place(memory, g_task.script);
        for (std::size_t batch = 0; batch < g_task.script.before.size(); ++batch) {
            write(memory, places, g_task.script, batch);
        }
    }

    void write_all() {
        const std::size_t already = g_task.script.before.size();
        for (std::size_t batch = 0; batch < g_task.script.during.size(); ++batch) {
            SmallMemory::fence_full();
            const bool may_evict = pins().load_relaxed() == 0;
            write(memory, places, g_task.script, already + batch, may_evict);
        }
    }

    /// A writer takes many more steps than a reader: readers start anywhere beside it.
    void idle() {
        for (unsigned steps = rl::rand(kIdleSteps); steps > 0; --steps) {
            (void)memory.word(0).load_relaxed();
        }
    }

    SmallMemory::Word& pins() { return memory.word(places.commit + 8); }
};

/// Each reader takes a fresh snapshot, and another one if it was overtaken.
struct Edges : rl::test_suite<Edges, 1 + kReaders>, Scene {
    void before() { Scene::before(); }

    void thread(unsigned index) {
        if (index == 0) {
            write_all();
            return;
        }
        idle();
        for (int attempt = 0; attempt < 2; ++attempt) {
            if (read(memory, places, g_task.script, *g_task.model, g_task.stamp, require)) {
                return;
            }
        }
    }

    void after() {
        RL_ASSERT(read(memory, places, g_task.script, *g_task.model, g_task.stamp, require));
    }
};

/// Readers that hold a snapshot: as store::Buffer does, they count themselves as pins, and a writer
/// that sees a pin makes the ring grow instead of overwriting. No samples are lost under them.
struct HeldSnapshots : rl::test_suite<HeldSnapshots, 1 + kReaders>, Scene {
    void before() { Scene::before(); }

    void thread(unsigned index) {
        if (index == 0) {
            write_all();
            return;
        }
        idle();
        pins().fetch_add(1);
        SmallMemory::fence_full();
        const CommitNumber held = memory.word(places.commit).load_acquire();
        // A ring that grows turns a reader back, but not more often than it grows.
        bool answered = false;
        for (int attempt = 0; attempt < 4 && !answered; ++attempt) {
            answered =
                read_at(memory, places, g_task.script, *g_task.model, held, g_task.stamp, require);
        }
        RL_ASSERT(answered);
        pins().fetch_add(~std::uint64_t{0});
    }
};

unsigned long iterations() {
    const char* const wish = std::getenv("TFDB_RELACY_ITERATIONS");
    return wish == nullptr ? 20'000 : std::strtoul(wish, nullptr, 10);
}

/// Runs the script; empty if no execution breaks a promise, else Relacy's account of the first.
template <class Suite = Edges>
std::string simulate(const std::string& name, const Script& script, StampNs stamp,
                     unsigned long executions_wanted) {
    const Model model(script);
    g_task = {script, stamp, &model};
    relacy::Account account;
    relacy::Account ignored;
    std::ostream output(&account);
    std::ostream progress(&ignored);
    rl::test_params params;
    params.iteration_count = executions_wanted;
    params.output_stream = &output;
    params.progress_stream = &progress;
    params.execution_depth_limit = 20'000;
    const bool held = rl::simulate<Suite>(params);
    const auto executions = static_cast<unsigned long>(params.stop_iteration);
    if (!name.empty()) {
        std::printf("  %-52s %8lu executions, %s\n", name.c_str(), executions,
                    held ? "all hold" : "violated");
        std::fflush(stdout);
    }
    return held ? std::string() : account.text();
}

void holds(const std::string& name, const Script& script, StampNs stamp) {
    relacy::g_weakness = {};
    CHECK_EQ(simulate(name, script, stamp, iterations()), std::string());
}

/// Without the order that `weakness` leaves out, some execution must break a promise.
void needs(const std::string& name, const Script& script, StampNs stamp,
           const relacy::Weakness& weakness) {
    relacy::g_weakness = weakness;
    CHECK(!simulate("without " + name, script, stamp, iterations()).empty());
    relacy::g_weakness = {};
}

Batch one(StampNs stamp) {
    return {{{0, stamp}}};
}
Batch both(StampNs stamp) {
    return {{{0, stamp}, {1, stamp}}};
}

/// Words lie where `place` puts them: the commit word's line comes first, then the headers.
constexpr Offset kCommitAt = 64;
constexpr Offset header_word(HeaderWord word) {
    return 128 + 8 * Offset{word};
}

const Script kAppends{.before = {one(10)}, .during = {one(20), one(30)}};
const Script kEvicts{
    .history = 15, .before = {one(10), one(30)}, .during = {one(50), one(70), one(90)}};
const Script kTwoEdges{
    .history = 15, .edges = 2, .before = {both(10), both(30)}, .during = {both(50), both(70)}};
/// The ring that the first edge outgrows is the second edge's first one at once.
const Script kGrows{.edges = 2,
                    .before = {one(10), one(20)},
                    .during = {{{{0, 30}, {1, 5}}}, {{{0, 40}, {1, 15}}}}};
const Script kLate{.before = {one(10), one(30)}, .during = {one(20), one(40)}};
const Script kStartsRun{.before = {one(10), one(30), one(20), one(40), one(50)},
                        .during = {one(15)}};
const Script kClears{.before = {one(10), one(20)}, .during = {{{{0, kClearMarker}}}, one(5)}};
const Script kAborts{.before = {one(10)}, .during = {{{{0, 20}}, true}, one(30)}};
const Script kAbortsFull{.history = 15,
                         .before = {one(10), one(30)},
                         .during = {{{{0, 50}, {0, 60}}, true}, one(40), one(50)}};
const Script kAbortsLate{.before = {one(10), one(30)}, .during = {{{{0, 20}}, true}, one(40)}};
const Script kAbortsMove{.before = {one(10)}, .during = {{{{0, 20, 6}}, true}, one(30)}};

const Script kHeld{.history = 15, .before = {one(10)}, .during = {one(30), one(50), one(70)}};

}  // namespace

TFDB_TEST(held_snapshots_lose_nothing) {
    relacy::g_weakness = {};
    CHECK_EQ(simulate<HeldSnapshots>("held snapshots", kHeld, 20, iterations()), std::string());
    relacy::g_weakness = {.no_full_fence = true};
    CHECK(!simulate<HeldSnapshots>("without the fences of pins", kHeld, 20, iterations()).empty());
    relacy::g_weakness = {};
}

TFDB_TEST(edges_hold_in_the_memory_model) {
    holds("appends", kAppends, 25);
    holds("evicts in a ring of two", kEvicts, 55);
    holds("two edges, one batch", kTwoEdges, 35);
    holds("grows, and the old ring is used again", kGrows, 15);
    holds("late samples", kLate, 25);
    holds("a new run", kStartsRun, 45);
    holds("clears", kClears, 15);
    holds("aborts", kAborts, 25);
    holds("aborts in a full ring", kAbortsFull, 35);
    holds("aborts of late samples", kAbortsLate, 35);
    holds("aborts of a new parent", kAbortsMove, 25);
}

TFDB_TEST(random_scripts_hold_in_the_memory_model) {
    constexpr std::uint64_t kSeed = 1;
    constexpr std::uint64_t kScripts = 40;
    relacy::g_weakness = {};
    for (std::uint64_t seed = kSeed; seed < kSeed + kScripts; ++seed) {
        Author author(seed);
        const Script script = author.script();
        const StampNs stamp = author.stamp();
        const std::string account = simulate("", script, stamp, iterations() / 20);
        CHECK_EQ(account.empty() ? account : describe(script, stamp) + account, std::string());
    }
    std::printf("  %llu scripts from seed %llu, %lu executions each\n",
                static_cast<unsigned long long>(kScripts), static_cast<unsigned long long>(kSeed),
                iterations() / 20);
}

TFDB_TEST(every_memory_order_is_needed) {
    needs("release of commit", kTwoEdges, 35, {.store = kCommitAt});
    needs("acquire of commit", kTwoEdges, 35, {.load = kCommitAt});
    needs("release of head", kAppends, 25, {.store = header_word(kHead)});
    needs("acquire of head", kAppends, 25, {.load = header_word(kHead)});
    needs("release of begin", kEvicts, 55, {.store = header_word(kBegin)});
    needs("acquire of begin", kEvicts, 55, {.load = header_word(kBegin)});
    needs("release of ring", kGrows, 15, {.store = header_word(kRing)});
    needs("acquire of ring", kGrows, 15, {.load = header_word(kRing)});
    needs("release of order", kStartsRun, 45, {.store = header_word(kOrder)});
    needs("acquire of order", kStartsRun, 45, {.load = header_word(kOrder)});
    needs("the writer's fence", kEvicts, 55, {.no_release_fence = true});
    needs("the reader's fence", kEvicts, 55, {.no_acquire_fence = true});
    needs("the writer's fence in an abort", kAbortsMove, 25, {.no_release_fence = true});
    needs("the reader's fence beside an abort", kAbortsMove, 25, {.no_acquire_fence = true});
    needs("release of head, which tells of the abort", kAbortsFull, 35,
          {.store = header_word(kHead)});
}

}  // namespace script

}  // namespace tfdb::history
