// A store at its limits refuses writes, stays usable, and loses no data.
#include "tfdb/store/fixture.hpp"

namespace tfdb {
namespace {

using namespace fixture;

BufferOptions with_memory(std::size_t bytes, std::optional<StampNs> history) {
    BufferOptions options = keeping(history);
    options.memory_limit = bytes;
    options.max_frames = 4096;
    return options;
}

}  // namespace

TFDB_TEST(limits_max_frames_is_refused_and_leaves_the_store_usable) {
    BufferOptions options = defaults();
    options.max_frames = 10;
    Buffer buffer(options);
    for (int i = 0; i < 9; ++i)
        set(buffer, "map", "f" + std::to_string(i), kSecond, pose_of(i));
    const CommitNumber commit = buffer.commit();
    const auto error =
        THROWN(CapacityExceeded, set(buffer, "map", "one_more", kSecond, pose_of(1)));
    CHECK(error && says(*error, "max_frames = 10"));
    const TransformView batch[] = {{"map", "f0", 2 * kSecond, pose_of(50)},
                                   {"x", "y", kSecond, pose_of(1)}};
    CHECK_THROWS_AS(buffer.set_transforms(batch, false, ""), CapacityExceeded);
    CHECK_EQ(buffer.commit(), commit);
    CHECK_EQ(buffer.frames().size(), 10U);
    for (int i = 0; i < 9; ++i)
        CHECK_EQ(number_of(buffer.lookup_transform("map", "f" + std::to_string(i)).pose), i);
    set(buffer, "map", "f0", 2 * kSecond, pose_of(51));
    buffer.remove_frame("f1", false);
    for (int i = 0; i < 1000; ++i) {  // one slot is free, again and again
        const std::string name = "g" + std::to_string(i);
        set(buffer, "map", name, kSecond, pose_of(i));
        CHECK_THROWS_AS(set(buffer, "map", "one_more", kSecond, pose_of(1)), CapacityExceeded);
        CHECK_EQ(number_of(buffer.lookup_transform("map", name).pose), i);
        buffer.remove_frame(name, false);
    }
    CHECK_EQ(buffer.frames().size(), 9U);
}

TFDB_TEST(limits_frames_of_held_snapshots_give_way_when_slots_run_out) {
    BufferOptions options = defaults();
    options.max_frames = 3;
    Buffer buffer(options);
    set(buffer, "map", "a", kSecond, pose_of(1));
    const Snapshot held = buffer.snapshot();
    buffer.remove_frame("a", false);
    set(buffer, "map", "b", kSecond, pose_of(2));
    CHECK_EQ(number_of(held.lookup_transform("map", "a").pose), 1.0);
    set(buffer, "map", "c", kSecond, pose_of(3));  // takes the slot of `a`
    CHECK_THROWS_AS(held.lookup_transform("map", "a"), SnapshotTooOld);
    CHECK_THROWS_AS(held.frames(), SnapshotTooOld);
    CHECK_EQ(number_of(buffer.lookup_transform("map", "b").pose), 2.0);
    CHECK_EQ(number_of(buffer.lookup_transform("map", "c").pose), 3.0);
}

TFDB_TEST(limits_memory_is_refused_and_nothing_lost) {
    Buffer buffer(with_memory(256 * 1024, std::nullopt));
    StampNs stamp = 0;
    const auto error = THROWN(CapacityExceeded, [&] {
        for (;; ++stamp)
            set(buffer, "map", "base", stamp, pose_of(static_cast<double>(stamp)));
    }());
    CHECK(error && says(*error, "memory limit of 262144 bytes"));
    if (engine() == Concurrency::kSnapshot || engine() == Concurrency::kGiant) {
        // A concurrent commit gets its number before it is refused.
        CHECK_EQ(buffer.commit(), static_cast<CommitNumber>(stamp));
    }
    CHECK(stamp >= 1000);
    for (StampNs s = 0; s < stamp; ++s)
        CHECK_EQ(number_of(buffer.lookup_transform("map", "base", s).pose), static_cast<double>(s));
    CHECK_EQ(buffer.samples("base").stamps.size(), static_cast<std::size_t>(stamp));
    // Smaller writes still fit, and removals free memory.
    set_static(buffer, "base", "eye", pose_of(5));
    buffer.remove_frame("base", true);
    set(buffer, "map", "arm", 1, pose_of(6));
    for (StampNs s = 2; s < 1000; ++s)
        set(buffer, "map", "arm", s, pose_of(static_cast<double>(s)));
    CHECK_EQ(buffer.frame_info("arm").samples, 999U);
}

TFDB_TEST(limits_memory_reached_amid_a_batch_undoes_all_of_it) {
    Buffer buffer(with_memory(64 * 1024, 1000));
    std::vector<std::string> names;
    for (int i = 0; i < 200; ++i)
        names.push_back("frame_" + std::to_string(i));
    std::vector<TransformView> batch;
    for (const std::string& name : names)
        batch.push_back({"map", name, 500, pose_of(1)});
    const std::span<const TransformView> all(batch);
    buffer.set_transforms(all.first(20), false, "");
    for (int i = 0; i < 3; ++i)
        CHECK_THROWS_AS(buffer.set_transforms(batch, false, ""), CapacityExceeded);
    CHECK_EQ(buffer.commit(), 1U);
    CHECK_EQ(buffer.frames().size(), 21U);
    for (int i = 0; i < 20; ++i)
        CHECK_EQ(buffer.frame_info(names[static_cast<std::size_t>(i)]).samples, 1U);
    buffer.set_transforms(all.subspan(20, 5), false, "");
    CHECK_EQ(buffer.frames().size(), 26U);
}

TFDB_TEST(limits_memory_with_a_short_history_never_runs_out) {
    Buffer buffer(with_memory(64 * 1024, 100));
    for (StampNs stamp = 0; stamp < 200'000; ++stamp)
        set(buffer, "map", "base", stamp, pose_of(static_cast<double>(stamp)));
    CHECK_EQ(buffer.frame_info("base").samples, 101U);
    CHECK(buffer.memory().used_bytes < 64 * 1024);
}

TFDB_TEST(limits_memory_per_sample_is_at_most_eighty_bytes) {
    Buffer buffer(keeping(std::nullopt));
    constexpr StampNs kSamples = 1 << 16;  // many segments
    const std::size_t before = buffer.memory().used_bytes;
    for (StampNs stamp = 0; stamp < kSamples; ++stamp)
        set(buffer, "map", "base", stamp, pose_of(1));
    const MemoryUse use = buffer.memory();
    CHECK_EQ(use.samples, static_cast<std::size_t>(kSamples));
    CHECK(use.used_bytes - before <= 80 * static_cast<std::size_t>(kSamples));
}

}  // namespace tfdb
