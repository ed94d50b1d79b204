// Overlapping held snapshots, so that one is held at any time. Memory stays bounded, and no
// snapshot loses data.
#include <deque>
#include <memory>

#include "tfdb/store/fixture.hpp"

namespace tfdb {
namespace {

using namespace fixture;

constexpr StampNs kHistory = 100;
constexpr int kCommits = 20'000;

/// The expected pose of `base` at one of its stamps.
double expected(StampNs stamp) {
    return static_cast<double>(stamp % 1000);
}

/// Commits while `overlap` snapshots are held, each for `overlap` commits. Returns the greatest
/// memory use after the first tenth.
std::size_t most_used(Buffer& buffer, std::size_t overlap) {
    struct Held {
        Snapshot snapshot;
        StampNs newest;
    };
    std::deque<Held> held;
    std::size_t most = 0;
    for (StampNs stamp = 0; stamp < kCommits; ++stamp) {
        set(buffer, "map", "base", stamp, pose_of(expected(stamp)));
        set(buffer, "map", "visitor" + std::to_string(stamp), stamp, pose_of(1));
        if (stamp >= 5)
            buffer.remove_frame("visitor" + std::to_string(stamp - 5), false);
        held.push_back({buffer.snapshot(), stamp});
        if (held.size() > overlap) {
            const Held& oldest = held.front();
            const StampNs first = std::max<StampNs>(0, oldest.newest - kHistory);
            for (const StampNs asked : {first, oldest.newest}) {
                CHECK_EQ(number_of(oldest.snapshot.lookup_transform("map", "base", asked).pose),
                         expected(asked));
            }
            CHECK_EQ(oldest.snapshot.frame_info("base").newest, oldest.newest);
            const std::string gone =
                "visitor" + std::to_string(std::max<StampNs>(0, oldest.newest - 4));
            CHECK_EQ(number_of(oldest.snapshot.lookup_transform("map", gone).pose), 1.0);
            held.pop_front();
        }
        if (stamp > kCommits / 10)
            most = std::max(most, buffer.memory().used_bytes);
    }
    return most;
}

}  // namespace

TFDB_TEST(pins_that_overlap_leave_memory_bounded) {
    Buffer none(keeping(kHistory));
    const std::size_t least = most_used(none, 0);
    for (const std::size_t overlap : {1U, 2U, 10U, 50U}) {
        Buffer buffer(keeping(kHistory));
        // A snapshot keeps the changes since the oldest one: at most twice the overlap.
        const std::size_t most = most_used(buffer, overlap);
        CHECK(most <= 2 * least + overlap * 4096);
        CHECK(buffer.memory().frames <= 16 + 8 * overlap);
    }
}

TFDB_TEST(pins_one_held_for_long_does_not_stop_what_it_does_not_need) {
    Buffer buffer(keeping(kHistory));
    for (StampNs stamp = 0; stamp < 1000; ++stamp)
        set(buffer, "map", "base", stamp, pose_of(expected(stamp)));
    const Snapshot held = buffer.snapshot();
    for (StampNs stamp = 1000; stamp < kCommits; ++stamp)
        set(buffer, "map", "base", stamp, pose_of(expected(stamp)));
    CHECK_EQ(held.frame_info("base").oldest, 999 - kHistory);
    CHECK_EQ(held.frame_info("base").samples, static_cast<std::uint64_t>(kHistory) + 1);
    for (StampNs stamp = 999 - kHistory; stamp < 1000; ++stamp)
        CHECK_EQ(number_of(held.lookup_transform("map", "base", stamp).pose), expected(stamp));
}

TFDB_TEST(pins_of_the_newest_state_do_not_stop_a_compaction) {
    Buffer buffer(keeping(std::nullopt));
    for (StampNs stamp = 0; stamp < 1000; ++stamp)
        set(buffer, "map", "burst", stamp, pose_of(expected(stamp)));
    buffer.remove_frame("burst", false);
    // Like a recorder: the next snapshot is opened before the last one is closed.
    std::deque<Snapshot> held;
    for (StampNs stamp = 0; stamp < 10; ++stamp) {
        set(buffer, "map", "base", stamp, pose_of(expected(stamp)));
        held.push_back(buffer.snapshot());
        if (held.size() > 1) {
            CHECK(!buffer.compact());
            held.pop_front();
        }
        CHECK(buffer.compact());
        CHECK_EQ(held.back().frame_info("base").samples, static_cast<std::uint64_t>(stamp) + 1);
    }
    // Beside a snapshot that stays open, the others count with their own commits.
    set(buffer, "map", "base", 10, pose_of(1));
    CHECK(!buffer.compact());
    CHECK_EQ(held.back().frame_info("base").newest, 9);
    held.push_back(buffer.snapshot());
    held.pop_front();
    CHECK(buffer.compact());
    CHECK_EQ(held.back().frame_info("base").newest, 10);
}

}  // namespace tfdb
