// Every interleaving of one writer and one reader of edges: a snapshot sees exactly the state of
// its commit.
#include "tfdb/history/edge.sched.hpp"

#include <cstdio>

namespace tfdb::history::script {

namespace {

/// Walks one script once for each stamp.
void holds(const std::string& name, const Script& script, std::initializer_list<StampNs> stamps) {
    sched::Walk walk;
    for (const StampNs stamp : stamps) {
        walk.must_hold(name + ", asked at " + std::to_string(stamp), program(script, stamp));
    }
}

/// Kills the writer after each of its accesses in turn; in a short walk after every third.
void outlived(const std::string& name, const Script& script, StampNs stamp) {
    std::uint64_t executions = 0;
    std::size_t death = 0;
    const std::size_t stride = sched::to_the_end() ? 1 : 3;
    for (bool died = true; died; death += stride) {
        const sched::Outcome outcome =
            sched::explore(program_with_death(script, stamp, death, died));
        executions += outcome.executions;
        if (!outcome.exhaustive() || !outcome.violation.empty()) {
            throw sched::Failure{name + ", killed after " + std::to_string(death) + ": " +
                                 outcome.violation + "\n" + outcome.schedule};
        }
    }
    std::printf("  %-58s %9llu executions, killed at %zu accesses, exhaustive\n", name.c_str(),
                static_cast<unsigned long long>(executions), death / stride - 1);
}

}  // namespace

namespace {

bool read_all_soundly(SmallMemory& memory, const Places& places, const Script& script,
                      const Model& model, StampNs) {
    return read_all(memory, places, script, model, require);
}

void visited(const std::string& name, const Script& script) {
    sched::Walk().must_hold(name, program(script, 0, 2, {}, read_all_soundly));
}

bool sum_up_soundly(SmallMemory& memory, const Places& places, const Script& script,
                    const Model& model, StampNs) {
    return read_extent(memory, places, script, model, require);
}

void summed(const std::string& name, const Script& script) {
    sched::Walk().must_hold(name, program(script, 0, 2, {}, sum_up_soundly));
}

}  // namespace

// Nodes summarise two segments of two samples each, and two such nodes.
TFDB_SCHED(edge_sums_up_what_a_snapshot_sees) {
    const std::vector<Batch> seven = {one(10), one(20), one(30), one(50),
                                      one(60), one(90), one(95)};
    const auto from = [&](std::initializer_list<Batch> more) {
        std::vector<Batch> all = seven;
        all.insert(all.end(), more);
        return all;
    };
    summed("appends", {.before = {one(10), one(20)}, .during = {one(30), one(40), one(50)}});
    summed("seals, completes nodes", {.before = seven, .during = {one(97), one(130), one(140)}});
    summed("late", {.before = from({one(100)}), .during = {one(35)}});
    summed("late, the same again", {.before = from({one(35)}), .during = {one(36), one(40)}});
    summed("corrects", {.before = from({one(30)}), .during = {one(30)}, .may_evict = false});
    summed("evicts", {.history = 65, .before = seven, .during = {one(120), one(150)}});
    summed("a late sample taken back", {.before = seven, .during = {aborted(one(35))}});
    summed("a clear taken back, then late",
           {.before = seven, .during = {aborted(one(kClearMarker)), one(35)}, .may_evict = false});
}

TFDB_SCHED(edge_visits_each_sample_once) {
    visited("appends", {.before = {one(10), one(20)}, .during = {one(30), one(40), one(50)}});
    visited("appends together",
            {.before = {one(10)}, .during = {together({20, 30, 40}), together({50, 50})}});
    visited("late", {.before = {one(10), one(30), one(50)}, .during = {one(20), one(25)}});
    visited("late in what was just sealed",
            {.before = {one(10), one(30)}, .during = {one(40), one(20)}, .may_evict = false});
    visited("corrects",
            {.before = {one(10), one(20)}, .during = {one(20), one(10)}, .may_evict = false});
    visited("evicts",
            {.history = 15, .before = {one(10), one(20)}, .during = {one(40), one(60), one(80)}});
    visited("a clear taken back, then seals",
            {.before = {one(10), one(20), one(30)},
             .during = {aborted(one(kClearMarker)), one(40), one(50), one(60)},
             .may_evict = false});
    visited("late samples taken back", {.before = {one(10), one(30), one(50)},
                                        .during = {aborted({{{0, 20}, {0, 25}}}), one(22)}});
}

// At whichever step the writer has stopped for ever, readers get answers.
TFDB_SCHED(edge_readers_outlive_the_writer) {
    outlived("appends", {.before = {one(10)}, .during = {one(20), one(30)}}, 15);
    outlived("appends together", {.before = {}, .during = {together({10, 20, 30}, true)}}, 15);
    outlived("appends together, evicting",
             {.history = 15, .before = {one(10)}, .during = {together({30, 50, 70})}}, 35);
    outlived("aborts what was appended together",
             {.before = {one(10)}, .during = {aborted(together({20, 30, 40})), one(50)}}, 15);
    outlived("evicts", {.history = 15, .before = {one(10), one(30)}, .during = {one(50), one(70)}},
             35);
    outlived("seals", {.before = {one(10), one(20)}, .during = {one(30), one(40), one(50)}}, 15);
    outlived("two edges", {.edges = 2, .before = {both(10)}, .during = {both(20)}}, 15);
    outlived("late", {.before = {one(10), one(30)}, .during = {one(20)}}, 15);
    outlived("splits", {.before = {one(10), one(30), one(50)}, .during = {one(20), one(25)}}, 22);
    outlived("before all others", {.before = {one(30), one(40)}, .during = {one(20), one(10)}}, 35);
    outlived("corrects", {.before = {one(10), one(10)}, .during = {one(10), one(10)}}, 10);
    outlived("clears", {.before = {one(10), one(20)}, .during = {one(kClearMarker), one(5)}}, 15);
    outlived("aborts", {.before = {one(10)}, .during = {aborted(one(20)), one(30)}}, 15);
    outlived("aborts where the tail is full",
             {.history = 15,
              .before = {one(10), one(30)},
              .during = {aborted({{{0, 50}, {0, 60}}}), one(40)}},
             35);
    outlived("aborts late samples",
             {.before = {one(10), one(30), one(50)},
              .during = {aborted({{{0, 20}, {0, 25}, {0, 60}}}), one(22)}},
             24);
    outlived("aborts a clear",
             {.before = {one(10), one(20)}, .during = {aborted(one(kClearMarker)), one(30)}}, 15);
}

TFDB_SCHED(edge_first_samples) {
    holds("first sample", {.before = {}, .during = {one(10)}}, {5, 10, 15});
    holds("second sample", {.before = {one(10)}, .during = {one(20)}}, {10, 15, 20, 25});
    holds("two in one batch", {.before = {one(10)}, .during = {{{{0, 20}, {0, 30}}}}}, {15, 25});
}

TFDB_SCHED(edge_batches_of_one_edge) {
    holds("first samples", {.before = {}, .during = {together({10, 20, 30})}}, {10, 25, 35});
    holds("of two parents", {.before = {one(10)}, .during = {together({20, 30, 40}, true)}},
          {15, 25, 35});
    holds("the same stamp", {.before = {one(10)}, .during = {together({10, 20, 20})}}, {10, 20});
    holds("late ones, then others",
          {.before = {one(10), one(30), one(50)}, .during = {together({20, 25, 60, 70})}},
          {22, 65});
    holds("evicting", {.history = 15, .before = {one(10), one(30)}, .during = {together({50, 70})}},
          {20, 60});
}

TFDB_SCHED(edge_batches_over_two_edges) {
    holds("both edges", {.edges = 2, .before = {both(10)}, .during = {both(20)}}, {10, 15, 25});
    holds("both edges, evicting",
          {.history = 5, .edges = 2, .before = {both(10), both(20)}, .during = {both(30)}},
          {20, 30});
}

TFDB_SCHED(edge_seals) {
    holds("third where two fit", {.before = {one(10), one(20)}, .during = {one(30)}}, {15, 25});
    holds("two seals", {.before = {one(10), one(20)}, .during = {one(30), one(40), one(50)}},
          {15, 45});
}

// Nodes as above: a delayed reader skips several segments at once.
TFDB_SCHED(edge_readers_pass_over_newer_segments) {
    holds("ahead", {.before = {one(10)}, .during = {together({20, 30, 40, 50, 60, 70, 80})}}, {15});
    holds("in their midst",
          {.before = {one(10), one(90), one(95)}, .during = {together({20, 30, 40, 50, 60})}},
          {15, 55});
}

TFDB_SCHED(edge_evicts) {
    holds("the oldest goes", {.history = 15, .before = {one(10), one(30)}, .during = {one(50)}},
          {20, 35});
    holds("all of it goes",
          {.history = 15, .before = {one(10), one(30)}, .during = {one(50), one(70), one(90)}},
          {20, 55});
    holds("stays: a held snapshot may need what is oldest",
          {.history = 15, .before = {one(10), one(30)}, .during = {one(50)}, .may_evict = false},
          {20, 35});
}

TFDB_SCHED(edge_takes_late_samples) {
    holds("one late", {.before = {one(10), one(30)}, .during = {one(20)}}, {15, 25});
    holds("the same stamp again and again",
          {.before = {one(10), one(30)}, .during = {one(30), one(30), one(40)}}, {20, 30});
    holds("the same stamp after a snapshot was closed",
          {.before = {one(30), one(30), one(30), one(30)},
           .during = {one(30), one(40)},
           .held_before = true},
          {20, 30});
    holds("the same stamp again", {.before = {one(10), one(30)}, .during = {one(30)}}, {20, 30});
    holds("late, then in order", {.before = {one(10), one(30)}, .during = {one(20), one(40)}},
          {25});
    holds("split", {.before = {one(17), one(37), {{{0, 15}, {0, 19}}}}, .during = {one(11)}},
          {16, 36, 40});
}

TFDB_SCHED(edge_clears) {
    holds("clear", {.before = {one(10), one(20)}, .during = {one(kClearMarker)}}, {15});
    holds("clear, then a sample", {.before = {one(10)}, .during = {one(kClearMarker), one(5)}},
          {7, 15});
    holds("clear of late samples",
          {.before = {one(1), {{{0, 0}, {0, 4}}}, {{{0, 14}, {0, 3}}}},
           .during = {one(kClearMarker), one(3)}},
          {70});
}

TFDB_SCHED(edge_changes_parent_or_pose) {
    holds("new parent", {.before = {one(10, 5)}, .during = {one(20, 6)}}, {15, 20});
    holds("static revised",
          {.before = {one(kStaticStamp, 5)}, .during = {one(kStaticStamp, 6), one(kStaticStamp)}},
          {15});
}

TFDB_SCHED(edge_aborts) {
    holds("aborted", {.before = {one(10)}, .during = {aborted(one(20))}}, {15});
    holds("aborted, then another", {.before = {one(10)}, .during = {aborted(one(20)), one(30)}},
          {15});
    holds("aborted where the tail is full, then another",
          {.history = 15, .before = {one(10), one(30)}, .during = {aborted(one(50)), one(40)}},
          {20, 35});
    holds("aborted and sealed, then another",
          {.before = {one(10), one(20)}, .during = {aborted({{{0, 30}, {0, 40}}}), one(35)}},
          {15, 25, 37});
    holds("aborted twice",
          {.before = {one(10)}, .during = {aborted(one(20)), aborted(one(30)), one(15)}}, {12, 17});
    holds("aborted after late samples",
          {.before = {one(10), one(30), one(20)}, .during = {aborted(one(50)), one(40)}}, {25, 45});
    holds("aborted new parent", {.before = {one(10)}, .during = {aborted(one(20, 6)), one(30)}},
          {15, 25});
    holds("aborted late sample", {.before = {one(10), one(30)}, .during = {aborted(one(20))}},
          {15, 25});
    holds("aborted clear of late samples",
          {.before = {one(10), one(30), one(20)}, .during = {aborted(one(kClearMarker)), one(40)}},
          {15, 25});
    holds("aborted on both edges",
          {.edges = 2, .before = {both(10)}, .during = {aborted(both(20))}}, {15});
}

}  // namespace tfdb::history::script
