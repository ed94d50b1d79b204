// The cost of the cycle search, in visited items.
#include <limits>
#include <string_view>
#include <vector>

#include "tfdb/memory/region.hpp"
#include "tfdb/testing/check.hpp"
#include "tfdb/txn/commit.hpp"

namespace tfdb::txn {
namespace {

using Memory = memory::Region;

/// A forest written one relation at a time.
class Trees : private history::Readers {
public:
    /// Publishes the relation. False: it closes a cycle, and is rolled back.
    bool set(std::string_view parent, std::string_view child, clock::StampNs stamp) {
        Commit<Memory> commit(frames_, scratch_, history::kForever, *this);
        append(commit, parent, child, stamp);
        Cycle cycle;
        if (commit.cycles().find(cycle))
            return false;
        commit.publish();
        return true;
    }
    /// The cycles found by a search for all of the relation's cycles; rolled back.
    std::vector<Cycle> cycles(std::string_view parent, std::string_view child,
                              clock::StampNs stamp) {
        Commit<Memory> commit(frames_, scratch_, history::kForever, *this);
        append(commit, parent, child, stamp);
        std::vector<Cycle> found;
        (void)commit.cycles().find_all(found);
        return found;
    }
    /// The number of items that searches visit during `body()`.
    template <class Body>
    std::uint64_t steps_of(Body body) {
        const std::uint64_t before = scratch_.cycles.steps;
        body();
        return scratch_.cycles.steps - before;
    }

private:
    static constexpr std::uint32_t kFrames = 16;

    [[nodiscard]] CommitNumber oldest_read() override {
        return frames_.store_word(graph::kCommit).load_relaxed();
    }
    [[nodiscard]] std::uint64_t next_epoch() override { return epoch().load_relaxed() + 1; }
    [[nodiscard]] std::uint64_t begin_epoch() override { return epoch().fetch_add(1) + 1; }
    void held(std::uint64_t) override {}
    [[nodiscard]] sync::Word& epoch() { return frames_.store_word(graph::kEpoch); }

    static void append(Commit<Memory>& commit, std::string_view parent, std::string_view child,
                       clock::StampNs stamp) {
        history::NewSample<Memory> sample;
        sample.stamp = stamp;
        sample.parent = commit.frame(parent);
        const FrameId id = commit.frame(child);
        (void)commit.touch(id);
        commit.append(id, sample, 0);
    }

    Memory memory_;
    graph::Frames<Memory> frames_{memory_, memory_.allocate(graph::kStoreBytes),
                                  memory_.allocate_sparse(graph::Frames<Memory>::bytes(kFrames)),
                                  kFrames};
    CommitScratch scratch_;
};

/// `a` is a child of `p` and `q` alternately, `count` times; `x` is a child of `a`, and `z` of `y`.
void grow(Trees& trees, clock::StampNs count) {
    CHECK(trees.set("x", "below_x", history::kStaticStamp));
    CHECK(trees.set("a", "x", history::kStaticStamp));
    CHECK(trees.set("y", "z", history::kStaticStamp));
    for (clock::StampNs stamp = 1; stamp <= count; ++stamp)
        CHECK(trees.set(stamp % 2 == 0 ? "p" : "q", "a", stamp));
}

}  // namespace

TFDB_TEST(cycle_that_is_refused_costs_no_more_than_what_is_accepted) {
    for (const clock::StampNs count : {100, 1000, 10'000}) {
        Trees trees;
        grow(trees, count);
        const std::uint64_t accepted = trees.steps_of([&] { CHECK(trees.set("x", "y", 1)); });
        CHECK(accepted >= static_cast<std::uint64_t>(count));  // its walk visits all of them
        const std::uint64_t refused = trees.steps_of([&] { CHECK(!trees.set("x", "p", 1)); });
        CHECK(refused <= accepted);
        const std::uint64_t told_apart =
            trees.steps_of([&] { CHECK_EQ(trees.cycles("x", "p", 1).size(), 1U); });
        CHECK(told_apart <= accepted);
    }
}

TFDB_TEST(cycle_is_told_up_to_its_last_moment) {
    Trees trees;
    grow(trees, 10);
    // `a` is a child of `p` in [2, 3), [4, 5), ... [10, oo), of `q` up to [9, 10).
    const std::vector<Cycle> with_p = trees.cycles("x", "p", 1);
    CHECK_EQ(with_p.size(), 1U);
    CHECK(with_p[0].from == 1 && with_p[0].to == std::numeric_limits<clock::StampNs>::max());
    const std::vector<Cycle> with_q = trees.cycles("x", "q", 1);
    CHECK_EQ(with_q.size(), 1U);
    CHECK(with_q[0].from == 1 && with_q[0].to == 10);
}

}  // namespace tfdb::txn
