// Readers while memory is short, and while slots are reused during a listing.
#include <atomic>
#include <string>
#include <thread>
#include <vector>

#include "tfdb/store/buffer.hpp"
#include "tfdb/testing/check.hpp"

namespace tfdb {

namespace {

constexpr Pose kPose{{1.0, 2.0, 3.0}, {0.6, 0.0, 0.8, 0.0}};

CommitNumber set(Buffer& buffer, std::string_view child, StampNs stamp) {
    return buffer.set_transform({"map", child, stamp, kPose}, false, "");
}

ErrorCode code_of_lookup(const StoreReader& reads, StampNs stamp) {
    try {
        static_cast<void>(reads.lookup_transform("map", "base", stamp));
    } catch (const Error& error) {
        return error.code();
    }
    return ErrorCode::kInvalidArgument;  // none: it answered
}

/// A frame table of `count` children; `churn` removes one and makes another.
Buffer small_store(int count) {
    BufferOptions options;
    options.max_frames = static_cast<std::uint32_t>(count) + 2;
    Buffer buffer(options);
    for (int i = 0; i < count; ++i)
        set(buffer, "child " + std::to_string(i), 10);
    return buffer;
}

void churn(Buffer& buffer, int count, int steps) {
    for (int i = 0; i < steps; ++i) {
        buffer.remove_frame("child " + std::to_string(i), false);
        set(buffer, "child " + std::to_string(count + i), 10);
    }
}

}  // namespace

TFDB_TEST(held_snapshot_does_not_stop_writers_at_the_memory_limit) {
    BufferOptions options;
    options.history_ns = 100;
    options.memory_limit = std::size_t{1} << 16;
    Buffer buffer(options);
    for (StampNs stamp = 0; stamp <= 200; stamp += 10)
        set(buffer, "base", stamp);
    const Snapshot held = buffer.snapshot();
    CHECK_EQ(held.lookup_transform("map", "base", 150).edges.size(), 1U);
    for (StampNs stamp = 210; stamp <= 20'000; stamp += 10)
        set(buffer, "base", stamp);
    CHECK_EQ(buffer.lookup_transform("map", "base", 19'995).edges.size(), 1U);
    CHECK_EQ(buffer.frame_info("base").samples, 11U);
    CHECK(buffer.memory().used_bytes <= *options.memory_limit);
    CHECK(code_of_lookup(held, 150) == ErrorCode::kSnapshotTooOld);
}

TFDB_TEST(memory_limit_without_anything_obsolete_refuses_and_keeps_all) {
    BufferOptions options;
    options.history_ns = std::nullopt;
    options.memory_limit = std::size_t{1} << 15;
    Buffer buffer(options);
    StampNs stamp = 0;
    try {
        for (; stamp < 100'000; stamp += 10)
            set(buffer, "base", stamp);
    } catch (const CapacityExceeded&) {
        CHECK(stamp > 0);
    }
    const CommitNumber before = buffer.commit();
    CHECK_THROWS_AS(set(buffer, "base", stamp), CapacityExceeded);
    CHECK_EQ(buffer.commit(), before);
    CHECK_EQ(buffer.frame_info("base").newest, stamp - 10);
    CHECK_EQ(buffer.frame_info("base").samples, static_cast<std::uint64_t>(stamp / 10));
}

TFDB_TEST(repeated_stamps_do_not_fill_the_memory) {
    BufferOptions options;
    options.history_ns = std::nullopt;
    options.memory_limit = std::size_t{1} << 18;
    Buffer buffer(options);
    for (StampNs stamp = 0; stamp < 1'000; stamp += 10)
        set(buffer, "base", stamp);
    const std::size_t before = buffer.memory().used_bytes;
    for (int i = 0; i < 100'000; ++i) {
        Pose pose = kPose;
        pose.translation.x = i;
        buffer.set_transform({"map", "base", 990 - 10 * (i % 3), pose}, false, "");
    }
    CHECK(buffer.memory().used_bytes <= 2 * before);
    CHECK_EQ(buffer.frame_info("base").samples, 100U);
    CHECK_EQ(buffer.lookup_transform("map", "base", 990).pose.translation.x, 99'999.0);
    CHECK_EQ(buffer.lookup_transform("map", "base", 970).pose.translation.x, 99'998.0);
    CHECK_EQ(buffer.lookup_transform("map", "base", 10).pose.translation.x, 1.0);
}

TFDB_TEST(listings_miss_no_frame_whose_slot_is_reused_meanwhile) {
    constexpr int kFrames = 64;
    constexpr int kSteps = 20'000;
    Buffer buffer = small_store(kFrames);
    std::atomic<bool> done{false};
    std::thread writer([&] {
        churn(buffer, kFrames, kSteps);
        done.store(true);
    });
    bool trees_whole = true;
    bool lists_whole = true;
    while (!done.load()) {
        // `map` and its children, one of which may just have been removed.
        const std::size_t in_tree = buffer.tree().size();
        trees_whole = trees_whole && (in_tree == kFrames + 1 || in_tree == kFrames);
        const std::size_t listed = buffer.frames().size();
        lists_whole = lists_whole && (listed == kFrames + 1 || listed == kFrames);
    }
    writer.join();
    CHECK(trees_whole);
    CHECK(lists_whole);
    CHECK_EQ(buffer.tree().size(), static_cast<std::size_t>(kFrames) + 1);
}

TFDB_TEST(interval_of_a_velocity_that_no_stamp_has_is_refused) {
    Buffer buffer;
    set(buffer, "base", 10);
    CHECK_THROWS_AS(static_cast<void>(buffer.lookup_velocity(
                        "map", "base", 10, std::numeric_limits<StampNs>::max(), "", {}, "")),
                    InvalidArgument);
}

}  // namespace tfdb
