// Options of writes: change an edge's kind, keep existing samples.
#include <span>
#include <thread>
#include <vector>

#include "tfdb/store/fixture.hpp"
#include "tfdb/store/transaction.hpp"

namespace tfdb {
namespace {

using namespace fixture;

constexpr WriteRules kChangeKind{true, false};
constexpr WriteRules kOnlyNew{false, true};

/// map <- base moves from 1 s to 4 s. base <- lidar is static, and lidar has the child scan.
Buffer robot() {
    Buffer buffer(keeping(std::nullopt));
    for (StampNs second = 1; second <= 4; ++second)
        set(buffer, "map", "base", second * kSecond, pose_of(static_cast<double>(second)));
    set_static(buffer, "base", "lidar", pose_of(20));
    set_static(buffer, "lidar", "scan", pose_of(30));
    return buffer;
}

Pose at(const StoreReader& reads, const char* target, const char* source, StampNs stamp) {
    return reads.lookup_transform(target, source, stamp).pose;
}

}  // namespace

TFDB_TEST(a_static_edge_with_children_becomes_moving_in_one_commit) {
    Buffer buffer = robot();
    const Snapshot before = buffer.snapshot();
    const CommitNumber commit = buffer.commit();
    CHECK_THROWS_AS(set(buffer, "base", "lidar", 2 * kSecond, pose_of(21)), StaticConflict);
    CHECK_EQ(
        buffer.set_transform({"base", "lidar", 2 * kSecond, pose_of(21)}, false, "me", kChangeKind),
        commit + 1);
    set(buffer, "base", "lidar", 4 * kSecond, pose_of(23));

    CHECK(identical(at(buffer, "base", "lidar", 2 * kSecond), pose_of(21)));
    CHECK(apart(at(buffer, "base", "scan", 2 * kSecond),
                geometry::compose(pose_of(21), pose_of(30))) < 1e-12);
    CHECK_THROWS_AS(at(buffer, "base", "lidar", 1 * kSecond), Extrapolation);
    CHECK_EQ(buffer.samples("lidar").stamps, (std::vector<StampNs>{2 * kSecond, 4 * kSecond}));
    CHECK(!buffer.frame_info("lidar").is_static);
    CHECK(identical(at(before, "base", "lidar", 1 * kSecond), pose_of(20)));
    CHECK(before.frame_info("lidar").is_static);
    CHECK_EQ(before.samples("lidar").stamps, (std::vector<StampNs>{-1}));
}

TFDB_TEST(a_moving_edge_becomes_static_and_its_samples_go) {
    Buffer buffer = robot();
    const Snapshot before = buffer.snapshot();
    CHECK_THROWS_AS(set_static(buffer, "odom", "base", pose_of(7)), StaticConflict);
    buffer.set_transform({"odom", "base", 0, pose_of(7)}, true, "me", kChangeKind);

    CHECK(identical(at(buffer, "odom", "base", 77 * kSecond), pose_of(7)));
    CHECK(apart(at(buffer, "odom", "scan", 0),
                geometry::compose(pose_of(7), geometry::compose(pose_of(20), pose_of(30)))) <
          1e-12);
    CHECK_THROWS_AS(at(buffer, "map", "base", 2 * kSecond), Disconnected);
    CHECK(identical(at(before, "map", "base", 2 * kSecond), pose_of(2)));
    // And back again, with stamps older than those that were dropped.
    buffer.set_transform({"map", "base", kSecond, pose_of(9)}, false, "me", kChangeKind);
    CHECK(identical(at(buffer, "map", "base", kSecond), pose_of(9)));
    CHECK_EQ(buffer.samples("base").stamps, (std::vector<StampNs>{kSecond}));
}

TFDB_TEST(a_change_of_kind_that_is_refused_changes_nothing) {
    Buffer buffer = robot();
    const CommitNumber commit = buffer.commit();
    // Valid alone, but not in this batch; and a member that would close a cycle.
    const TransformView bad[] = {{"base", "lidar", kSecond, pose_of(21)},
                                 {"base", "arm", -kSecond, pose_of(22)}};
    CHECK_THROWS_AS(buffer.set_transforms(bad, false, "me", kChangeKind), InvalidStamp);
    const TransformView circle[] = {{"scan", "lidar", kSecond, pose_of(21)}};
    CHECK_THROWS_AS(buffer.set_transforms(circle, false, "me", kChangeKind), CycleError);
    CHECK_EQ(buffer.commit(), commit);
    CHECK(buffer.frame_info("lidar").is_static);
    CHECK(identical(at(buffer, "base", "lidar", 99 * kSecond), pose_of(20)));
    CHECK(identical(at(buffer, "map", "base", 3 * kSecond), pose_of(3)));

    const WriteResult result =
        buffer.write({.transforms = bad, .authority = "me", .rules = kChangeKind, .partial = true});
    CHECK_EQ(result.refused.size(), 1U);
    CHECK_EQ(result.commit, commit + 1);
    CHECK(identical(at(buffer, "base", "lidar", kSecond), pose_of(21)));
}

TFDB_TEST(a_transaction_that_read_an_edge_loses_when_its_kind_changes) {
    if (skipped_in({Concurrency::kGiant, Concurrency::kFine, Concurrency::kNoWait,
                    Concurrency::kWaitDie, Concurrency::kWoundWait, Concurrency::kSilo},
                   "it would wait for the transaction, or does not isolate"))
        return;
    for (const bool to_static : {false, true}) {
        Buffer buffer = robot();
        const char* const child = to_static ? "base" : "lidar";
        const char* const parent = to_static ? "map" : "base";
        Transaction tx(buffer);
        (void)tx.lookup_transform(parent, child, 2 * kSecond);
        std::thread([&] {
            buffer.set_transform({parent, child, 2 * kSecond, pose_of(40)}, to_static, "other",
                                 kChangeKind);
        }).join();
        const TransformView mark{"map", "mark", kSecond, pose_of(1)};
        tx.set_transforms({&mark, 1}, false, "tx");
        CHECK_THROWS_AS(tx.commit(), Conflict);
    }
}

TFDB_TEST(only_new_keeps_the_first_value_of_a_stamp) {
    Buffer buffer = robot();
    const CommitNumber commit = buffer.commit();
    const auto error = THROWN(
        RepeatedStamp,
        buffer.set_transform({"map", "base", 2 * kSecond, pose_of(50)}, false, "me", kOnlyNew));
    CHECK_EQ(error->detail().edge, "base");
    CHECK_EQ(error->detail().stamp, std::optional<std::int64_t>(2 * kSecond));
    CHECK_EQ(buffer.commit(), commit);
    // Under another parent it is the same stamp of the same edge.
    CHECK_THROWS_AS(
        buffer.set_transform({"odom", "base", 4 * kSecond, pose_of(50)}, false, "me", kOnlyNew),
        RepeatedStamp);
    CHECK(identical(at(buffer, "map", "base", 2 * kSecond), pose_of(2)));
    // After all others, and late between others.
    buffer.set_transform({"map", "base", 5 * kSecond, pose_of(5)}, false, "me", kOnlyNew);
    buffer.set_transform({"map", "base", 3 * kSecond + 1, pose_of(6)}, false, "me", kOnlyNew);
    CHECK_THROWS_AS(
        buffer.set_transform({"map", "base", 3 * kSecond + 1, pose_of(8)}, false, "me", kOnlyNew),
        RepeatedStamp);
    CHECK(identical(at(buffer, "map", "base", 3 * kSecond + 1), pose_of(6)));
    // Without the option the later value counts.
    set(buffer, "map", "base", 2 * kSecond, pose_of(50));
    CHECK(identical(at(buffer, "map", "base", 2 * kSecond), pose_of(50)));
}

TFDB_TEST(only_new_refuses_a_stamp_that_comes_twice_in_the_batch) {
    Buffer buffer = robot();
    const TransformView batch[] = {{"map", "base", 9 * kSecond, pose_of(9)},
                                   {"base", "arm", 9 * kSecond, pose_of(10)},
                                   {"map", "base", 9 * kSecond, pose_of(11)},
                                   {"map", "base", 1 * kSecond, pose_of(12)}};
    const auto error = THROWN(RepeatedStamp, buffer.set_transforms(batch, false, "me", kOnlyNew));
    CHECK_EQ(error->detail().index, std::optional<std::uint64_t>(2));
    CHECK_EQ(error->detail().refused.size(), 2U);
    const auto refused =
        buffer.write({.transforms = batch, .authority = "me", .rules = kOnlyNew, .partial = true})
            .refused;
    CHECK_EQ(refused.size(), 2U);
    CHECK(identical(at(buffer, "map", "base", 9 * kSecond), pose_of(9)));
    CHECK(identical(at(buffer, "base", "arm", 9 * kSecond), pose_of(10)));
}

TFDB_TEST(only_new_lets_the_next_one_in_where_the_first_closes_a_cycle) {
    Buffer buffer = robot();
    const TransformView batch[] = {{"scan", "lidar", 9 * kSecond, pose_of(9)},
                                   {"base", "lidar", 9 * kSecond, pose_of(10)},
                                   {"base", "lidar", 9 * kSecond, pose_of(11)}};
    const auto refused =
        buffer
            .write({.transforms = batch, .authority = "me", .rules = {true, true}, .partial = true})
            .refused;
    CHECK_EQ(refused.size(), 2U);
    CHECK(refused[0].index == 0 && refused[0].code == ErrorCode::kCycle);
    CHECK(refused[1].index == 2 && refused[1].code == ErrorCode::kRepeatedStamp);
    CHECK(identical(at(buffer, "base", "lidar", 9 * kSecond), pose_of(10)));
}

TFDB_TEST(only_new_judges_what_is_retained_and_not_cleared) {
    Buffer buffer(keeping(2 * kSecond));
    for (StampNs second = 1; second <= 4; ++second)
        set(buffer, "map", "base", second * kSecond, pose_of(static_cast<double>(second)));
    CHECK_THROWS_AS(
        buffer.set_transform({"map", "base", kSecond, pose_of(7)}, false, "me", kOnlyNew), TooOld);
    CHECK_THROWS_AS(
        buffer.set_transform({"map", "base", 2 * kSecond, pose_of(7)}, false, "me", kOnlyNew),
        RepeatedStamp);
    buffer.clear();
    buffer.set_transform({"map", "base", 2 * kSecond, pose_of(7)}, false, "me", kOnlyNew);
    CHECK(identical(at(buffer, "map", "base", 2 * kSecond), pose_of(7)));
    CHECK_THROWS_AS(buffer.set_transform({"map", "pole", 0, pose_of(1)}, true, "me", kOnlyNew),
                    InvalidArgument);
}

TFDB_TEST(parent_and_child_swap_in_one_batch) {
    // Static: each of the two messages is refused after the other.
    Buffer buffer = robot();
    const TransformView first[] = {{"scan", "lidar", 0, pose_of(1)}};
    CHECK_THROWS_AS(buffer.set_transforms(first, true, "me"), CycleError);
    const TransformView both[] = {{"scan", "lidar", 0, pose_of(1)},
                                  {"base", "scan", 0, pose_of(2)}};
    buffer.set_transforms(both, true, "me");
    CHECK(apart(at(buffer, "base", "lidar", 0), geometry::compose(pose_of(2), pose_of(1))) < 1e-12);
    // Moving: from that stamp on.
    set(buffer, "base", "a", kSecond, pose_of(3));
    set(buffer, "a", "b", kSecond, pose_of(4));
    const TransformView moving[] = {{"b", "a", 2 * kSecond, pose_of(5)},
                                    {"base", "b", 2 * kSecond, pose_of(6)}};
    CHECK_THROWS_AS(buffer.set_transforms({moving, 1}, false, "me"), CycleError);
    CHECK(buffer.write({.transforms = moving, .authority = "me", .partial = true}).refused.empty());
    CHECK(apart(at(buffer, "base", "a", 2 * kSecond), geometry::compose(pose_of(6), pose_of(5))) <
          1e-12);
    CHECK(apart(at(buffer, "base", "b", kSecond), geometry::compose(pose_of(3), pose_of(4))) <
          1e-12);
}

}  // namespace tfdb
