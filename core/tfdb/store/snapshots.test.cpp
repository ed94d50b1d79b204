// Held snapshots: one state until they are closed, during any writes.
#include <atomic>
#include <memory>
#include <random>
#include <thread>

#include "tfdb/store/transaction_fixture.test.hpp"

namespace tfdb {
namespace {

using namespace fixture;

constexpr StampNs kHistory = 64;

/// map <- a <- b moving, b <- c static, map <- other moving.
CommitNumber advance(Buffer& buffer, StampNs stamp) {
    const auto number = static_cast<double>(stamp % 100'000);
    const TransformView batch[] = {{"map", "a", stamp, pose_of(number)},
                                   {"a", "b", stamp, pose_of(number + 1)},
                                   {"map", "other", stamp, pose_of(number + 2)}};
    return buffer.set_transforms(batch, false, "");
}

/// All results of a snapshot, bit for bit.
struct Record {
    std::vector<Pose> poses;
    std::vector<StampNs> stamps;
    std::vector<std::string> frames;
    std::vector<double> rows;

    Record(const StoreReader& reads, StampNs newest) {
        for (StampNs stamp = newest - kHistory; stamp <= newest; stamp += 7) {
            keep(reads.lookup_transform("map", "c", stamp));
            keep(reads.lookup_transform("other", "b", stamp,
                                        {lookup::PolicyKind::kNearest, lookup::kNoLimit}));
        }
        keep(reads.lookup_transform("c", "other"));
        keep(reads.lookup_latest_transform("other", "c"));
        frames = reads.frames();
        for (const std::string& frame : frames) {
            const Samples samples = reads.samples(frame);
            poses.insert(poses.end(), samples.poses.begin(), samples.poses.end());
            stamps.insert(stamps.end(), samples.stamps.begin(), samples.stamps.end());
        }
        const auto times = reads.path_stamps("other", "c", {}, {});
        stamps.insert(stamps.end(), times.begin(), times.end());
        rows.resize(7 * times.size());
        reads.lookup_many("other", "c", times, {}, Layout::kPose, Missing::kThrow, rows);
        stamps.push_back(static_cast<StampNs>(reads.commit()));
    }
    void keep(const Answer& answer) {
        poses.push_back(answer.pose);
        stamps.push_back(answer.stamp);
        stamps.push_back(static_cast<StampNs>(answer.commit));
    }
    [[nodiscard]] bool same(const Record& other) const {
        return stamps == other.stamps && frames == other.frames && rows == other.rows &&
               std::equal(poses.begin(), poses.end(), other.poses.begin(), other.poses.end(),
                          identical);
    }
};

void overwrite(Buffer& buffer) {
    for (StampNs stamp = 2; stamp < 2000; ++stamp)
        set(buffer, "map", "base", stamp, pose_of(static_cast<double>(stamp)));
}

}  // namespace

TFDB_TEST(snapshots_answer_the_same_bits_beside_two_hundred_thousand_commits) {
    constexpr StampNs kCommits = 200'000;
    Buffer buffer(keeping(kHistory));
    set_static(buffer, "b", "c", pose_of(77));
    StampNs now = 0;
    while (now < 1000)
        advance(buffer, ++now);
    const Snapshot held = buffer.snapshot();
    const Record first(held, now);
    std::thread writer([&buffer, now] {
        for (StampNs stamp = now + 1; stamp <= now + kCommits; ++stamp) {
            advance(buffer, stamp);
            if (stamp % 1000 == 0)
                set_static(buffer, "b", "c", pose_of(static_cast<double>(stamp % 97)));
        }
    });
    int rounds = 0;
    while (buffer.commit() < kCommits) {
        CHECK(first.same(Record(held, now)));
        ++rounds;
    }
    writer.join();
    CHECK(rounds > 0);
    CHECK(first.same(Record(held, now)));
    CHECK_EQ(number_of(buffer.lookup_transform("map", "a").pose), (now + kCommits) % 100'000);
}

TFDB_TEST(snapshots_open_later_commits_beside_a_writer) {
    constexpr int kRounds = 2'000;
    Buffer buffer(keeping(kHistory));
    std::atomic<bool> over{false};
    std::atomic<StampNs> written{2};
    const CommitNumber before = advance(buffer, 1);
    const CommitNumber each = advance(buffer, 2) - before;  // in `fine` each sample is a commit
    std::thread writer([&] {
        for (StampNs stamp = 3; !over; ++stamp) {
            advance(buffer, stamp);
            written = stamp;
        }
    });
    std::mt19937 random(1);
    auto held = std::make_unique<Snapshot>(buffer.snapshot());
    for (int round = 0; round < kRounds; ++round) {
        const CommitNumber reach = before + each * static_cast<CommitNumber>(written - 1);
        const CommitNumber first = held->commit();
        const CommitNumber commit = reach > first ? first + random() % (reach - first + 1) : first;
        auto later = std::make_unique<Snapshot>(held->at(commit));
        if (round % 100 == 99)
            held = std::make_unique<Snapshot>(buffer.snapshot());  // the first one goes first
        CHECK_EQ(later->commit(), commit);
        const StampNs stamp = 1 + static_cast<StampNs>((commit - before) / each);
        for (const char* name : {"a", "b", "other"}) {
            const FrameInfo info = later->frame_info(name);
            CHECK(info.newest == stamp || (each > 1 && info.newest == stamp + 1));
            CHECK_EQ(info.samples, static_cast<std::uint64_t>(std::min(info.newest, kHistory + 1)));
        }
    }
    over = true;
    writer.join();
}

TFDB_TEST(snapshots_open_no_commit_that_they_do_not_protect) {
    Buffer buffer(keeping(kHistory));
    set(buffer, "map", "base", 1, pose_of(1));
    const CommitNumber first = set(buffer, "map", "base", 2, pose_of(2));
    const Snapshot held = buffer.snapshot();
    const CommitNumber last = set(buffer, "map", "base", 3, pose_of(3));
    CHECK_EQ(number_of(held.at(first).lookup_transform("map", "base").pose), 2.0);
    CHECK_EQ(number_of(held.at(last).at(last).lookup_transform("map", "base").pose), 3.0);
    const auto older = THROWN(InvalidArgument, held.at(first - 1));
    CHECK(older && says(*older, "commit " + std::to_string(first - 1) + ": it is of commit " +
                                    std::to_string(first)));
    const auto missing = THROWN(InvalidArgument, held.at(last + 1));
    CHECK(missing && says(*missing, "commit " + std::to_string(last + 1) + ": the newest is " +
                                        std::to_string(last)));
    THROWN(InvalidArgument, held.at(last).at(first));
}

TFDB_TEST(snapshots_of_later_commits_are_given_up_as_others_are) {
    BufferOptions options = keeping(kHistory);
    options.snapshot_memory = 0;
    Buffer buffer(options);
    set(buffer, "map", "base", 1, pose_of(1));
    const Snapshot held = buffer.snapshot();
    overwrite(buffer);
    const Snapshot later = held.at(held.commit() + 1);
    const auto error = THROWN(SnapshotTooOld, later.lookup_transform("map", "base", 2));
    CHECK(error && says(*error, "snapshot " + std::to_string(later.commit())));
}

TFDB_TEST(snapshots_are_given_up_when_their_memory_is_spent_and_fresh_reads_go_on) {
    BufferOptions options = keeping(kHistory);
    options.snapshot_memory = 128 * 1024;
    Buffer buffer(options);
    set_static(buffer, "b", "c", pose_of(77));
    StampNs now = 0;
    while (now < 1000)
        advance(buffer, ++now);
    const Snapshot held = buffer.snapshot();
    const Record first(held, now);
    const StampNs asked = now - 10;
    bool lost = false;
    for (int i = 0; i < 6'000; ++i) {
        advance(buffer, ++now);
        CHECK_EQ(buffer.lookup_transform("other", "c").stamp, now);
        try {
            CHECK_EQ(held.lookup_transform("map", "c", asked).stamp, asked);
            CHECK(!lost);  // once lost it stays lost
        } catch (const SnapshotTooOld& error) {
            CHECK_EQ(error.detail().commit.value_or(0), held.commit());
            lost = true;
        }
    }
    CHECK(lost);
    CHECK_THROWS_AS(held.samples("a"), SnapshotTooOld);
    CHECK_THROWS_AS(held.tree(), SnapshotTooOld);
    const auto error = THROWN(SnapshotTooOld, held.lookup_transform("other", "c"));
    CHECK(error && says(*error, "snapshot_memory"));
    CHECK(buffer.memory().used_bytes < 512 * 1024);
    const Snapshot again = buffer.snapshot();
    CHECK(Record(again, now).same(Record(buffer, now)));
}

TFDB_TEST(snapshots_that_were_given_up_never_say_that_a_frame_was_not_there) {
    BufferOptions options = keeping(std::nullopt);
    options.snapshot_memory = 0;
    Buffer buffer(options);
    set(buffer, "map", "base", kSecond, pose_of(1));
    set(buffer, "odom", "base", 2 * kSecond, pose_of(2));
    set(buffer, "odom", "arm", kSecond, pose_of(3));
    const Snapshot held = buffer.snapshot();
    FrameHandle handle;
    CHECK(held.find_frame("map", handle));
    CHECK(!held.find_frame("other", handle));
    CHECK_EQ(held.frame_info("arm").parent.value_or("?"), "odom");
    CHECK(held.samples("base").parents == std::vector<std::string>({"map", "odom"}));
    buffer.remove_frame("map", false);
    set(buffer, "base", "hand", kSecond, pose_of(4));  // in the slot of map
    CHECK_THROWS_AS((void)held.find_frame("map", handle), SnapshotTooOld);
    CHECK_THROWS_AS((void)held.samples("base"), SnapshotTooOld);
    buffer.remove_frame("arm", false);
    set(buffer, "map", "base", 3 * kSecond, pose_of(5));
    buffer.remove_frame("odom", false);
    for (const char* name : {"a", "b", "c"})
        set(buffer, "map", name, kSecond, pose_of(6));
    CHECK_THROWS_AS((void)held.frame_info("base"), SnapshotTooOld);
    CHECK_THROWS_AS((void)held.tree(), SnapshotTooOld);
    CHECK_EQ(buffer.frame_info("base").parent.value_or("?"), "map");
    // A parent that was removed before is reported as none.
    const auto parents = buffer.snapshot().samples("base").parents;
    CHECK(parents == std::vector<std::string>({"", "", "map"}));
}

TFDB_TEST(snapshots_with_any_budget_may_be_asked_for) {
    BufferOptions options = keeping(kHistory);
    options.snapshot_memory = std::numeric_limits<std::size_t>::max();
    Buffer buffer(options);
    StampNs now = 0;
    while (now < 1000)
        advance(buffer, ++now);
    const Snapshot held = buffer.snapshot();
    for (int i = 0; i < 5000; ++i)
        advance(buffer, ++now);
    CHECK_EQ(held.lookup_transform("map", "b", 990).stamp, 990);
}

TFDB_TEST(snapshots_taken_again_and_again_do_not_make_the_store_grow) {
    Buffer buffer(keeping(kHistory));
    StampNs now = 0;
    std::size_t settled = 0;
    for (int round = 0; round < 400; ++round) {
        for (int i = 0; i < 100 * (round % 40); ++i)  // long enough to fill many segments
            advance(buffer, ++now);
        const Snapshot held = buffer.snapshot();
        for (int i = 0; i < 50; ++i)
            advance(buffer, ++now);
        if (round == 120)
            settled = buffer.memory().used_bytes;
    }
    // Each edge has filled its newest segment differently.
    constexpr std::size_t kSegments = 96 * 1024;
    CHECK(buffer.memory().used_bytes < settled + kSegments);
    CHECK(settled < 2 * kSegments);
}

TFDB_TEST(snapshots_live_longer_than_their_buffer) {
    auto buffer = std::make_unique<Buffer>(keeping(kHistory));
    set_static(*buffer, "b", "c", pose_of(77));
    StampNs now = 0;
    while (now < 100)
        advance(*buffer, ++now);
    Snapshot held = buffer->snapshot();
    const Record first(held, now);
    const Snapshot moved = std::move(held);
    buffer.reset();
    CHECK(first.same(Record(moved, now)));
}

TFDB_TEST(snapshots_of_the_empty_store) {
    Buffer buffer(defaults());
    const Snapshot empty = buffer.snapshot();
    set(buffer, "map", "a", kSecond, pose_of(1));
    CHECK_EQ(empty.commit(), 0U);
    CHECK(empty.frames().empty() && empty.tree().empty());
    CHECK_THROWS_AS(empty.lookup_transform("map", "a"), UnknownFrame);
    FrameHandle handle;
    CHECK(!empty.find_frame("map", handle));
}

TFDB_TEST(snapshots_see_neither_clear_nor_correction) {
    Buffer buffer(keeping(std::nullopt));
    for (StampNs stamp = 10; stamp <= 50; stamp += 10)
        set(buffer, "map", "a", stamp, pose_of(static_cast<double>(stamp)));
    const Snapshot before = buffer.snapshot();
    set(buffer, "map", "a", 30, pose_of(99));
    const Snapshot corrected = buffer.snapshot();
    buffer.clear();
    const Snapshot cleared = buffer.snapshot();
    set(buffer, "map", "a", 5, pose_of(1));
    CHECK_EQ(number_of(before.lookup_transform("map", "a", 30).pose), 30.0);
    CHECK_EQ(number_of(corrected.lookup_transform("map", "a", 30).pose), 99.0);
    CHECK_EQ(before.frame_info("a").samples, 5U);
    CHECK_THROWS_AS(cleared.lookup_transform("map", "a", 30), Disconnected);
    CHECK_EQ(buffer.lookup_transform("map", "a").stamp, 5);
}

/// Lost data raises an error. In no engine does the thread wait for itself.
TFDB_TEST(snapshot_that_is_too_old_does_not_wait_for_its_own_thread) {
    for (const bool alone : {false, true}) {
        BufferOptions options = keeping(10);
        options.snapshot_memory = 0;
        Buffer buffer(options);
        set(buffer, "map", "base", 1, pose_of(1));
        const Snapshot snapshot = buffer.snapshot();
        overwrite(buffer);
        CHECK(THROWN(SnapshotTooOld, snapshot.lookup_transform("map", "base", 1)));
        Transaction tx(buffer, {.alone = alone});
        CHECK(THROWN(SnapshotTooOld, snapshot.lookup_transform("base", "map", 1)));
        CHECK_EQ(latest(tx, "map", "base"), 1999.0);
    }
}

}  // namespace tfdb
