// Every interleaving of commits with a follower of the feed, and every point at which the writer
// may die: a record is complete or refused, and a frame is noted before it changes.
#include "tfdb/txn/feed.sched.hpp"

#include <functional>
#include <memory>

#include "tfdb/testing/sched/flaws.hpp"
#include "tfdb/testing/sched/memory.hpp"
#include "tfdb/testing/sched/walk.hpp"

namespace tfdb {

namespace txn::feed {

struct SmallMemory : sched::BasicMemory<1> {
    SmallMemory() : BasicMemory(4096) {}
};

}  // namespace txn::feed

template <>
struct txn::FeedTuning<txn::feed::SmallMemory> {
    static constexpr unsigned kCommitsLog2 = 2;
    static constexpr unsigned kWordsLog2 = 2;
};

namespace txn::feed {

namespace {

using SmallStore = Store<SmallMemory>;
using MakeFlaw = std::function<std::unique_ptr<sched::Interceptor>(const SmallStore&)>;

void require(bool holds, const char* text) {
    sched::Run::require(holds, text, "feed", 0);
}

sched::Program program(const Script& script, CommitNumber since, const MakeFlaw& make_flaw = {}) {
    const auto expected = expected_of(script);
    return [=](sched::Run& run) {
        SmallStore store;
        for (const Step& step : script.before)
            store.apply(step);
        const std::unique_ptr<sched::Interceptor> flaw = make_flaw ? make_flaw(store) : nullptr;
        store.memory.intercept(flaw.get());
        run.thread("writer", [&] {
            for (const Step& step : script.during)
                store.apply(step);
        });
        run.thread("follower", [&] { store.follow(since, expected, require); });
        run.join();
        if (flaw == nullptr) {
            SCHED_REQUIRE(store.commit().peek() + 1 == expected.size());
            store.follow(since, expected, require);
            store.follow(store.commit().peek() - 1, expected, require);
        }
    };
}

void holds(const std::string& name, const Script& script, CommitNumber since) {
    sched::Walk().must_hold(name, program(script, since));
}

const Step kTwo{{1, 2}};
const Step kOther{{3, 4}};
const Step kRefused{{5, 6, 7}, true};
const Step kRemoval{{1, 3}, false, true};
/// The ring has four words: each commit overwrites one that the follower may be reading.
const Script kLap{{kTwo, kOther}, {{{5, 6}}, {{1}}}};

}  // namespace

TFDB_SCHED(feed_is_whole_or_refused) {
    holds("a follower who keeps up", {{kTwo}, {kOther}}, 1);
    holds("one who is lapped", kLap, 0);
    holds("one who is not, by another who would be", kLap, 1);
    holds("a removal with its name", {{kTwo}, {kRemoval, kTwo}}, 0);
}

TFDB_SCHED(feed_of_commits_that_are_undone) {
    holds("it is as if they had not been", {{kTwo}, {kRefused, kOther}}, 0);
    holds("they may lap a follower", {{kTwo, kOther}, {kRefused, kRefused}}, 0);
}

TFDB_SCHED(feed_of_a_commit_that_is_larger_than_the_ring) {
    const Step large{{0, 1, 2, 3, 4}};
    holds("it is refused, the next one is whole", {{kTwo}, {large, kOther}}, 1);
    holds("it is undone", {{kTwo}, {{large.frames, true}, kOther}}, 1);
}

TFDB_SCHED(feed_wears_out_by_the_number_of_commits) {
    Script script;
    for (FrameId id = 0; id < 4; ++id)
        script.before.push_back({{}});
    script.during = {{{}}, {{1}}};
    holds("of commits that touch nothing", script, 0);
    holds("the last one that is left", script, 1);
}

TFDB_SCHED(feed_names_what_a_dead_writer_changed) {
    const Script script{{kTwo}, {kRemoval, {{0, 1, 2, 3, 4}}}};
    const auto expected = expected_of(script);
    std::size_t deaths = 0;
    for (bool died = true; died; ++deaths) {
        sched::Walk().must_hold("death " + std::to_string(deaths), [&](sched::Run& run) {
            SmallStore store;
            for (const Step& step : script.before)
                store.apply(step);
            run.thread(
                "writer",
                [&] {
                    for (const Step& step : script.during)
                        store.apply(step);
                },
                deaths);
            run.join();
            died = run.died(0);
            store.judge_death(require);
            store.follow(0, expected, require);
        });
    }
    SCHED_REQUIRE(deaths > 20);
}

TFDB_SCHED(feed_flaws_are_found) {
    using sched::Word;
    const auto found = [](const std::string& name, const std::string& promise, const Script& script,
                          CommitNumber since, const MakeFlaw& flaw) {
        sched::Walk().must_fail(name, promise, program(script, since, flaw));
    };
    const std::string whole = "what the commit noted, whole";
    // An overwritten word may claim more than the ring holds.
    const std::string refused = "only what is below the floor is refused";
    found("a floor that is not raised", refused, kLap, 0, [](const SmallStore& store) {
        const Word* const floor = &store.frames.store_word(graph::kFeedFloor);
        return std::make_unique<sched::Forgets>(
            [floor](const Word& word, std::uint64_t) { return &word == floor; });
    });
    found("a floor that is raised after the ring was overwritten", refused, kLap, 0,
          [](const SmallStore& store) {
              const Word* const floor = &store.frames.store_word(graph::kFeedFloor);
              return std::make_unique<sched::Delays>(
                  0, [floor](const Word& word) { return &word == floor; }, store.commit());
          });
    found("notes that are filled in after the commit", whole, {{kTwo}, {kOther}}, 1,
          [](const SmallStore& store) {
              const Word* const first = &Feed<SmallMemory>(store.frames).word(2);
              return std::make_unique<sched::Delays>(
                  0, [first](const Word& word) { return &word == first; }, store.commit());
          });
}

}  // namespace txn::feed

}  // namespace tfdb
