// Every interleaving of one writer and one reader of edges: what a snapshot sees is exactly the
// state of its commit. Readers write nothing and writers take turns, so one of each is enough.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <random>
#include <string>
#include <vector>

#include "tfdb/history/script.sched.hpp"
#include "tfdb/testing/sched/memory.hpp"
#include "tfdb/testing/sched/walk.hpp"

namespace tfdb::history {

namespace script {
/// Rings that start with two slots, two runs at most, no lateness without a new run.
struct SmallMemory : sched::BasicMemory<2> {
    using BasicMemory::BasicMemory;
};
}  // namespace script

template <>
struct Tuning<script::SmallMemory> {
    static constexpr unsigned kFirstLog2Capacity = 1;
    static constexpr unsigned kMaxRuns = 2;
    static constexpr std::uint64_t kSlackLimit = 1;
};

namespace {

using sched::Program;
using sched::Run;
using sched::Walk;
using script::Batch;
using script::Put;
using script::Script;
using script::SmallMemory;

constexpr std::size_t kRegionBytes = 4096;

void name_words(SmallMemory& memory, const script::Places& places, const Script& script) {
    static constexpr const char* kNames[] = {
        "ring",       "head",      "begin",        "topology",   "head_commit",   "newest",
        "rate",       "born",      "order",        "sorted_end", "sorted_commit", "cleared",
        "evict_safe", "died",      "name",         "lock",       "children",      "authority",
        "late",       "next_free", "ordered_from", "parent_from"};
    memory.word(places.commit).rename("commit", 0);
    for (unsigned edge = 0; edge < script.edges; ++edge) {
        for (unsigned word = 0; word < std::size(kNames); ++word) {
            memory.word(places.header(edge) + 8 * word).rename(kNames[word], edge);
        }
    }
}

/// The writer runs the script; the reader looks up `stamp`, again when it was overtaken.
template <class Memory = SmallMemory>
Program program(const Script& script, StampNs stamp, int tries = 2) {
    const script::Model model(script);
    return [=](Run& run) {
        Memory memory(kRegionBytes);
        const script::Places places = script::place(memory, script);
        name_words(memory, places, script);
        for (std::size_t batch = 0; batch < script.before.size(); ++batch) {
            script::write(memory, places, script, batch);
        }
        const auto require = [](bool holds, const char* text) {
            Run::require(holds, text, "snapshot", 0);
        };
        run.thread("writer", [&] {
            for (std::size_t batch = 0; batch < script.during.size(); ++batch) {
                script::write(memory, places, script, script.before.size() + batch);
            }
        });
        run.thread("reader", [&] {
            for (int attempt = 0; attempt < tries; ++attempt) {
                if (script::read(memory, places, script, model, stamp, require)) {
                    return;
                }
            }
        });
        run.join();
        SCHED_REQUIRE(memory.word(places.commit).peek() == model.last());
        const bool answered = script::read(memory, places, script, model, stamp, require);
        SCHED_REQUIRE(answered);
    };
}

Batch one(StampNs stamp, FrameId parent = 5) {
    return {{{0, stamp, parent}}};
}

Batch both(StampNs stamp) {
    return {{{0, stamp}, {1, stamp}}};
}

Batch aborted(Batch batch) {
    batch.aborted = true;
    return batch;
}

/// A random script that the store would accept: no sample older than the history, one kind of edge.
class Author {
public:
    explicit Author(std::uint64_t seed) : random_(seed) {}

    Script script() {
        static constexpr StampNs kHistories[] = {kForever, 15, 35};
        Script script;
        script.history = kHistories[below(3)];
        script.edges = below(4) == 0 ? 2 : 1;
        newest_.assign(script.edges, kNoStamp);
        is_static_.assign(script.edges, false);
        for (std::uint64_t left = below(6); left > 0; --left) {
            script.before.push_back(batch(script));
        }
        for (std::uint64_t left = 1 + below(2); left > 0; --left) {
            script.during.push_back(batch(script));
        }
        return script;
    }
    StampNs stamp() { return static_cast<StampNs>(5 * below(20)); }

private:
    std::uint64_t below(std::uint64_t limit) { return random_() % limit; }

    Batch batch(const Script& script) {
        Batch made;
        made.aborted = below(6) == 0;
        const std::vector<StampNs> newest = newest_;
        const std::vector<bool> is_static = is_static_;
        const bool clears = below(8) == 0;
        for (unsigned edge = 0; edge < script.edges; ++edge) {
            if (clears) {
                if (newest_[edge] >= 0) {
                    made.puts.push_back({edge, kClearMarker, kNoFrame});
                    newest_[edge] = kNoStamp;
                }
                continue;
            }
            for (std::uint64_t left = 1 + below(5) / 3; left > 0; --left) {
                made.puts.push_back(put(edge, script.history));
            }
        }
        if (made.aborted) {
            newest_ = newest;
            is_static_ = is_static;
        }
        return made;
    }

    Put put(unsigned edge, StampNs history) {
        const auto parent = static_cast<FrameId>(5 + below(8) / 7);
        if (newest_[edge] == kNoStamp && !is_static_[edge] && below(8) == 0) {
            is_static_[edge] = true;
        }
        if (is_static_[edge]) {
            return {edge, kStaticStamp, parent};
        }
        StampNs stamp = newest_[edge] + static_cast<StampNs>(1 + below(20));
        if (newest_[edge] >= 0 && below(3) == 0) {
            stamp = newest_[edge] - static_cast<StampNs>(below(30));
            stamp = std::max({stamp, newest_[edge] - history, StampNs{0}});
        }
        newest_[edge] = std::max(newest_[edge], stamp);
        return {edge, stamp, parent};
    }

    std::mt19937_64 random_;
    std::vector<StampNs> newest_;
    std::vector<bool> is_static_;
};

std::string describe(const Script& script, StampNs stamp) {
    std::string text =
        "history " + std::to_string(script.history) + ", asked at " + std::to_string(stamp) + ":";
    const auto add = [&](const std::vector<Batch>& batches) {
        for (const Batch& batch : batches) {
            text += batch.aborted ? " aborted[" : " [";
            for (const Put& put : batch.puts) {
                text += " e" + std::to_string(put.edge) + "@" + std::to_string(put.stamp) + ">" +
                        std::to_string(put.parent);
            }
            text += " ]";
        }
    };
    add(script.before);
    text += " |";
    add(script.during);
    return text;
}

}  // namespace

TFDB_SCHED(edge_random_scripts) {
    constexpr std::uint64_t kSeed = 7;
    const char* const wish = std::getenv("TFDB_SCHED_SCRIPTS");
    const std::uint64_t scripts = wish == nullptr ? 300 : std::strtoull(wish, nullptr, 10);
    std::uint64_t executions = 0;
    for (std::uint64_t seed = kSeed; seed < kSeed + scripts; ++seed) {
        Author author(seed);
        const Script script = author.script();
        const StampNs stamp = author.stamp();
        sched::Options options;
        options.max_executions = 200'000;
        const sched::Outcome outcome = explore(program(script, stamp, 1), options);
        executions += outcome.executions;
        if (std::getenv("V"))
            std::printf("%llu %llu %s\n", (unsigned long long)seed,
                        (unsigned long long)outcome.executions, describe(script, stamp).c_str());
        if (!outcome.exhaustive() || !outcome.violation.empty()) {
            throw sched::Failure{"seed " + std::to_string(seed) + ", " + describe(script, stamp) +
                                 "\n" + outcome.violation + "\n" + outcome.schedule};
        }
    }
    std::printf("  %llu scripts from seed %llu: %llu executions, each walk exhaustive\n",
                static_cast<unsigned long long>(scripts), static_cast<unsigned long long>(kSeed),
                static_cast<unsigned long long>(executions));
}

TFDB_SCHED(edge_first_samples) {
    Walk walk;
    walk.must_hold("first sample", program({.during = {one(10)}}, 15));
    walk.must_hold("second sample", program({.before = {one(10)}, .during = {one(20)}}, 15));
    walk.must_hold("two at once",
                   program({.before = {one(10)}, .during = {{{{0, 20}, {0, 30}}}}}, 25));
}

TFDB_SCHED(edge_batches_over_two_edges) {
    Walk walk;
    walk.must_hold("both edges, one batch",
                   program({.edges = 2, .before = {both(10)}, .during = {both(20)}}, 15));
}

TFDB_SCHED(edge_grows) {
    Walk walk;
    walk.must_hold("third sample in a ring of two",
                   program({.before = {one(10), one(20)}, .during = {one(30)}}, 15));
    walk.must_hold(
        "fourth and fifth, two growths",
        program({.before = {one(10), one(20)}, .during = {one(30), one(40), one(50)}}, 15));
}

TFDB_SCHED(edge_evicts) {
    Walk walk;
    const Script once{.history = 15, .before = {one(10), one(30)}, .during = {one(50)}};
    walk.must_hold("overwrites the oldest", program(once, 35));
    walk.must_hold("overwrites the oldest, asked before it", program(once, 20));
    const Script lapped{
        .history = 15, .before = {one(10), one(30)}, .during = {one(50), one(70), one(90)}};
    walk.must_hold("overwrites all", program(lapped, 55));
}

TFDB_SCHED(edge_takes_late_samples) {
    Walk walk;
    walk.must_hold("one late", program({.before = {one(10), one(30)}, .during = {one(20)}}, 25));
    walk.must_hold("the same stamp again",
                   program({.before = {one(10), one(30)}, .during = {one(30)}}, 30));
    walk.must_hold("late, then in order",
                   program({.before = {one(10), one(30)}, .during = {one(20), one(40)}}, 25));
    walk.must_hold("rebuilt", program({.before = {one(50), one(60), one(40), one(30), one(20)},
                                       .during = {one(10)}},
                                      35));
}

TFDB_SCHED(edge_clears) {
    Walk walk;
    walk.must_hold("clear",
                   program({.before = {one(10), one(20)}, .during = {one(kClearMarker)}}, 15));
    walk.must_hold("clear, then a sample",
                   program({.before = {one(10)}, .during = {one(kClearMarker), one(5)}}, 15));
}

TFDB_SCHED(edge_changes_parent) {
    Walk walk;
    walk.must_hold("new parent", program({.before = {one(10, 5)}, .during = {one(20, 6)}}, 15));
    walk.must_hold(
        "static revised",
        program({.before = {one(kStaticStamp, 5)}, .during = {one(kStaticStamp, 6)}}, 15));
}

TFDB_SCHED(edge_aborts) {
    Walk walk;
    walk.must_hold("one aborted", program({.before = {one(10)}, .during = {aborted(one(20))}}, 15));
    walk.must_hold("aborted, then another",
                   program({.before = {one(10)}, .during = {aborted(one(20)), one(30)}}, 15));
}

}  // namespace tfdb::history
