// Memory that the store keeps and frees, with held snapshots, late samples and refused writes.
#include <deque>
#include <vector>

#include "tfdb/store/transaction_fixture.test.hpp"
#include "tfdb/testing/sanitized.hpp"

namespace tfdb {
namespace {

using namespace fixture;

constexpr std::size_t kMiB = std::size_t{1} << 20;

std::size_t used(const Buffer& buffer) {
    const MemoryUse use = buffer.memory();
    return use.used_bytes + use.free_bytes;
}

/// A batch that closes a cycle: it is refused as a whole.
std::vector<TransformView> refused_with(std::vector<TransformView> batch) {
    batch.push_back({"x", "y", 1, pose_of(1)});
    batch.push_back({"y", "x", 1, pose_of(2)});
    return batch;
}

}  // namespace

TFDB_TEST(memory_of_stamps_that_begin_again_after_a_clear_is_kept_beside_a_snapshot) {
    constexpr StampNs kLoop = 3'000;
    constexpr StampNs kHistory = 1'000;
    Buffer buffer(keeping(kHistory));
    for (StampNs stamp = 0; stamp < kLoop; ++stamp)
        set(buffer, "map", "base", stamp, pose_of(static_cast<double>(stamp)));
    const Snapshot held = buffer.snapshot();
    buffer.clear();
    for (StampNs stamp = 0; stamp < kLoop; ++stamp) {
        set(buffer, "map", "base", stamp, pose_of(static_cast<double>(stamp + 1)));
        const auto expected = static_cast<std::uint64_t>(std::min(stamp, kHistory) + 1);
        CHECK_EQ(buffer.frame_info("base").samples, expected);
    }
    CHECK_EQ(held.frame_info("base").samples, static_cast<std::uint64_t>(kHistory) + 1);
    CHECK_EQ(number_of(held.lookup_transform("map", "base", 2'500).pose), 2'500.0);
    CHECK_EQ(number_of(buffer.lookup_transform("map", "base", 2'500).pose), 2'501.0);
}

TFDB_TEST(memory_of_a_burst_that_is_no_longer_retained_is_given_back) {
    constexpr StampNs kSamples = 100'000;
    constexpr StampNs kLater = 10 * kSamples;
    Buffer buffer(keeping(100));
    for (const std::string_view child : {"base", "other"}) {
        std::vector<TransformView> burst;
        for (StampNs stamp = 0; stamp < kSamples; ++stamp)
            burst.push_back({"map", child, stamp, pose_of(static_cast<double>(stamp))});
        buffer.set_transforms(burst, false, "");
    }
    {
        const Snapshot old = buffer.snapshot();
        set(buffer, "map", "base", kLater, pose_of(7));
        CHECK(!buffer.compact());
        CHECK_EQ(number_of(old.lookup_transform("map", "base", kSamples - 50).pose),
                 kSamples - 50.0);
    }
    CHECK(buffer.compact());
    // Only the last segment of each edge remains.
    CHECK(buffer.memory().samples < 3 * 2048);
    CHECK(buffer.memory().used_bytes < 4 * kMiB);
    CHECK_EQ(buffer.frame_info("base").samples, 1U);
    CHECK_EQ(buffer.frame_info("other").samples, 101U);
    for (StampNs stamp = kSamples - 101; stamp < kSamples; ++stamp) {
        CHECK_EQ(number_of(buffer.lookup_transform("map", "other", stamp).pose),
                 static_cast<double>(stamp));
    }
    CHECK_EQ(number_of(buffer.lookup_transform("map", "base", kLater).pose), 7.0);
}

TFDB_TEST(memory_of_a_cleared_edge_survives_a_refused_batch) {
    Buffer buffer(keeping(10));
    set(buffer, "map", "base", 200, pose_of(1));
    for (StampNs stamp = 200; stamp < 217; ++stamp)
        set(buffer, "map", "other", stamp, pose_of(2));
    const Snapshot before = buffer.snapshot();
    buffer.clear();
    set(buffer, "map", "base", 0, pose_of(7));
    const Snapshot after = buffer.snapshot();
    std::vector<TransformView> later;
    for (StampNs stamp = 30; stamp < 38; ++stamp)
        later.push_back({"map", "base", stamp, pose_of(3)});
    CHECK(THROWN(CycleError, buffer.set_transforms(refused_with(later), false, "")));
    CHECK_EQ(number_of(buffer.lookup_transform("map", "base", 0).pose), 7.0);
    CHECK_EQ(number_of(after.lookup_transform("map", "base", 0).pose), 7.0);
    CHECK_EQ(number_of(before.lookup_transform("map", "base", 200).pose), 1.0);
}

/// An aborted clear and later late samples: older snapshots still see their state.
TFDB_TEST(memory_of_an_edge_whose_clear_was_taken_back_is_that_of_its_snapshots) {
    Buffer buffer(keeping(std::nullopt));
    for (StampNs stamp = 0; stamp < 2'000; stamp += 2)
        set(buffer, "map", "base", stamp, pose_of(static_cast<double>(stamp)));
    const Snapshot held = buffer.snapshot();
    for (int round = 0; round < 3; ++round) {
        const TransformView fixed[] = {
            {"map", "base", 0, pose_of(5)}, {"x", "y", 0, pose_of(1)}, {"y", "x", 0, pose_of(2)}};
        CHECK(THROWN(CycleError, buffer.set_transforms(fixed, true, "", {.change_kind = true})));
        for (StampNs stamp = 1 + 600 * round; stamp < 600 * (round + 1); stamp += 2)
            set(buffer, "map", "base", stamp, pose_of(-1));
        for (StampNs stamp = 1; stamp < 1'998; stamp += 38) {
            const Answer answer = held.lookup_transform("map", "base", stamp);
            CHECK_EQ(answer.edges.front().before, stamp - 1);
            CHECK_EQ(answer.edges.front().after, stamp + 1);
        }
    }
    buffer.clear();
    set(buffer, "map", "base", 1, pose_of(9));
    CHECK_EQ(held.frame_info("base").samples, 1'000U);
    CHECK_EQ(buffer.frame_info("base").samples, 1U);
}

TFDB_TEST(memory_of_a_bounded_history_is_bounded_where_samples_come_late) {
    static constexpr StampNs kHistory = 1'000;
    static constexpr StampNs kWrites = testing::rounds(40'000);
    const auto check = [](const char* pattern, StampNs now, auto stamp_of) {
        Buffer buffer(keeping(kHistory));
        std::size_t most = 0;
        for (StampNs k = 1; k <= kWrites; ++k) {
            set(buffer, "map", "base", now + stamp_of(k), pose_of(1));
            if (k == kWrites / 4)
                most = 2 * used(buffer) + kMiB;
        }
        if (used(buffer) > most)
            std::printf("  %s: %zu bytes\n", pattern, used(buffer));
        CHECK(used(buffer) <= most);
    };
    check("a newest one now and then, the others below it", 1'000,
          [](StampNs k) { return k % 50 == 0 ? k + 500 : k; });
    check("bursts with their newest first", 1'000,
          [](StampNs k) { return k / 200 * 200 + 200 - k % 200; });
    check("shuffled", 1'000, [](StampNs k) { return k / 500 * 500 + k * 377 % 500; });
}

TFDB_TEST(memory_of_refused_batches_comes_back) {
    Buffer buffer(keeping(std::nullopt));
    for (StampNs stamp = 10; stamp < 2'000; stamp += 10)
        set(buffer, "map", "base", stamp, pose_of(1));
    set_static(buffer, "map", "fixed", pose_of(1));
    const std::size_t before = used(buffer);
    const CommitNumber commit = buffer.commit();
    for (int i = 0; i < 500; ++i) {
        CHECK(THROWN(CycleError, buffer.set_transforms(
                                     refused_with({{"map", "base", 15, pose_of(2)}}), false, "")));
        CHECK(THROWN(CycleError,
                     buffer.set_transforms(refused_with({{"map", "fixed", 15, pose_of(2)}}), false,
                                           "", {.change_kind = true})));
    }
    CHECK_EQ(buffer.commit(), commit);
    CHECK(used(buffer) <= before + kMiB);
    CHECK_EQ(buffer.frame_info("base").samples, 199U);
}

TFDB_TEST(memory_of_late_samples_is_the_same_for_one_batch_of_them) {
    constexpr StampNs kSamples = 20'000;
    BufferOptions options = keeping(std::nullopt);
    options.memory_limit = 8 * kMiB;
    Buffer buffer(options);
    std::vector<TransformView> batch;
    for (StampNs stamp = 0; stamp < kSamples; ++stamp)
        batch.push_back({"map", "base", 4 * stamp, pose_of(static_cast<double>(stamp))});
    buffer.set_transforms(batch, false, "");
    const std::size_t before = buffer.memory().used_bytes;
    for (TransformView& transform : batch)
        transform.stamp += 2;
    buffer.set_transforms(batch, false, "");
    CHECK(buffer.memory().used_bytes <= 3 * before);
    CHECK_EQ(buffer.frame_info("base").samples, 2U * kSamples);
    CHECK_EQ(buffer.frame_info("base").late, kSamples - 1U);
    for (StampNs stamp = 1; stamp < 4 * kSamples - 2; stamp += 998) {
        const Answer answer = buffer.lookup_transform("map", "base", stamp);
        CHECK_EQ(answer.edges.front().before, stamp - 1);
        CHECK_EQ(answer.edges.front().after, stamp + 1);
    }
}

TFDB_TEST(memory_of_a_batch_among_few_samples_is_small) {
    BufferOptions options = keeping(std::nullopt);
    options.memory_limit = 300'000;
    Buffer buffer(options);
    std::vector<TransformView> batch;
    for (StampNs stamp = 0; stamp < 50; ++stamp)
        batch.push_back({"map", "base", 10 * stamp, pose_of(1)});
    set(buffer, "map", "base", 10'000, pose_of(1));
    for (int round = 0; round < 10; ++round) {
        buffer.set_transforms(batch, false, "");
        for (TransformView& transform : batch)
            ++transform.stamp;
    }
    CHECK_EQ(buffer.frame_info("base").samples, 501U);
}

/// Late samples do not use up a held snapshot's memory.
TFDB_TEST(memory_of_a_snapshot_is_not_spent_on_late_samples) {
    BufferOptions options = keeping(std::nullopt);
    options.snapshot_memory = kMiB;
    Buffer buffer(options);
    for (StampNs stamp = 0; stamp < 100'000; stamp += 10)
        set(buffer, "map", "base", stamp, pose_of(static_cast<double>(stamp)));
    const Snapshot held = buffer.snapshot();
    for (StampNs k = 0; k < 5'000; ++k)
        set(buffer, "map", "base", k * 7919 % 99'990 / 10 * 10 + 5, pose_of(-1));
    CHECK_EQ(held.frame_info("base").samples, 10'000U);
    CHECK_EQ(held.lookup_transform("map", "base", 50'005).edges.front().after, 50'010);
}

/// For any overlap, the memory for snapshots stays within 1.1 times the limit.
TFDB_TEST(memory_of_overlapping_snapshots_is_bounded) {
    constexpr StampNs kHistory = 2'000;
    constexpr StampNs kWrites = testing::rounds(240'000);
    constexpr std::size_t kBound = testing::rounds(8 * kMiB);
    enum class Pattern { kInOrder, kLate, kClears, kFrames, kSameStamp, kStatic };
    for (const Pattern pattern : {Pattern::kInOrder, Pattern::kLate, Pattern::kClears,
                                  Pattern::kFrames, Pattern::kSameStamp, Pattern::kStatic}) {
        std::size_t alone = 0;
        for (const bool holds : {false, true}) {
            BufferOptions options = keeping(kHistory);
            options.snapshot_memory = kBound;
            Buffer buffer(options);
            std::deque<Snapshot> held;
            std::size_t most = 0;
            for (StampNs k = 0; k < kWrites; ++k) {
                if (pattern == Pattern::kStatic)
                    set_static(buffer, "map", "fixed", pose_of(static_cast<double>(k)));
                else
                    set(buffer, "map", "base", pattern == Pattern::kSameStamp ? 1'000 : 1'000 + k,
                        pose_of(1));
                if (pattern == Pattern::kLate && k % 8 == 0)
                    set(buffer, "map", "base", 1'000 + k - 300, pose_of(2));
                if (pattern == Pattern::kClears && k % 3'000 == 0)
                    buffer.clear();
                if (pattern == Pattern::kFrames && k % 3'000 == 0)
                    buffer.remove_frame("base", false);
                if (holds && k % 1'000 == 0)
                    held.push_back(buffer.snapshot());
                if (held.size() > 200)
                    held.pop_front();
                if (k % 1'000 == 0)
                    most = std::max(most, used(buffer));
            }
            if (!holds) {
                alone = most;
                continue;
            }
            std::printf("  pattern %d: %zu bytes, alone %zu\n", static_cast<int>(pattern), most,
                        alone);
            // In addition, 256 KiB are kept for current reads, and outgrown directories are free.
            CHECK(most <= alone + kBound + kBound / 10 + kMiB);
        }
    }
}

/// Data that only a snapshot needs is freed when it is closed, even if the stamp never changes.
TFDB_TEST(memory_of_the_same_stamp_again_comes_back) {
    for (const bool fixed : {false, true}) {
        Buffer buffer(keeping(std::nullopt));
        const auto write = [&](double number) {
            if (fixed)
                set_static(buffer, "map", "base", pose_of(number));
            else
                set(buffer, "map", "base", 1'000, pose_of(number));
        };
        set(buffer, "map", "other", 5, pose_of(1));
        write(0);
        {
            const Snapshot held = buffer.snapshot();
            const std::size_t before = buffer.memory().used_bytes;
            for (int k = 1; k <= 20'000; ++k)
                write(k);
            CHECK(buffer.memory().used_bytes > before + 20'000 * 64);
            CHECK_EQ(number_of(held.lookup_transform("map", "base", 1'000).pose), 0.0);
            CHECK_EQ(number_of(buffer.lookup_transform("map", "base", 1'000).pose), 20'000.0);
        }
        for (int k = 1; k <= 1'000; ++k)
            write(-k);
        CHECK(buffer.memory().used_bytes < kMiB / 2);
        CHECK_EQ(buffer.frame_info("base").samples, 1U);
        CHECK_EQ(number_of(buffer.lookup_transform("map", "base", 1'000).pose), -1'000.0);
    }
}

/// Also if one commit writes many edges.
TFDB_TEST(memory_of_a_snapshot_is_bounded_amid_a_batch) {
    constexpr std::size_t kEdges = 100;
    std::size_t most[2] = {};
    for (const bool holds : {false, true}) {
        BufferOptions options = keeping(1'000);
        options.snapshot_memory = kMiB / 4;
        Buffer buffer(options);
        std::vector<std::string> names;
        std::vector<TransformView> batch;
        for (std::size_t i = 0; i < kEdges; ++i)
            names.push_back("frame" + std::to_string(i));
        for (const std::string& name : names)
            batch.push_back({"map", name, 0, pose_of(1)});
        std::optional<Snapshot> held;
        for (StampNs stamp = 0; stamp < 6'000; stamp += 3) {
            for (TransformView& transform : batch)
                transform.stamp = stamp;
            buffer.set_transforms(batch, false, "");
            if (holds && stamp == 3'000)
                held.emplace(buffer.snapshot());
            most[holds ? 1 : 0] = std::max(most[holds ? 1 : 0], buffer.memory().used_bytes);
        }
    }
    CHECK(most[1] <= most[0] + kMiB / 2);
}

TFDB_TEST(memory_that_a_snapshot_made_an_edge_take_comes_back) {
    std::size_t in_the_end[2] = {};
    for (const bool holds : {false, true}) {
        Buffer buffer(keeping(50));
        std::optional<Snapshot> held;
        for (StampNs stamp = 0; stamp < 3'000; ++stamp) {
            set(buffer, "map", "base", stamp, pose_of(1));
            if (holds && stamp == 500)
                held.emplace(buffer.snapshot());
            if (stamp == 1'500)
                held.reset();
        }
        in_the_end[holds ? 1 : 0] = buffer.memory().used_bytes;
    }
    CHECK(in_the_end[1] <= in_the_end[0] + 2'048);  // its directory
}

TFDB_TEST(memory_of_frames_that_come_and_go_is_bounded_beside_a_snapshot) {
    BufferOptions options = keeping(1'000);
    options.snapshot_memory = kMiB / 4;
    Buffer buffer(options);
    set(buffer, "map", "base", 1, pose_of(1));
    const Snapshot held = buffer.snapshot();
    for (StampNs stamp = 2; stamp < 20'000; ++stamp) {
        set(buffer, "map", "base", stamp, pose_of(1));
        buffer.remove_frame("base", false);
    }
    CHECK(buffer.memory().frame_bytes < kMiB / 2);
    CHECK(THROWN(SnapshotTooOld, held.lookup_transform("map", "base", 1)));
}

TFDB_TEST(memory_of_what_was_cleared_is_used_again) {
    constexpr StampNs kSamples = 50'000;
    Buffer buffer(keeping(std::nullopt));
    for (StampNs stamp = 0; stamp < kSamples; ++stamp)
        set(buffer, "map", "base", stamp, pose_of(1));
    const std::size_t before = used(buffer);
    buffer.clear();
    for (StampNs stamp = 0; stamp < kSamples; ++stamp)
        set(buffer, "map", "other", stamp, pose_of(1));
    CHECK(used(buffer) <= before + kMiB / 2);
}

TFDB_TEST(memory_of_what_a_refused_batch_cleared_is_no_conflict) {
    Buffer buffer(keeping(std::nullopt));
    set(buffer, "map", "base", 1, pose_of(1));
    set_static(buffer, "map", "fixed", pose_of(3));
    CHECK(THROWN(CycleError, buffer.set_transforms(refused_with({{"map", "fixed", 5, pose_of(5)}}),
                                                   false, "", {.change_kind = true})));
    Transaction tx(buffer);
    CHECK_EQ(number_of(tx.lookup_transform("map", "fixed", 7).pose), 3.0);
    put(tx, "map", "mark", 1, 4);
    tx.commit();
    CHECK(has_frame(buffer, "mark"));
}

}  // namespace tfdb
