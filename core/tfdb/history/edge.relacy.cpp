// The edge protocol in the C++ memory model: one writer, two readers, random weak executions. It
// covers what the walk of interleavings (edge.sched.cpp) cannot: loads of old values, and stores
// that other threads see in another order. Removing a memory order that matters proves that it
// matters.
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

using SmallMemory = relacy::Memory<1, 8192>;

/// Segments of one sample, then of two; retired blocks are not kept.
template <>
struct Tuning<SmallMemory> {
    static constexpr unsigned kFirstLog2 = 0;
    static constexpr unsigned kFullLog2 = 1;
    static constexpr unsigned kFanLog2 = 1;
    static constexpr unsigned kSmallLog2 = 1;
    static constexpr unsigned kLargestLog2 = 2;
    static constexpr std::size_t kKept = 0;
};

namespace script {

namespace {

constexpr unsigned kReaders = 2;
constexpr int kTries = 10;  // more than the writer can overtake
constexpr unsigned kIdleSteps = 400;
constexpr unsigned kPause = 400;

/// The input of the simulation. Relacy constructs the simulated object itself, so it reads the
/// input here.
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

    /// `spared()`: whether a reader may still read old samples.
    template <class Spared>
    void write_all(Spared spared) {
        const std::size_t already = g_task.script.before.size();
        for (std::size_t batch = 0; batch < g_task.script.during.size(); ++batch)
            write(memory, places, g_task.script, already + batch, !spared());
    }

    /// A writer takes many more steps than a reader: readers start at any point of it.
    void idle() {
        for (unsigned steps = rl::rand(kIdleSteps); steps > 0; --steps) {
            (void)memory.word(0).load_relaxed();
        }
    }

    SmallMemory::Word& pins() { return memory.word(places.commit + 8); }
};

/// Each reader reads a fresh snapshot, and another one if it was overtaken.
template <class Look>
struct Beside : rl::test_suite<Beside<Look>, 1 + kReaders>, Scene {
    void before() { Scene::before(); }

    void thread(unsigned index) {
        if (index == 0) {
            write_all([] { return !g_task.script.may_evict; });
            return;
        }
        idle();
        for (int attempt = 0; attempt < 2; ++attempt) {
            if (Look::at(*this))
                return;
        }
    }

    void after() { RL_ASSERT(Look::at(*this)); }
};

struct LookAtEdges {
    static bool at(Scene& scene) {
        return read(scene.memory, scene.places, g_task.script, *g_task.model, g_task.stamp,
                    require);
    }
};
struct LookAtFigures {
    static bool at(Scene& scene) {
        return read_extent(scene.memory, scene.places, g_task.script, *g_task.model, require);
    }
};
using Edges = Beside<LookAtEdges>;
using Figures = Beside<LookAtFigures>;

/// Readers that hold a snapshot: as in store::Buffer, they pin it, and a writer that sees a pin
/// keeps the samples that they may need. They lose no samples.
struct HeldSnapshots : rl::test_suite<HeldSnapshots, 1 + kReaders>, Scene {
    void before() { Scene::before(); }

    void thread(unsigned index) {
        if (index == 0) {
            write_all([&] {
                SmallMemory::fence_full();
                return pins().load_relaxed() != 0;
            });
            return;
        }
        idle();
        pins().fetch_add(1);
        SmallMemory::fence_full();
        const CommitNumber held = memory.word(places.commit).load_acquire();
        // It may be overtaken, but its samples are not lost.
        bool answered = false;
        for (int tries = 0; tries < kTries && !answered; ++tries) {
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

/// Runs the script; empty if all executions keep the promises, otherwise Relacy's report of the
/// first violation.
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

/// Without the order that `weakness` removes, some execution must break a promise.
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

/// Words lie where `place` puts them: the commit word's line first, then the headers.
constexpr Offset kCommitAt = 64;
constexpr Offset header_word(HeaderWord word) {
    return 128 + 8 * Offset{word};
}

Batch aborted(Batch batch) {
    batch.aborted = true;
    return batch;
}

const Script kAppends{.before = {one(10)}, .during = {one(20), one(30), one(40)}};
const Script kSeals{.before = {one(10), one(20)}, .during = {one(30), one(40), one(50), one(60)}};
const Script kEvicts{.history = 15,
                     .before = {one(10), one(30)},
                     .during = {one(50), one(70), one(90), one(110), one(130), one(150)}};
const Script kTwoEdges{
    .history = 15, .edges = 2, .before = {both(10), both(30)}, .during = {both(50), both(70)}};
/// No block is retired: the commit alone determines what is visible.
const Script kInPlace{.edges = 2, .before = {both(10)}, .during = {both(20)}};
const Script kLate{.before = {one(10), one(30)}, .during = {one(20), one(22), one(24), one(26)}};
const Script kLateInNodes{
    .before = {one(10), one(20), one(30), one(50), one(60), one(90), one(95), one(35)},
    .during = {one(36), one(40)}};
const Script kAbortsInNodes{
    .before = {one(10), one(20), one(30), one(50), one(60), one(90), one(95)},
    .during = {aborted({{{0, 35}, {0, 70}}}), one(36)}};
const Script kFront{.before = {one(50), one(60), one(70)},
                    .during = {one(40), one(30), one(20), one(10)}};
const Script kCorrects{.before = {one(10), one(10)}, .during = {one(10), one(10), one(10)}};
const Script kClears{.before = {one(10), one(20)}, .during = {{{{0, kClearMarker}}}, one(5)}};
/// Earlier versions stay: a reader sent to the wrong one finds samples there.
const Script kClearsTwice{
    .before = {one(10)},
    .during = {{{{0, kClearMarker}, {0, 20}}}, {{{0, kClearMarker}, {0, 30}}}, one(40)},
    .may_evict = false};
const Script kAborts{.before = {one(10)}, .during = {aborted(one(20)), one(30)}};
const Script kAbortsFull{.history = 15,
                         .before = {one(10), one(30)},
                         .during = {aborted({{{0, 50}, {0, 60}}}), one(40), one(50)}};
const Script kAbortsLate{.before = {one(10), one(30), one(50)},
                         .during = {aborted({{{0, 20}, {0, 25}, {0, 60}}}), one(22)}};
const Script kAbortsMove{.before = {one(10)}, .during = {aborted({{{0, 20, 6}}}), one(30)}};
const Script kAbortsClear{.before = {one(10), one(20)},
                          .during = {aborted({{{0, kClearMarker}, {0, 5}}}), one(30)}};

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
    holds("seals", kSeals, 35);
    holds("evicts", kEvicts, 55);
    holds("two edges, one batch", kTwoEdges, 35);
    holds("late samples, splits", kLate, 25);
    holds("samples before all others", kFront, 45);
    holds("corrections", kCorrects, 10);
    holds("clears", kClears, 15);
    holds("clears twice", kClearsTwice, 25);
    holds("aborts", kAborts, 25);
    holds("aborts where the tail is full", kAbortsFull, 35);
    holds("aborts of late samples", kAbortsLate, 24);
    holds("aborts of a new parent", kAbortsMove, 25);
    holds("aborts of a clear", kAbortsClear, 15);
    relacy::g_pause = kPause;
    holds("evicts beside a slow reader", kEvicts, 75);
    holds("late samples beside a slow reader", kLate, 25);
    holds("corrections beside a slow reader", kCorrects, 10);
    relacy::g_pause = 0;
}

TFDB_TEST(figures_hold_in_the_memory_model) {
    relacy::g_weakness = {};
    for (const auto& [name, script] : {std::pair{"figures, seals", kSeals},
                                       {"figures, late samples", kLateInNodes},
                                       {"figures, late samples taken back", kAbortsInNodes}}) {
        CHECK_EQ(simulate<Figures>(name, script, 0, iterations()), std::string());
    }
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
    needs("release of commit", kInPlace, 15, {.store = kCommitAt});
    needs("release of tail", kAppends, 25, {.store = header_word(kTail)});
    needs("acquire of tail", kAppends, 25, {.load = header_word(kTail)});
    needs("release of directory", kSeals, 15, {.store = header_word(kDirectory)});
    needs("acquire of directory", kSeals, 15, {.load = header_word(kDirectory)});
    needs("release of directory in a split", kLate, 25, {.store = header_word(kDirectory)});
    needs("acquire of directory in a split", kLate, 25, {.load = header_word(kDirectory)});
    needs("release of since", kClearsTwice, 25, {.store = header_word(kSince)});
    needs("release of older", kClearsTwice, 25, {.store = header_word(kOlder)});
    relacy::g_pause = kPause;
    needs("the writer's fence", kEvicts, 75, {.no_release_fence = true});
    needs("the reader's fence", kEvicts, 75, {.no_acquire_fence = true});
    needs("the writer's fence in a split", kLate, 25, {.no_release_fence = true});
    needs("the reader's fence in a split", kLate, 25, {.no_acquire_fence = true});
    relacy::g_pause = 0;
}

}  // namespace script

}  // namespace tfdb::history
