// Transactions of the default engine: what they see, what they leave, when they lose.
#include "tfdb/store/transaction.hpp"

#include "tfdb/store/fixture.hpp"

namespace tfdb {
namespace {

using namespace fixture;

BufferOptions forever() {
    return keeping(std::nullopt);
}

void put(Transaction& tx, std::string_view parent, std::string_view child, StampNs stamp,
         double number) {
    const TransformView transform{parent, child, stamp, pose_of(number)};
    tx.set_transforms({&transform, 1}, false, "tx");
}
void put_static(Transaction& tx, std::string_view parent, std::string_view child, double number) {
    const TransformView transform{parent, child, 0, pose_of(number)};
    tx.set_transforms({&transform, 1}, true, "tx");
}
double latest(Transaction& tx, std::string_view target, std::string_view source) {
    return number_of(tx.lookup_latest_transform(target, source).pose);
}

/// Begins a transaction that reads, lets somebody else write, and commits it together with a write
/// of its own. None: it was let through.
template <class Read, class Write>
std::optional<Conflict> race(Buffer& buffer, Read read, Write write) {
    Transaction tx(buffer);
    read(tx);
    const CommitNumber before = buffer.commit();
    write();
    CHECK(buffer.commit() > before);
    put_static(tx, "witness", "mark", 1);
    try {
        tx.commit();
    } catch (const Conflict& conflict) {
        CHECK(!tx.is_open());
        FrameHandle unused;
        CHECK(!buffer.find_frame("mark", unused));
        return conflict;
    }
    return std::nullopt;
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
    CHECK_EQ(tx.frame_name(both.edges.front().child, both.edges.front().generation), "tip");
    // Nobody else sees any of it.
    FrameHandle unused;
    CHECK(!buffer.find_frame("tip", unused));
    CHECK_EQ(number_of(buffer.lookup_latest_transform("map", "base").pose), 1.0);
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
    set(buffer, "map", "base", 20, pose_of(2));
    set(buffer, "map", "other", 20, pose_of(3));
    CHECK_EQ(latest(tx, "map", "base"), 1.0);
    CHECK(!tx.has_frame("other"));
    // It wrote nothing: it is as old as what it read, and that is fine.
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

TFDB_TEST(transaction_conflicts_with_what_changes_an_answer) {
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
    const auto fixed = race(
        buffer, [](Transaction& tx) { (void)tx.lookup_transform("base", "tip", 25); },
        [&] { set_static(buffer, "base", "tip", pose_of(8)); });
    CHECK(fixed && fixed->detail().edge == "tip");
    CHECK_EQ(buffer.counters().conflicts, 4U);
    CHECK_EQ(buffer.counters().aborts, 4U);
}

TFDB_TEST(transaction_within_the_history_does_not_mind_appends) {
    Buffer buffer(forever());
    for (const StampNs stamp : {10, 20, 30})
        set(buffer, "map", "base", stamp, pose_of(static_cast<double>(stamp)));
    set(buffer, "base", "tip", 30, pose_of(7));
    const auto bracketed = [](Transaction& tx) { (void)tx.lookup_transform("base", "map", 15); };
    CHECK(!race(buffer, bracketed, [&] { set(buffer, "map", "base", 40, pose_of(40)); }));
    buffer.remove_frame("mark", false);
    CHECK(!race(buffer, bracketed, [&] { set(buffer, "map", "base", 25, pose_of(25)); }));
    buffer.remove_frame("mark", false);
    CHECK(!race(buffer, bracketed, [&] { set(buffer, "map", "other", 25, pose_of(25)); }));
    // Storing without having read does not mind either.
    Transaction tx(buffer);
    put(tx, "map", "base", 60, 6);
    set(buffer, "map", "base", 50, pose_of(5));
    tx.commit();
    CHECK_EQ(number_of(buffer.lookup_latest_transform("map", "base").pose), 6.0);
}

}  // namespace tfdb
