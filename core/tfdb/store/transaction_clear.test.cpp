// A clear inside a transaction: dropped and remaining data, and concurrent commits.
#include "tfdb/store/transaction_fixture.test.hpp"

namespace tfdb {
namespace {

using namespace fixture;

/// map <- base <- tip, all moving, and a static camera on the base.
Buffer robot() {
    Buffer buffer(keeping(std::nullopt));
    set(buffer, "map", "base", 10, pose_of(1));
    set(buffer, "map", "base", 20, pose_of(2));
    set(buffer, "base", "tip", 20, pose_of(3));
    set_static(buffer, "base", "camera", pose_of(4));
    return buffer;
}

bool is_refused(Transaction& tx, std::string_view child, bool is_static) {
    const TransformView transform{"map", child, 5, pose_of(9)};
    try {
        tx.set_transforms({&transform, 1}, is_static, "tx");
        return false;
    } catch (const StaticConflict&) {
        return true;
    }
}

}  // namespace

TFDB_TEST(transaction_clear_drops_the_moving_samples_and_stores_in_one_commit) {
    Buffer buffer = robot();
    const Snapshot before = buffer.snapshot();
    Transaction tx(buffer);
    put(tx, "map", "base", 30, 5);
    put(tx, "map", "late", 30, 6);
    tx.clear();
    CHECK_THROWS_AS(tx.lookup_transform("map", "base", 20), Disconnected);
    CHECK_EQ(tx.samples("base").stamps.size(), 0U);
    CHECK(tx.frame_info("base").cleared);
    CHECK(tx.has_frame("late"));  // frames stay, also new ones
    CHECK_EQ(latest(tx, "base", "camera"), 4.0);
    put(tx, "map", "base", 5, 7);
    CHECK_EQ(latest(tx, "map", "base"), 7.0);
    CHECK(!tx.frame_info("base").cleared);
    CHECK(!tx.parent_of("tip").has_value());
    CHECK_EQ(tx.commit(), before.commit() + 1);

    CHECK(buffer.samples("base").stamps == std::vector<StampNs>{5});
    CHECK(buffer.samples("tip").stamps.empty() && buffer.frame_info("tip").cleared);
    CHECK(buffer.samples("late").stamps.empty() && has_frame(buffer, "late"));
    CHECK_EQ(buffer.frame_info("base").authority, "tx");
    CHECK_EQ(latest(buffer, "map", "base"), 7.0);
    CHECK_EQ(latest(before, "base", "tip"), 3.0);  // held states stay

    const Changes made = buffer.changes(before.commit()).front();
    CHECK(made.cleared == std::vector<std::string>({"base", "tip"}));
    CHECK_EQ(made.stored.size(), 1U);
    CHECK(made.stored.front().child == "base" &&
          made.stored.front().stamps == std::vector<StampNs>{5});
    CHECK(made.moved == std::vector<std::string>{"tip"});
    CHECK(made.made == std::vector<std::string>{"late"});
}

TFDB_TEST(transaction_clear_alone_is_the_commit_of_a_clear) {
    Buffer one = robot();
    Buffer other = robot();
    (void)one.clear();
    Transaction tx(other);
    tx.clear();
    tx.clear();
    CHECK_EQ(tx.commit(), one.commit());
    for (const std::string& name : one.frames()) {
        const FrameInfo a = one.frame_info(name);
        const FrameInfo b = other.frame_info(name);
        CHECK(a.parent == b.parent && a.samples == b.samples && a.cleared == b.cleared);
    }
    Transaction idle(other);  // nothing moves any more
    idle.clear();
    CHECK_EQ(idle.commit(), one.commit() + 1);
}

TFDB_TEST(transaction_clear_frees_the_kind_of_moving_edges_alone) {
    Buffer buffer = robot();
    Transaction tx(buffer);
    CHECK(is_refused(tx, "base", true));
    put_static(tx, "map", "door", 8);
    tx.clear();
    CHECK(is_refused(tx, "camera", false));
    CHECK(is_refused(tx, "door", false));  // its static pose was not dropped
    CHECK(!is_refused(tx, "base", true));
    CHECK(is_refused(tx, "base", false));
    put(tx, "map", "tip", 5, 7);
    CHECK(is_refused(tx, "tip", true));
    tx.clear();
    CHECK(!is_refused(tx, "tip", true));
    CHECK(is_refused(tx, "base", false));
    (void)tx.commit();
    CHECK(buffer.frame_info("base").is_static && buffer.frame_info("tip").is_static);
    CHECK_EQ(latest(buffer, "map", "door"), 8.0);
    CHECK_EQ(number_of(buffer.lookup_transform("map", "tip", 999).pose), 9.0);
}

TFDB_TEST(transaction_clear_frees_parents) {
    Buffer buffer = robot();
    Transaction tx(buffer);
    CHECK_THROWS_AS(tx.remove_frame("map", false), FrameInUse);
    put(tx, "map", "new", 30, 1);
    tx.clear();
    tx.remove_frame("map", false);
    CHECK_THROWS_AS(tx.remove_frame("base", false), FrameInUse);  // the camera is static
    put(tx, "tip", "base", 30, 2);                                // no cycle with what was dropped
    CHECK_EQ(latest(tx, "tip", "base"), 2.0);
    (void)tx.commit();
    CHECK(!has_frame(buffer, "map"));
    CHECK_EQ(buffer.frame_info("base").parent.value_or(""), "tip");
    CHECK(!buffer.frame_info("tip").parent.has_value());
    // Counts of children are right again.
    buffer.remove_frame("new", false);
    CHECK_THROWS_AS(buffer.remove_frame("tip", false), FrameInUse);
    buffer.remove_frame("camera", false);
    buffer.remove_frame("base", false);
    buffer.remove_frame("tip", false);
    CHECK(buffer.frames().empty());
}

TFDB_TEST(transaction_clear_takes_older_stamps_again) {
    Buffer buffer(keeping(10));
    set(buffer, "map", "base", 1000, pose_of(1));
    Transaction tx(buffer);
    CHECK_THROWS_AS(put(tx, "map", "base", 5, 2), TooOld);
    tx.clear();
    put(tx, "map", "base", 5, 2);
    CHECK_EQ(latest(tx, "map", "base"), 2.0);
    (void)tx.commit();
    CHECK(buffer.samples("base").stamps == std::vector<StampNs>{5});
    CHECK_EQ(buffer.frame_info("base").late, 0U);
}

TFDB_TEST(transaction_clear_that_is_aborted_leaves_all_as_it_was) {
    Buffer buffer = robot();
    {
        Transaction tx(buffer);
        tx.clear();
        put(tx, "map", "base", 5, 7);
    }
    CHECK_EQ(latest(buffer, "base", "tip"), 3.0);
    Transaction cycle(buffer);
    cycle.clear();
    put(cycle, "tip", "base", 5, 7);
    put(cycle, "base", "tip", 5, 7);
    CHECK_THROWS_AS(cycle.commit(), CycleError);
    CHECK_EQ(latest(buffer, "base", "tip"), 3.0);
    CHECK(buffer.samples("base").stamps == (std::vector<StampNs>{10, 20}));
    Transaction after(buffer);  // the kept lists know nothing of that clear
    CHECK_EQ(latest(after, "base", "tip"), 3.0);
}

TFDB_TEST(transaction_clear_and_what_others_do_meanwhile) {
    const auto clears = [](Transaction& tx) { tx.clear(); };
    const auto reads_after_it = [](Transaction& tx) {
        tx.clear();
        CHECK(tx.samples("base").stamps.empty());
    };
    const auto reads_before_it = [](Transaction& tx) {
        (void)latest(tx, "map", "base");
        tx.clear();
    };
    Buffer buffer = robot();
    const auto store = [&] { set(buffer, "map", "base", 30, pose_of(9)); };
    CHECK(!race(buffer, clears, store));  // it was stored before, and dropped
    CHECK(buffer.samples("base").stamps.empty());
    CHECK(!race(buffer, reads_after_it, store));
    CHECK(buffer.samples("base").stamps.empty());
    store();
    CHECK(race(buffer, reads_before_it, [&] { set(buffer, "map", "base", 40, pose_of(9)); }));
    CHECK(buffer.samples("base").stamps == (std::vector<StampNs>{30, 40}));
    // The edge that it found empty is static now, and a clear does not drop static poses.
    (void)buffer.clear();
    CHECK(race(buffer, reads_after_it, [&] { set_static(buffer, "map", "base", pose_of(9)); }));

    // In the other order: the transaction's read of a moving edge conflicts.
    Buffer other = robot();
    const auto clear_and_store = [&] {
        Transaction tx(other);
        tx.clear();
        put(tx, "map", "base", 20, 2);
        (void)tx.commit();
    };
    const auto lost = race(
        other, [](Transaction& tx) { (void)latest(tx, "map", "base"); }, clear_and_store);
    CHECK(lost && lost->detail().edge == "base" && lost->detail().reason == "cleared");
    CHECK(!race(
        other, [](Transaction& tx) { (void)latest(tx, "base", "camera"); }, clear_and_store));
}

TFDB_TEST(transaction_clear_in_every_engine) {
    for (std::size_t engine = 0; engine < kConcurrencies; ++engine) {
        for (const bool alone : {false, true}) {
            BufferOptions options = keeping(std::nullopt);
            options.concurrency = static_cast<Concurrency>(engine);
            Buffer buffer(options);
            set(buffer, "map", "base", 20, pose_of(1));
            set(buffer, "map", "tip", 20, pose_of(2));
            TransactionOptions how;
            how.alone = alone;
            Transaction tx(buffer, how);
            tx.clear();
            CHECK(tx.samples("tip").stamps.empty());
            put(tx, "map", "base", 5, 7);
            put_static(tx, "map", "tip", 8);
            CHECK_EQ(latest(tx, "map", "base"), 7.0);
            (void)tx.commit();
            CHECK(buffer.samples("base").stamps == std::vector<StampNs>{5});
            CHECK(buffer.frame_info("tip").is_static);
        }
    }
}

}  // namespace tfdb
