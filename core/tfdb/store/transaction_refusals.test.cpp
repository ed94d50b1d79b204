// Refused operations of transactions, and the threads that may use them.
#include "tfdb/store/transaction_fixture.test.hpp"

namespace tfdb {
namespace {

using namespace fixture;

void robot(Buffer& buffer) {
    set(buffer, "map", "base", 1000, pose_of(1));
    set(buffer, "map", "base", 2000, pose_of(2));
    set_static(buffer, "base", "tip", pose_of(3));
}

}  // namespace

TFDB_TEST(transaction_refuses_a_batch_as_a_whole) {
    Buffer buffer(keeping(500));
    robot(buffer);
    Transaction tx(buffer);
    const Pose bad{{0, 0, 0}, {0, 0, 0, 2}};
    const TransformView batch[] = {
        {"map", "new", 2000, pose_of(4)},   {"map", "tip", 2000, pose_of(4)},
        {"map", "base", 1000, pose_of(4)},  {"map", "base", -1, pose_of(4)},
        {"map", "new", 2000, bad},          {"map", "", 2000, pose_of(4)},
        {"base", "base", 2000, pose_of(4)}, {"map", "base", 2100, pose_of(4)},
    };
    const auto refused = THROWN(StaticConflict, tx.set_transforms(batch, false, "me"));
    CHECK(refused && refused->detail().index == 1);
    const std::vector<ErrorCode> codes = {ErrorCode::kStaticConflict, ErrorCode::kTooOld,
                                          ErrorCode::kInvalidStamp,   ErrorCode::kInvalidTransform,
                                          ErrorCode::kInvalidName,    ErrorCode::kInvalidTransform};
    CHECK_EQ(refused->detail().refused.size(), codes.size());
    for (std::size_t i = 0; i < codes.size(); ++i) {
        CHECK_EQ(refused->detail().refused[i].index, i + 1);
        CHECK_EQ(refused->detail().refused[i].code, codes[i]);
    }
    CHECK(!tx.has_frame("new"));
    CHECK_EQ(latest(tx, "map", "base"), 2.0);
    // It continues, and validates against its own writes.
    put(tx, "map", "base", 3000, 5);
    const auto old = THROWN(TooOld, put(tx, "map", "base", 2499, 6));
    CHECK(old && old->detail().newest == 3000 && old->detail().oldest == 2500);
    put_static(tx, "map", "pole", 7);
    CHECK(THROWN(StaticConflict, put(tx, "map", "pole", 3000, 6)));
    tx.remove_frame("pole", false);
    put(tx, "map", "pole", 3000, 6);
    CHECK_EQ(tx.commit(), 4U);
    CHECK_EQ(latest(buffer, "map", "pole"), 6.0);
}

TFDB_TEST(transaction_finds_cycles_when_it_commits) {
    Buffer buffer(keeping(std::nullopt));
    robot(buffer);
    Transaction tx(buffer);
    tx.reparent("base", "tip", 2500, pose_of(4), "me");
    put(tx, "map", "extra", 2500, 5);
    const auto cycle = THROWN(CycleError, tx.commit());
    CHECK(cycle && says(*cycle, "'base'") && says(*cycle, "'me'"));
    CHECK(cycle && cycle->detail().stamp == 2500);
    CHECK(!tx.is_open());
    CHECK(!has_frame(buffer, "extra"));
    CHECK_EQ(buffer.commit(), 3U);
    CHECK_EQ(latest(buffer, "map", "base"), 2.0);
    // A temporary cycle is not refused.
    Transaction healed(buffer);
    put(healed, "other", "map", 2500, 5);
    put(healed, "tip", "other", 2500, 5);
    put(healed, "world", "other", 2500, 5);
    CHECK_EQ(healed.commit(), 4U);
    CHECK_EQ(latest(buffer, "world", "other"), 5.0);
    CHECK(THROWN(CycleError, [&] {
        Transaction again(buffer);
        again.reparent("map", "tip", 2000, std::nullopt, "");
        again.commit();
    }()));
}

TFDB_TEST(transaction_removals_name_what_is_in_the_way) {
    Buffer buffer(keeping(std::nullopt));
    robot(buffer);
    Transaction tx(buffer);
    CHECK(THROWN(UnknownFrame, tx.remove_frame("ghost", true)));
    put_static(tx, "base", "lamp", 1);
    const auto used = THROWN(FrameInUse, tx.remove_frame("base", false));
    CHECK(used && used->detail().frames == std::vector<std::string>({"tip", "lamp"}));
    tx.remove_frame("lamp", false);
    tx.remove_frame("base", true);
    CHECK(!tx.has_frame("tip"));
    CHECK(tx.has_frame("map"));
    tx.commit();
    CHECK(buffer.frames() == std::vector<std::string>({"map"}));
}

TFDB_TEST(transaction_is_over_after_its_end) {
    Buffer buffer;
    robot(buffer);
    Transaction tx(buffer);
    CHECK(tx.is_open());
    tx.commit();
    CHECK(!tx.is_open());
    const auto committed = THROWN(TransactionClosed, latest(tx, "map", "base"));
    CHECK(committed && says(*committed, "committed"));
    CHECK(THROWN(TransactionClosed, put(tx, "map", "base", 3000, 1)));
    CHECK(THROWN(TransactionClosed, tx.remove_frame("base", true)));
    CHECK(THROWN(TransactionClosed, tx.commit()));
    CHECK(THROWN(TransactionClosed, tx.has_frame("map")));
    tx.abort();
    Transaction aborted(buffer);
    aborted.abort();
    const auto ended = THROWN(TransactionClosed, aborted.commit());
    CHECK(ended && ended->detail().reason == "aborted");
    CHECK(race(
        buffer, [](Transaction& other) { (void)latest(other, "map", "base"); },
        [&] { set(buffer, "map", "base", 2500, pose_of(1)); }));
    CHECK_EQ(buffer.counters().aborts, 2U);
    CHECK_EQ(buffer.counters().conflicts, 1U);
}

TFDB_TEST(transaction_belongs_to_its_thread) {
    Buffer buffer;
    robot(buffer);
    auto tx = std::make_unique<Transaction>(buffer);
    elsewhere([&] {
        CHECK(THROWN(WrongThread, latest(*tx, "map", "base")));
        CHECK(THROWN(WrongThread, tx->commit()));
        Transaction other(buffer);
        put(other, "map", "base", 3000, 3);
        other.commit();
    });
    CHECK(tx->is_open());
    CHECK_EQ(latest(*tx, "map", "base"), 2.0);
    // Any thread may destroy it; its own thread can then begin another one.
    elsewhere([&] { tx.reset(); });
    Transaction next(buffer);
    CHECK_EQ(latest(next, "map", "base"), 3.0);
    // It may outlive the thread that began it.
    std::unique_ptr<Transaction> orphan;
    elsewhere([&] { orphan = std::make_unique<Transaction>(buffer); });
    CHECK(THROWN(WrongThread, orphan->commit()));
}

TFDB_TEST(transaction_keeps_its_thread_from_waiting_for_itself) {
    Buffer buffer;
    Buffer other;
    robot(buffer);
    robot(other);
    for (const bool alone : {false, true}) {
        TransactionOptions options;
        options.alone = alone;
        Transaction tx(buffer, options);
        const TransformView view{"map", "base", 3000, pose_of(1)};
        CHECK(THROWN(TransactionActive, set(buffer, "map", "base", 3000, pose_of(1))));
        CHECK(THROWN(TransactionActive, buffer.write({.transforms = {&view, 1}, .wait = false})));
        CHECK(THROWN(TransactionActive, buffer.remove_frame("base", true)));
        CHECK(THROWN(TransactionActive, buffer.clear()));
        CHECK(THROWN(TransactionActive, (void)buffer.compact()));
        CHECK(THROWN(TransactionActive, Transaction(buffer).commit()));
        // Reads do not check the thread's transactions; another store is valid.
        CHECK(THROWN(TransactionActive, buffer.check_not_in_transaction()));
        other.check_not_in_transaction();
        CHECK_EQ(latest(buffer, "map", "base"), 2.0);
        set(other, "map", "base", 3000, pose_of(4));
        Transaction second(other);
        CHECK_EQ(latest(second, "map", "base"), 4.0);
        tx.abort();
    }
    set(buffer, "map", "base", 3000, pose_of(1));
    CHECK_EQ(latest(buffer, "map", "base"), 1.0);
}

TFDB_TEST(transaction_options_are_checked) {
    Buffer buffer;
    TransactionOptions options;
    options.priority = 8;
    CHECK(THROWN(InvalidArgument, Transaction(buffer, options).commit()));
    options.priority = 7;
    Transaction tx(buffer, options);
    const std::uint64_t age = tx.age();
    CHECK(age > 0);
    tx.abort();
    options.age = age;
    CHECK_EQ(Transaction(buffer, options).age(), age);
    CHECK(Transaction(buffer).age() > age);
}

TFDB_TEST(transaction_that_does_not_fit_is_refused_whole) {
    BufferOptions options;
    options.max_frames = 4;
    Buffer buffer(options);
    robot(buffer);
    Transaction tx(buffer);
    put(tx, "map", "base", 3000, 3);
    put_static(tx, "map", "one", 3);
    put_static(tx, "map", "two", 3);
    CHECK(THROWN(CapacityExceeded, tx.commit()));
    CHECK(!tx.is_open());
    CHECK_EQ(buffer.commit(), 3U);
    CHECK_EQ(latest(buffer, "map", "base"), 2.0);
    CHECK(!has_frame(buffer, "one"));
    set_static(buffer, "map", "one", pose_of(4));
}

}  // namespace tfdb
