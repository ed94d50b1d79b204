// The lines that a lookup prefetches before its walk, and the hints that show the path.
#include "tfdb/lookup/fetch.hpp"

#include <algorithm>
#include <cstdio>
#include <vector>

#include "tfdb/memory/region.hpp"
#include "tfdb/testing/check.hpp"
#include "tfdb/txn/author.sched.hpp"
#include "tfdb/txn/script.sched.hpp"

namespace tfdb::txn::forest {
namespace {

using history::Topology;

/// Records the prefetched lines.
/// Threads: one. Guarantee: otherwise as Region.
class NotingMemory : public memory::Region {
public:
    void fetch(Offset offset) const { asked.push_back(offset); }
    [[nodiscard]] bool was_asked(Offset offset) const {
        return std::find(asked.begin(), asked.end(), offset) != asked.end();
    }
    mutable std::vector<Offset> asked;
};
using NotingForest = Forest<NotingMemory>;

FrameId id_of(const NotingForest& forest, const char* name) {
    return forest.names.find(name, forest.word(graph::kCommit).load_acquire());
}

Step step_of(StampNs stamp, std::initializer_list<std::pair<const char*, const char*>> edges) {
    Step step;
    for (const auto& [parent, child] : edges)
        step.edges.push_back({parent, child, stamp});
    return step;
}

/// map <- base <- arm and base <- cam, with two samples each.
NotingForest& robot() {
    static NotingForest forest{Script{}};
    if (forest.frames.count() == 0) {
        const auto edges = {std::pair{"map", "base"}, {"base", "arm"}, {"base", "cam"}};
        CHECK(forest.apply(step_of(10, edges), 0));
        CHECK(forest.apply(step_of(20, edges), 1));
    }
    forest.memory.asked.clear();
    return forest;
}

bool hints_are_the_topology(const NotingForest& forest) {
    for (FrameId id = 0; id < forest.frames.count(); ++id) {
        const std::uint64_t hint = forest.frames.hint(id);
        const std::uint64_t topology = forest.frames.topology(id);
        if (Topology::parent(hint) != Topology::parent(topology) ||
            Topology::depth(hint) != Topology::depth(topology)) {
            return false;
        }
    }
    return true;
}

}  // namespace

TFDB_TEST(fetch_asks_for_headers_and_newest_samples_of_a_path) {
    const NotingForest& forest = robot();
    const FrameId arm = id_of(forest, "arm");
    const FrameId cam = id_of(forest, "cam");
    CHECK_EQ(lookup::fetch_path(forest.frames, cam, arm), 2U);
    CHECK_EQ(forest.memory.asked.size(), 6U);
    for (const FrameId id : {arm, cam}) {
        const history::Segment<NotingMemory> tail(
            forest.memory, forest.frames.word(id, history::kTail).load_relaxed());
        CHECK(forest.memory.was_asked(forest.frames.header(id)));
        CHECK(forest.memory.was_asked(tail.stamp_offset(1)));
        CHECK(forest.memory.was_asked(tail.slot(1)));
    }
    CHECK_EQ(lookup::fetch_path(forest.frames, arm, arm), 0U);
    // It stops at a root.
    CHECK_EQ(lookup::fetch_path(forest.frames, id_of(forest, "map"), arm), 2U);
}

TFDB_TEST(fetch_ends_where_hints_lead_in_a_circle) {
    NotingForest& forest = robot();
    const FrameId base = id_of(forest, "base");
    const FrameId arm = id_of(forest, "arm");
    auto& topology = forest.frames.word(base, history::kTopology);
    const std::uint64_t right = topology.load_relaxed();
    topology.store_relaxed(Topology::with_parent(right, arm, 9));
    forest.frames.refresh_hint(base);
    const unsigned most = lookup::fetch_path(forest.frames, id_of(forest, "map"), arm);
    CHECK(most > 2 && most <= 64);
    topology.store_relaxed(right);
    forest.frames.refresh_hint(base);
}

TFDB_TEST(fetch_hints_follow_every_commit) {
    for (std::uint64_t seed = 1; seed <= 300; ++seed) {
        const Script script = Author(seed).script();
        NotingForest forest(script);
        std::size_t number = 0;
        for (const auto* steps : {&script.before, &script.during}) {
            for (const Step& step : *steps) {
                CHECK_EQ(forest.apply(step, number++), step.kind != Step::kSetCycle);
                if (!hints_are_the_topology(forest)) {
                    CHECK(false);
                    std::printf("  seed %llu, step %zu: %s\n",
                                static_cast<unsigned long long>(seed), number,
                                describe(script).c_str());
                    return;
                }
            }
        }
    }
}

}  // namespace tfdb::txn::forest
