// Transactions of the default engine: their reads, their effects, and their conflicts.
#include "tfdb/store/transaction_fixture.test.hpp"

namespace tfdb {
namespace {

using namespace fixture;

BufferOptions forever() {
    return keeping(std::nullopt);
}

}  // namespace

TFDB_TEST(transaction_reads_its_own_writes_and_commits_them_at_once) {
    Buffer buffer(forever());
    set(buffer, "map", "base", 10, pose_of(1));
    Transaction tx(buffer);
    CHECK_EQ(latest(tx, "map", "base"), 1.0);
    put(tx, "map", "base", 20, 2);
    put(tx, "base", "tip", 20, 3);
    CHECK_EQ(latest(tx, "map", "base"), 2.0);
    CHECK(tx.has_frame("tip"));
    const Answer both = tx.lookup_transform("tip", "map", 20);
    CHECK_EQ(both.edges.size(), 2U);
    const EdgeUse& own = both.edges.front();
    CHECK_EQ(tx.frame_name(own.child, own.generation), "tip");
    CHECK_EQ(tx.frame_name(own.parent, own.parent_generation), "base");
    // No other reader sees any of it.
    CHECK(!has_frame(buffer, "tip"));
    CHECK_EQ(latest(buffer, "map", "base"), 1.0);
    const CommitNumber before = buffer.commit();
    CHECK_EQ(tx.commit(), before + 1);
    CHECK_EQ(buffer.commit(), before + 1);
    CHECK(identical(buffer.lookup_transform("tip", "map", 20).pose, both.pose));
    CHECK_EQ(buffer.frame_info("tip").authority, "tx");
}

TFDB_TEST(transaction_sees_one_state) {
    Buffer buffer(forever());
    set(buffer, "map", "base", 10, pose_of(1));
    Transaction tx(buffer);
    elsewhere([&] {
        set(buffer, "map", "base", 20, pose_of(2));
        set(buffer, "map", "other", 20, pose_of(3));
    });
    CHECK_EQ(latest(tx, "map", "base"), 1.0);
    CHECK(!tx.has_frame("other"));
    // It wrote nothing, so it is ordered at its snapshot and commits.
    CHECK_EQ(tx.commit(), 1U);
}

TFDB_TEST(transaction_that_aborts_leaves_nothing) {
    Buffer buffer(forever());
    set(buffer, "map", "base", 10, pose_of(1));
    const MemoryUse before = buffer.memory();
    {
        Transaction tx(buffer);
        put(tx, "map", "base", 20, 2);
        for (int i = 0; i < 100; ++i)
            put_static(tx, "base", "part" + std::to_string(i), 3);
        tx.remove_frame("base", true);
        put(tx, "map", "base", 5, 2);
    }
    const MemoryUse after = buffer.memory();
    CHECK_EQ(before.used_bytes, after.used_bytes);
    CHECK_EQ(before.frames, after.frames);
    CHECK_EQ(buffer.frames().size(), 2U);
    CHECK_EQ(buffer.commit(), 1U);
    CHECK_EQ(buffer.counters().aborts, 1U);
    CHECK_EQ(buffer.counters().conflicts, 0U);
}

TFDB_TEST(transaction_conflicts_with_samples_that_change_an_answer) {
    Buffer buffer(forever());
    for (const StampNs stamp : {10, 20, 30})
        set(buffer, "map", "base", stamp, pose_of(static_cast<double>(stamp)));
    set_static(buffer, "base", "tip", pose_of(7));
    const auto newest = race(
        buffer, [](Transaction& tx) { (void)latest(tx, "map", "base"); },
        [&] { set(buffer, "map", "base", 40, pose_of(40)); });
    CHECK(newest && newest->detail().reason == "a newer sample at 0.000000040 s");
    CHECK(newest && newest->detail().edge == "base");
    const auto late = race(
        buffer, [](Transaction& tx) { (void)tx.lookup_transform("tip", "map", 15); },
        [&] { set(buffer, "map", "base", 16, pose_of(16)); });
    CHECK(late && says(*late, "a late sample at 0.000000016 s"));
    const auto again = race(
        buffer, [](Transaction& tx) { (void)tx.lookup_transform("tip", "map", 25); },
        [&] { set(buffer, "map", "base", 30, pose_of(31)); });
    CHECK(again && again->detail().stamp == 30);
    const auto future = race(
        buffer,
        [](Transaction& tx) {
            CHECK(THROWN(Extrapolation, tx.lookup_transform("tip", "map", 45)));
        },
        [&] { set(buffer, "map", "base", 50, pose_of(50)); });
    CHECK(future && future->detail().stamp == 50);
    const auto fixed = race(
        buffer, [](Transaction& tx) { (void)tx.lookup_transform("base", "tip", 25); },
        [&] { set_static(buffer, "base", "tip", pose_of(8)); });
    CHECK(fixed && fixed->detail().edge == "tip");
    const auto cleared = race(
        buffer, [](Transaction& tx) { (void)tx.lookup_transform("map", "base", 15); },
        [&] { buffer.clear(); });
    CHECK(cleared && cleared->detail().reason == "cleared");
    CHECK_EQ(buffer.counters().conflicts, 6U);
    CHECK_EQ(buffer.counters().aborts, 6U);
}

TFDB_TEST(transaction_conflicts_with_frames_that_change_an_answer) {
    Buffer buffer(forever());
    for (const char* child : {"a", "b", "c"})
        set(buffer, "map", child, 10, pose_of(1));
    const auto made = race(
        buffer,
        [](Transaction& tx) { CHECK(THROWN(UnknownFrame, tx.lookup_transform("map", "d", 10))); },
        [&] { set(buffer, "map", "d", 10, pose_of(2)); });
    CHECK(made && made->detail().reason == "a new frame of that name");
    CHECK(made && made->detail().frame == "d");
    const auto moved = race(
        buffer, [](Transaction& tx) { (void)latest(tx, "map", "d"); },
        [&] { set(buffer, "a", "d", 20, pose_of(2)); });
    CHECK(moved && says(*moved, "re-parented at 0.000000020 s"));
    const auto root = race(
        buffer,
        [](Transaction& tx) { CHECK(THROWN(UnknownFrame, tx.lookup_transform("x", "map", 10))); },
        [&] { set(buffer, "world", "map", 10, pose_of(2)); });
    CHECK(!root);  // x is still missing
    const auto apart = race(
        buffer, [](Transaction& tx) { CHECK(!tx.has_frame("x")); },
        [&] { set_static(buffer, "y", "x", pose_of(2)); });
    CHECK(apart && apart->detail().frame == "x");
    const auto joined = race(
        buffer,
        [](Transaction& tx) { CHECK(THROWN(Disconnected, tx.lookup_transform("x", "map", 10))); },
        [&] { set_static(buffer, "map", "y", pose_of(2)); });
    CHECK(joined && joined->detail().edge == "y");
    const auto gone = race(
        buffer, [](Transaction& tx) { (void)latest(tx, "map", "c"); },
        [&] { buffer.remove_frame("c", false); });
    CHECK(gone && gone->detail().reason == "removed" && gone->detail().frame == "c");
    const auto renewed = race(
        buffer, [](Transaction& tx) { (void)latest(tx, "map", "b"); },
        [&] {
            buffer.remove_frame("b", false);
            set(buffer, "map", "b", 10, pose_of(1));
        });
    CHECK(renewed && renewed->detail().reason == "removed");
    const auto child = race(
        buffer, [](Transaction& tx) { tx.remove_frame("b", false); },
        [&] { set(buffer, "b", "e", 10, pose_of(1)); });
    CHECK(child && child->detail().reason == "other children" && child->detail().frame == "b");
    const auto subtree = race(
        buffer, [](Transaction& tx) { tx.remove_frame("b", true); },
        [&] { set(buffer, "e", "f", 10, pose_of(1)); });
    CHECK(subtree && subtree->detail().frame == "e");
}

TFDB_TEST(transaction_conflicts_when_what_it_used_is_forgotten) {
    Buffer buffer(keeping(100));
    for (const StampNs stamp : {10, 20, 30})
        set(buffer, "map", "base", stamp, pose_of(static_cast<double>(stamp)));
    const auto inside = [](Transaction& tx) { (void)tx.lookup_transform("map", "base", 15); };
    CHECK(!race(buffer, inside, [&] { set(buffer, "map", "base", 110, pose_of(4)); }));
    const auto gone = race(buffer, inside, [&] { set(buffer, "map", "base", 111, pose_of(4)); });
    CHECK(gone && says(*gone, "the retained history now begins at 0.000000011 s"));
    // Its own samples are in the same state.
    const auto stored = race(
        buffer, [](Transaction& tx) { put(tx, "map", "base", 25, 5); },
        [&] { set(buffer, "map", "base", 126, pose_of(4)); });
    CHECK(stored.has_value());
}

TFDB_TEST(transaction_within_the_history_does_not_mind_appends) {
    Buffer buffer(forever());
    for (const StampNs stamp : {10, 20, 30})
        set(buffer, "map", "base", stamp, pose_of(static_cast<double>(stamp)));
    set(buffer, "base", "tip", 30, pose_of(7));
    const auto bracketed = [](Transaction& tx) {
        (void)tx.lookup_transform("base", "map", 15);
        (void)tx.lookup_transform("map", "base", 20);
    };
    CHECK(!race(buffer, bracketed, [&] { set(buffer, "map", "base", 40, pose_of(40)); }));
    CHECK(!race(buffer, bracketed, [&] { set(buffer, "map", "base", 35, pose_of(25)); }));
    CHECK(!race(buffer, bracketed, [&] { set(buffer, "map", "other", 25, pose_of(25)); }));
    CHECK(race(buffer, bracketed, [&] { set(buffer, "map", "base", 25, pose_of(25)); }));
    // A write without reads does not conflict either.
    Transaction tx(buffer);
    put(tx, "map", "base", 60, 6);
    elsewhere([&] { set(buffer, "map", "base", 50, pose_of(5)); });
    tx.commit();
    CHECK_EQ(latest(buffer, "map", "base"), 6.0);
}

TFDB_TEST(transaction_own_sample_replaces_others_of_its_stamp) {
    Buffer buffer(forever());
    set(buffer, "map", "base", 10, pose_of(1));
    Transaction tx(buffer);
    put(tx, "map", "base", 20, 2);
    put(tx, "map", "base", 20, 3);
    CHECK_EQ(number_of(tx.lookup_transform("map", "base", 20).pose), 3.0);
    elsewhere([&] { set(buffer, "map", "base", 20, pose_of(4)); });
    CHECK_EQ(latest(tx, "map", "base"), 3.0);
    tx.commit();
    CHECK_EQ(number_of(buffer.lookup_transform("map", "base", 20).pose), 3.0);
}

TFDB_TEST(transaction_removes_makes_and_moves_in_any_order) {
    Buffer buffer(forever());
    set(buffer, "map", "old", 10, pose_of(1));
    set(buffer, "old", "tool", 10, pose_of(2));
    set_static(buffer, "tool", "tip", pose_of(3));
    Transaction tx(buffer);
    // The child leaves the old parent, which can then be removed. Another frame takes its name.
    tx.reparent("tool", "map", 10, std::nullopt, "tx");
    tx.remove_frame("old", false);
    CHECK(!tx.has_frame("old"));
    CHECK(THROWN(UnknownFrame, tx.lookup_transform("old", "tip", 10)));
    put_static(tx, "map", "old", 9);
    // Made and removed again, although a sample names it.
    put(tx, "map", "brief", 10, 4);
    put(tx, "brief", "other", 10, 5);
    put(tx, "map", "other", 20, 6);
    tx.remove_frame("brief", false);
    put_static(tx, "map", "brief", 7);
    const Answer seen = tx.lookup_transform("map", "tip", 10);
    tx.commit();
    CHECK(identical(seen.pose, buffer.lookup_transform("map", "tip", 10).pose));
    CHECK(apart(seen.pose, compose(pose_of(1), compose(pose_of(2), pose_of(3)))) < 1e-12);
    CHECK_EQ(latest(buffer, "map", "old"), 9.0);
    CHECK_EQ(latest(buffer, "map", "brief"), 7.0);
    CHECK_EQ(latest(buffer, "map", "other"), 6.0);
    CHECK(THROWN(Disconnected, buffer.lookup_transform("map", "other", 15)));
    CHECK_EQ(buffer.frames().size(), 6U);
}

TFDB_TEST(transaction_reparents_without_moving) {
    Buffer buffer(forever());
    set(buffer, "map", "base", 10, pose_of(1));
    set(buffer, "base", "arm", 10, pose_of(2));
    set_static(buffer, "arm", "cup", pose_of(3));
    const Pose before = buffer.lookup_transform("map", "cup", 10).pose;
    Transaction tx(buffer);
    tx.reparent("arm", "map", 10, std::nullopt, "mover");
    CHECK(apart(tx.lookup_transform("map", "cup", 10).pose, before) < 1e-12);
    tx.reparent("cup", "base", std::nullopt, std::nullopt, "mover");
    CHECK(apart(tx.lookup_transform("map", "cup", 10).pose, before) < 1e-12);
    tx.reparent("base", "cellar", 20, pose_of(5), "mover");
    tx.commit();
    CHECK(apart(buffer.lookup_transform("map", "cup", 10).pose, before) < 1e-12);
    CHECK(buffer.frame_info("arm").parent == "map");
    CHECK_EQ(buffer.frame_info("arm").authority, "mover");
    CHECK_EQ(latest(buffer, "cellar", "base"), 5.0);
}

TFDB_TEST(transaction_that_reads_what_was_overwritten_has_lost) {
    BufferOptions options = keeping(50);
    options.snapshot_memory = 0;
    Buffer buffer(options);
    for (StampNs stamp = 0; stamp < 100; ++stamp)
        set(buffer, "map", "base", stamp, pose_of(static_cast<double>(stamp)));
    Transaction tx(buffer);
    CHECK_EQ(number_of(tx.lookup_transform("map", "base", 60).pose), 60.0);
    elsewhere([&] {
        for (StampNs stamp = 100; stamp < 5000; ++stamp)
            set(buffer, "map", "base", stamp, pose_of(1));
    });
    const auto lost = THROWN(Conflict, tx.lookup_transform("map", "base", 60));
    CHECK(lost && says(*lost, "overwritten"));
    CHECK(THROWN(TransactionClosed, tx.has_frame("map")));
    CHECK_EQ(buffer.counters().conflicts, 1U);
}

TFDB_TEST(transaction_looks_up_many_at_once) {
    Buffer buffer(forever());
    for (const StampNs stamp : {10, 20})
        set(buffer, "map", "base", stamp, pose_of(static_cast<double>(stamp)));
    Transaction tx(buffer);
    put(tx, "map", "base", 30, 30);
    const StampNs stamps[] = {30, 15, 99, 10};
    double rows[4 * 16];
    tx.lookup_many("base", "map", stamps, {}, Layout::kMatrix, Missing::kNan, rows);
    CHECK(std::isnan(rows[2 * 16]));
    const auto refused =
        THROWN(Extrapolation,
               tx.lookup_many("base", "map", stamps, {}, Layout::kPose, Missing::kThrow, rows));
    CHECK(refused && refused->detail().index == 2);
    CHECK(THROWN(UnknownFrame,
                 tx.lookup_many("base", "x", {}, {}, Layout::kPose, Missing::kNan, rows)));
    put(tx, "sky", "moon", 30, 5);
    const auto apart = THROWN(Disconnected, tx.lookup_many("base", "moon", stamps, {},
                                                           Layout::kPose, Missing::kThrow, rows));
    CHECK(apart && apart->detail().index == 0 && apart->detail().stamp == 30);
    tx.lookup_many("base", "moon", stamps, {}, Layout::kPose, Missing::kNan, rows);
    CHECK(std::all_of(rows, rows + 4 * 7, [](double x) { return std::isnan(x); }));
    CHECK(THROWN(InvalidArgument, tx.lookup_many("base", "map", stamps, {}, Layout::kPose,
                                                 Missing::kNan, std::span(rows).first(20))));
    tx.lookup_many("base", "map", stamps, {}, Layout::kMatrix, Missing::kNan, rows);
    tx.commit();
    double stored[4 * 16];
    buffer.lookup_many("base", "map", stamps, {}, Layout::kMatrix, Missing::kNan, stored);
    for (int i = 0; i < 64; ++i)
        CHECK(std::isnan(rows[i]) ? std::isnan(stored[i]) : std::fabs(rows[i] - stored[i]) < 1e-9);
}

TFDB_TEST(transaction_makes_and_removes_many_frames) {
    Buffer buffer(forever());
    set(buffer, "map", "base", 10, pose_of(1));
    std::size_t used = 0;
    for (int round = 0; round < 4; ++round) {
        Transaction tx(buffer);
        for (int i = 0; i < 2000; ++i)
            put_static(tx, i % 2 == 0 ? "base" : "part" + std::to_string(i - 1),
                       "part" + std::to_string(i), i);
        CHECK_EQ(latest(tx, "part1998", "part1999"), 1999.0);
        tx.commit();
        CHECK_EQ(buffer.frames().size(), 2002U);
        Transaction gone(buffer);
        CHECK(THROWN(FrameInUse, gone.remove_frame("part0", false)));
        for (int i = 0; i < 2000; i += 2)
            gone.remove_frame("part" + std::to_string(i), true);
        gone.commit();
        CHECK_EQ(buffer.frames().size(), 2U);
        if (round == 1)
            used = buffer.memory().used_bytes;
    }
    CHECK_EQ(buffer.memory().used_bytes, used);
}

/// A phantom: a late sample with another parent, between samples that all name one parent.
TFDB_TEST(transaction_depends_on_all_samples_of_common_times) {
    if (skipped_in({Concurrency::kFine}, "nothing is validated"))
        return;
    Buffer buffer(forever());
    set_static(buffer, "map", "other", pose_of(1));
    for (const StampNs stamp : {10, 20, 30, 40})
        set(buffer, "map", "base", stamp, pose_of(2));
    const auto lost = race(
        buffer, [](Transaction& tx) { CHECK_EQ(tx.common_times("map", "base").oldest, 10); },
        [&] { set(buffer, "other", "base", 25, pose_of(3)); });
    CHECK(lost.has_value());
    CHECK_EQ(buffer.common_times("map", "base").oldest, 30);
    // For T[a<-a] all samples of the frame count, with any parent.
    CHECK_EQ(buffer.common_times("base", "base").oldest, 10);
    const auto earlier = race(
        buffer, [](Transaction& tx) { CHECK_EQ(tx.common_times("base", "base").oldest, 10); },
        [&] { set(buffer, "map", "base", 5, pose_of(4)); });
    CHECK(earlier.has_value());
    CHECK_EQ(buffer.common_times("base", "base").oldest, 5);
}

}  // namespace tfdb
