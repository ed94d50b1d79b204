// A script of commits as a program for the walker: one writer, one reader, tiny segments.
#pragma once

#include <functional>
#include <iterator>
#include <memory>
#include <string>

#include "tfdb/history/script.sched.hpp"
#include "tfdb/testing/sched/memory.hpp"
#include "tfdb/testing/sched/walk.hpp"

namespace tfdb::history {

namespace script {

/// Segments of one sample, then of two; retired blocks are not kept.
struct SmallMemory : sched::BasicMemory<2> {
    using BasicMemory::BasicMemory;
};

}  // namespace script

template <>
struct Tuning<script::SmallMemory> {
    static constexpr unsigned kFirstLog2 = 0;
    static constexpr unsigned kFullLog2 = 1;
    static constexpr unsigned kFanLog2 = 1;
    static constexpr unsigned kSmallLog2 = 1;
    static constexpr unsigned kLargestLog2 = 2;
    static constexpr std::size_t kKept = 0;
};

namespace script {

inline constexpr std::size_t kRegionBytes = 8192;
inline constexpr std::size_t kWriter = 0;  // thread numbers
inline constexpr std::size_t kReader = 1;

inline void name_words(const SmallMemory& memory, const Places& places, unsigned edges) {
    static constexpr const char* kNames[] = {
        "tail",      "directory", "topology", "since",       "born",   "rate", "changed",
        "forgotten", "older",     "reshaped", "parent_from", "late",   "died", "name",
        "children",  "authority", "lock",     "next_free",   "touched"};
    memory.word(places.commit).rename("commit", 0);
    for (unsigned edge = 0; edge < edges; ++edge) {
        for (unsigned word = 0; word < std::size(kNames); ++word) {
            memory.word(places.header(edge) + 8 * word).rename(kNames[word], edge);
        }
    }
}

/// Makes the interceptor that seeds a bug, once per execution; none by default.
using MakeFlaw =
    std::function<std::unique_ptr<sched::Interceptor>(const SmallMemory&, const Places&)>;

/// The reader's work: script::read, or a version of it with a bug.
using Read = bool (*)(SmallMemory&, const Places&, const Script&, const Model&, StampNs);

inline void require(bool holds, const char* text) {
    sched::Run::require(holds, text, "snapshot", 0);
}

inline bool read_soundly(SmallMemory& memory, const Places& places, const Script& script,
                         const Model& model, StampNs stamp) {
    return read(memory, places, script, model, stamp, require);
}

/// Writes the script's part before the threads start.
inline Places prepare(SmallMemory& memory, const Script& script) {
    const Places places = place(memory, script);
    name_words(memory, places, script.edges);
    for (std::size_t batch = 0; batch < script.before.size(); ++batch) {
        write(memory, places, script, batch);
    }
    return places;
}

inline void write_all(SmallMemory& memory, const Places& places, const Script& script) {
    for (std::size_t batch = 0; batch < script.during.size(); ++batch) {
        write(memory, places, script, script.before.size() + batch);
    }
}

/// The writer runs the script; the reader looks up `stamp`, again if it was overtaken. Readers
/// write nothing and writers are serialised, so one of each covers any number.
inline sched::Program program(const Script& script, StampNs stamp, int tries = 2,
                              const MakeFlaw& make_flaw = {}, Read reader = read_soundly) {
    const Model model(script);
    return [=](sched::Run& run) {
        SmallMemory memory(kRegionBytes);
        const Places places = prepare(memory, script);
        std::unique_ptr<sched::Interceptor> flaw;
        if (make_flaw) {
            flaw = make_flaw(memory, places);
            memory.intercept(flaw.get());
        }
        run.thread("writer", [&] { write_all(memory, places, script); });
        run.thread("reader", [&] {
            for (int attempt = 0; attempt < tries; ++attempt) {
                if (reader(memory, places, script, model, stamp)) {
                    return;
                }
            }
        });
        run.join();
        if (flaw == nullptr) {
            SCHED_REQUIRE(memory.word(places.commit).peek() == model.last());
            const bool answered = read_soundly(memory, places, script, model, stamp);
            SCHED_REQUIRE(answered);
        }
    };
}

/// The writer is killed after `death` accesses; the reader must still get an answer, repeatedly.
/// `died` tells whether the writer got that far.
inline sched::Program program_with_death(const Script& script, StampNs stamp, std::size_t death,
                                         bool& died) {
    const Model model(script);
    return [=, &died](sched::Run& run) {
        SmallMemory memory(kRegionBytes);
        const Places places = prepare(memory, script);
        const auto answered = [&] { return read_soundly(memory, places, script, model, stamp); };
        run.thread(
            "writer", [&] { write_all(memory, places, script); }, death);
        // Its retries after being overtaken are walked without deaths.
        run.thread("reader", [&] { (void)answered(); });
        run.join();
        died = run.died(kWriter);
        SCHED_REQUIRE(answered());
    };
}

inline Batch one(StampNs stamp, FrameId parent = 5) {
    return {.puts = {{0, stamp, parent}}};
}
inline Batch both(StampNs stamp) {
    return {.puts = {{0, stamp}, {1, stamp}}};
}
/// One edge's samples, appended in one call; every other one names another parent on request.
inline Batch together(const std::vector<StampNs>& stamps, bool mixed = false) {
    Batch batch;
    batch.together = true;
    for (const StampNs stamp : stamps)
        batch.puts.push_back(
            {0, stamp, mixed && batch.puts.size() % 2 == 1 ? FrameId{6} : FrameId{5}});
    return batch;
}
inline Batch aborted(Batch batch) {
    batch.aborted = true;
    return batch;
}

}  // namespace script

}  // namespace tfdb::history
