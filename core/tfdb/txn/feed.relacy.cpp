// The feed in the C++ memory model: one writer, and a follower that is overtaken during its read.
#include "tfdb/txn/feed.sched.hpp"

// After all others: it redefines `assert` and more.
#include "tfdb/testing/relacy/simulate.hpp"

namespace tfdb {

using FeedMemory = relacy::Memory<1, 2048>;

template <>
struct txn::FeedTuning<FeedMemory> {
    static constexpr unsigned kCommitsLog2 = 2;
    static constexpr unsigned kWordsLog2 = 2;
};

namespace txn::feed {

namespace {

constexpr unsigned kIdleSteps = 60;
/// Two notes each in a ring of four, one undone commit, names in between.
const Script kScript{{{{1, 2}}, {{3}}},
                     {{{4, 5}}, {{6, 7}, true}, {{0, 1}, false, true}, {{2, 3}}, {{}}, {{4}}}};

struct Following : rl::test_suite<Following, 2> {
    Store<FeedMemory> store;
    std::vector<std::vector<std::uint64_t>> expected = expected_of(kScript);

    void before() {
        for (const Step& step : kScript.before)
            store.apply(step);
    }
    void thread(unsigned index) {
        if (index == 0) {
            for (const Step& step : kScript.during)
                store.apply(step);
            return;
        }
        for (unsigned steps = rl::rand(kIdleSteps); steps > 0; --steps)
            (void)store.memory.word(0).load_relaxed();
        for (int round = 0; round < 2; ++round) {
            const CommitNumber newest = store.commit().load_relaxed();
            follow(newest - std::min<CommitNumber>(newest, rl::rand(3)));
        }
    }
    void after() { follow(store.commit().load_relaxed() - 1); }
    void follow(CommitNumber since) {
        store.follow(since, expected, [](bool holds, const char*) { RL_ASSERT(holds); });
    }
};

/// The root's block comes first.
constexpr Offset root_word(graph::StoreWord word) {
    return 64 + 8 * Offset{word};
}

}  // namespace

TFDB_TEST(feed_holds_in_the_memory_model) {
    relacy::holds<Following>("a follower beside a writer");
}

TFDB_TEST(feed_needs_its_orders) {
    relacy::needs<Following>("release of commit", {.store = root_word(graph::kCommit)});
    relacy::needs<Following>("acquire of commit", {.load = root_word(graph::kCommit)});
    relacy::needs<Following>("the writer's fence", {.no_release_fence = true});
    relacy::needs<Following>("the follower's fence", {.no_acquire_fence = true});
}

}  // namespace txn::feed

}  // namespace tfdb
