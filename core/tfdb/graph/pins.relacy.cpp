// Held snapshots in the C++ memory model: readers pin and unpin, and a writer overwrites what the
// oldest of them cannot see. No held snapshot loses a sample; without the fences one does.
#include <algorithm>
#include <string>
#include <vector>

#include "tfdb/graph/pins.hpp"
#include "tfdb/history/script.sched.hpp"
// After all others: it redefines `assert` and more.
#include "tfdb/testing/relacy/simulate.hpp"

namespace tfdb {

using PinsMemory = relacy::Memory<1, 4096>;

template <>
struct history::Tuning<PinsMemory> {
    static constexpr unsigned kFirstLog2 = 0;
    static constexpr unsigned kFullLog2 = 1;
    static constexpr unsigned kFanLog2 = 1;
    static constexpr unsigned kSmallLog2 = 1;
    static constexpr unsigned kLargestLog2 = 2;
    static constexpr std::size_t kKept = 0;
};

namespace graph {

namespace {

using namespace history::script;
using clock::StampNs;

constexpr unsigned kReaders = 2;
constexpr unsigned kIdleSteps = 400;
constexpr unsigned kPause = 400;
constexpr StampNs kAsked = 20;

Batch one(StampNs stamp) {
    return {{{0, stamp}}};
}

/// Every sample leaves the previous one visible, and evicts the one before that.
const Script kScript{
    .history = 15, .before = {one(10)}, .during = {one(20), one(30), one(40), one(50), one(60)}};
const Model* g_model = nullptr;
bool g_reuses_busy_count = false;

void require(bool holds, const char*) {
    RL_ASSERT(holds);
}

struct HeldSnapshots : rl::test_suite<HeldSnapshots, 1 + kReaders> {
    PinsMemory memory;
    Places places;
    Frames<PinsMemory> frames{memory, memory.allocate(kStoreBytes), 0, 1};
    Pins<PinsMemory> held{frames, kHeldPins};
    Pins<PinsMemory> reads{frames, kReadPins};

    void before() {
        places = place(memory, kScript);
        write(memory, places, kScript, 0);
    }

    void thread(unsigned index) {
        if (index == 0) {
            for (std::size_t batch = 0; batch < kScript.during.size(); ++batch) {
                const CommitNumber committed = memory.word(places.commit).load_relaxed();
                const CommitNumber oldest = held.oldest(committed);
                // The seeded bug: a used count gets a newer floor.
                write_beside(memory, places, kScript, 1 + batch,
                             g_reuses_busy_count ? committed : oldest,
                             [this](std::uint64_t epoch) { return reads.oldest(epoch); });
            }
            return;
        }
        for (unsigned steps = rl::rand(kIdleSteps); steps > 0; --steps)
            (void)memory.word(0).load_relaxed();
        hold();
        hold();
    }

    /// Repeats one read, however far the writer has advanced; an overtaken read is pinned, and not
    /// overtaken again.
    void hold() {
        const unsigned pin = held.take(memory.word(places.commit).load_acquire());
        const CommitNumber state = memory.word(places.commit).load_acquire();
        for (int question = 0; question < 2; ++question) {
            if (read_at(memory, places, kScript, *g_model, state, kAsked, require))
                continue;
            const unsigned read_pin = reads.take();
            RL_ASSERT(read_at(memory, places, kScript, *g_model, state, kAsked, require));
            reads.drop(read_pin);
        }
        // A later state by the same pin; the first snapshot is released first.
        const CommitNumber later = memory.word(places.commit).load_acquire();
        held.join(pin);
        held.drop(pin);
        const unsigned read_pin = reads.take();
        RL_ASSERT(read_at(memory, places, kScript, *g_model, later, kAsked, require));
        reads.drop(read_pin);
        held.drop(pin);
    }
};

/// Empty if all executions are correct, otherwise Relacy's report of the first faulty one.
std::string simulated(const char* name, const relacy::Weakness& weakness = {}) {
    constexpr unsigned kDepth = 60'000;
    const Model model(kScript);
    g_model = &model;
    return relacy::simulate<HeldSnapshots>(name, weakness, kDepth);
}

}  // namespace

TFDB_TEST(pins_keep_what_held_snapshots_need) {
    CHECK_EQ(simulated("held snapshots"), std::string());
    CHECK(!simulated("without the fences", {.no_full_fence = true}).empty());
    // Slow enough for the blocks of the samples to be reused.
    relacy::g_pause = kPause;
    CHECK_EQ(simulated("slow held snapshots"), std::string());
    g_reuses_busy_count = true;
    CHECK(!simulated("counts not looked at").empty());
    g_reuses_busy_count = false;
    relacy::g_pause = 0;
}

}  // namespace graph

}  // namespace tfdb
