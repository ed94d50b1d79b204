// Removal of frames, frames of the same name again, reuse of slots and memory.
#include <algorithm>

#include "tfdb/store/fixture.hpp"
#include "tfdb/store/transaction.hpp"
#include "tfdb/testing/sanitized.hpp"

namespace tfdb {
namespace {

using namespace fixture;

/// map <- base <- arm <- hand, base <- eye, all moving.
void build(Buffer& buffer, StampNs stamp) {
    const TransformView batch[] = {{"map", "base", stamp, pose_of(1)},
                                   {"base", "arm", stamp, pose_of(2)},
                                   {"arm", "hand", stamp, pose_of(3)},
                                   {"base", "eye", stamp, pose_of(4)}};
    buffer.set_transforms(batch, false, "");
}

}  // namespace

TFDB_TEST(frames_leaf_is_removed_and_its_parent_may_go_next) {
    Buffer buffer(defaults());
    build(buffer, kSecond);
    CHECK_THROWS_AS(buffer.remove_frame("arm", false), FrameInUse);
    CHECK_EQ(buffer.remove_frame("hand", false), 2U);
    CHECK_EQ(buffer.remove_frame("arm", false), 3U);
    CHECK(buffer.frames() == std::vector<std::string>({"base", "eye", "map"}));
    CHECK_THROWS_AS(buffer.lookup_transform("map", "arm"), UnknownFrame);
    CHECK_THROWS_AS(buffer.remove_frame("arm", true), UnknownFrame);
    CHECK_EQ(number_of(buffer.lookup_transform("base", "eye").pose), 4.0);
}

TFDB_TEST(frames_recursive_removal_takes_the_subtree_in_one_commit) {
    Buffer buffer(defaults());
    build(buffer, kSecond);
    const Snapshot before = buffer.snapshot();
    CHECK_EQ(buffer.remove_frame("base", true), 2U);
    CHECK(buffer.frames() == std::vector<std::string>({"map"}));
    CHECK_EQ(before.frames().size(), 5U);
    CHECK_EQ(number_of(before.lookup_transform("arm", "hand").pose), 3.0);
    CHECK_EQ(buffer.remove_frame("map", false), 3U);
    CHECK(buffer.frames().empty());
}

TFDB_TEST(frames_name_made_again_is_a_new_frame) {
    Buffer buffer(defaults());
    build(buffer, kSecond);
    FrameHandle old;
    CHECK(buffer.find_frame("eye", old));
    // eye is a child of base only before 2 s: base is then the newest parent of arm alone.
    set(buffer, "map", "eye", 2 * kSecond, pose_of(5));
    set(buffer, "map", "arm", 2 * kSecond, pose_of(6));
    CHECK_EQ(number_of(buffer.lookup_transform("base", "eye", kSecond).pose), 4.0);
    const Snapshot before = buffer.snapshot();
    buffer.remove_frame("base", false);
    CHECK_THROWS_AS(buffer.lookup_transform("map", "eye", kSecond), Disconnected);
    CHECK_EQ(number_of(buffer.lookup_transform("map", "eye", 2 * kSecond).pose), 5.0);
    set(buffer, "map", "base", kSecond, pose_of(7));
    // The old samples name the removed frame, not the new frame of that name.
    CHECK_THROWS_AS(buffer.lookup_transform("base", "eye", kSecond), Disconnected);
    CHECK_EQ(buffer.frame_info("base").samples, 1U);
    CHECK_EQ(number_of(buffer.lookup_transform("map", "base", kSecond).pose), 7.0);
    CHECK_EQ(number_of(before.lookup_transform("map", "base", kSecond).pose), 1.0);
    CHECK_EQ(number_of(before.lookup_transform("base", "eye", kSecond).pose), 4.0);
    CHECK_EQ(before.frame_info("base").samples, 1U);
    CHECK(buffer.is_current(old));
}

TFDB_TEST(frames_edge_may_change_its_kind_after_removal) {
    Buffer buffer(defaults());
    set_static(buffer, "map", "door", pose_of(1));
    CHECK_THROWS_AS(set(buffer, "map", "door", kSecond, pose_of(2)), StaticConflict);
    buffer.remove_frame("door", false);
    set(buffer, "map", "door", kSecond, pose_of(2));
    CHECK(!buffer.frame_info("door").is_static);
    CHECK_THROWS_AS(set_static(buffer, "map", "door", pose_of(1)), StaticConflict);
}

TFDB_TEST(frames_clear_keeps_frames_and_static_edges) {
    Buffer buffer(defaults());
    build(buffer, 5 * kSecond);
    set_static(buffer, "hand", "tip", pose_of(9));
    const CommitNumber cleared = buffer.clear();
    CHECK_EQ(cleared, 3U);
    CHECK_EQ(buffer.frames().size(), 6U);
    CHECK_EQ(number_of(buffer.lookup_transform("hand", "tip").pose), 9.0);
    CHECK_THROWS_AS(buffer.lookup_transform("map", "hand"), Disconnected);
    CHECK_EQ(buffer.frame_info("base").samples, 0U);
    build(buffer, kSecond);  // older than what was cleared
    CHECK_EQ(buffer.lookup_transform("map", "tip").stamp, kSecond);
    CHECK_EQ(buffer.clear(), 5U);
    CHECK_EQ(buffer.remove_frame("base", false), 6U);  // it has no children left
}

TFDB_TEST(frames_slot_of_another_name_does_not_answer_for_the_old_handle) {
    Buffer buffer(defaults());
    set(buffer, "map", "ghost", kSecond, pose_of(1));
    FrameHandle ghost;
    FrameHandle map;
    CHECK(buffer.find_frame("ghost", ghost) && buffer.find_frame("map", map));
    buffer.remove_frame("ghost", false);
    set(buffer, "map", "heir", kSecond, pose_of(2));
    FrameHandle heir;
    CHECK(buffer.find_frame("heir", heir));
    CHECK_EQ(heir.id, ghost.id);
    CHECK(!buffer.is_current(ghost) && buffer.is_current(heir));
    Answer answer;
    Failure failure;
    CHECK(!buffer.ask(store::at_stamp(map, ghost, kSecond, {}), answer, failure));
    CHECK(failure.code == ErrorCode::kUnknownFrame && failure.argument == 1);
    CHECK(!buffer.ask(store::of_newest(ghost, map, {}, 0), answer, failure));
    CHECK(failure.code == ErrorCode::kUnknownFrame && failure.argument == 0);
    Question question{.kind = Question::kFull,
                      .target = {.handle = map},
                      .source = {.handle = map},
                      .fixed = {.handle = ghost}};
    CHECK(!buffer.ask(question, answer, failure));
    CHECK(failure.code == ErrorCode::kUnknownFrame && failure.argument == 2);
    question.kind = Question::kCommonTime;
    question.target.handle = ghost;
    CHECK(!buffer.ask(question, answer, failure));
    CHECK(buffer.ask(store::at_stamp(map, heir, kSecond, {}), answer, failure));
    CHECK_EQ(buffer.frame_name(heir.id, heir.generation), "heir");
    CHECK_EQ(buffer.frame_name(ghost.id, ghost.generation), "(removed)");
}

/// Also after the slot's generation, which has 20 bits, has wrapped around, as it does without a
/// sanitizer.
TFDB_TEST(frames_old_handle_never_fits_again) {
    Buffer buffer(defaults());
    set(buffer, "map", "ghost", kSecond, pose_of(1));
    FrameHandle first;
    CHECK(buffer.find_frame("ghost", first));
    FrameHandle last;
    for (int i = 0; i < testing::rounds(1 << kFrameBits) + 10; ++i) {
        buffer.remove_frame("ghost", false);
        set(buffer, "map", "ghost", kSecond + i, pose_of(1));
        CHECK(buffer.find_frame("ghost", last));
        CHECK(!buffer.is_current(first));
    }
    CHECK(testing::kSanitized || last.id != first.id);
    CHECK(buffer.is_current(last));
}

TFDB_TEST(frames_short_lived_one_after_another_leave_memory_flat) {
    Buffer buffer(defaults());
    std::size_t settled = 0;
    for (int i = 0; i < 100'000; ++i) {
        const std::string name = "visitor_" + std::to_string(i);
        set(buffer, "map", name, kSecond + i, pose_of(i));
        buffer.remove_frame(name, false);
        if (i == 1000)
            settled = buffer.memory().used_bytes;
    }
    const MemoryUse use = buffer.memory();
    CHECK(use.used_bytes <= settled + 4096);  // names grow by a digit or two, the table may rehash
    CHECK(use.frames <= 3);
    CHECK(buffer.frames() == std::vector<std::string>({"map"}));
    CHECK_EQ(buffer.commit(), 200'000U);
}

TFDB_TEST(frames_short_lived_by_the_thousand_leave_memory_flat) {
    Buffer buffer(defaults());
    std::size_t settled = 0;
    for (int round = 0; round < 100; ++round) {
        std::vector<std::string> names;
        std::vector<TransformView> batch;
        for (int i = 0; i < 1000; ++i)
            names.push_back("v" + std::to_string(100'000 + 1000 * round + i));
        for (const std::string& name : names)
            batch.push_back({"swarm", name, kSecond, pose_of(1)});
        batch.push_back({"map", "swarm", kSecond, pose_of(2)});
        buffer.set_transforms(batch, false, "");
        CHECK_EQ(buffer.frames().size(), 1002U);
        buffer.remove_frame("swarm", true);
        if (round == 5)
            settled = buffer.memory().used_bytes;
    }
    CHECK(buffer.memory().used_bytes <= settled + 64 * 1024);  // the name table's larger half
    CHECK(buffer.memory().frames <= 1002);
    CHECK(buffer.frames() == std::vector<std::string>({"map"}));
}

TFDB_TEST(frames_removed_while_a_snapshot_is_held_stay_readable_in_it) {
    Buffer buffer(defaults());
    build(buffer, kSecond);
    const Snapshot held = buffer.snapshot();
    buffer.remove_frame("base", true);
    for (int i = 0; i < 3000; ++i) {
        const std::string name = "n" + std::to_string(i % 7);
        set(buffer, "map", name, kSecond, pose_of(i));
        buffer.remove_frame(name, false);
    }
    CHECK_EQ(held.frames().size(), 5U);
    CHECK_EQ(number_of(held.lookup_transform("base", "eye", kSecond).pose), 4.0);
    CHECK_EQ(number_of(held.lookup_transform("arm", "hand", kSecond).pose), 3.0);
    CHECK_THROWS_AS(held.lookup_transform("map", "n3"), UnknownFrame);
}

TFDB_TEST(frames_inspection_tells_what_is_stored) {
    Buffer buffer(keeping(std::nullopt));
    set(buffer, "map", "base", 10, pose_of(1), "slam");
    set(buffer, "map", "base", 30, pose_of(2), "slam");
    set(buffer, "odom", "base", 20, pose_of(3), "wheels");
    set_static(buffer, "base", "eye", pose_of(4));
    const FrameInfo base = buffer.frame_info("base");
    CHECK_EQ(base.name, "base");
    CHECK_EQ(base.parent.value_or(""), "map");
    CHECK_EQ(base.samples, 3U);
    CHECK_EQ(base.oldest, 10);
    CHECK_EQ(base.newest, 30);
    CHECK_EQ(base.longest_gap, 10);
    CHECK_EQ(base.authority, "wheels");
    CHECK_EQ(base.late, 1U);
    CHECK(buffer.frame_info("eye").is_static && !buffer.frame_info("map").parent);
    const auto now = buffer.tree();
    const auto then = buffer.tree(20);
    CHECK_EQ(now.size(), 4U);
    CHECK_EQ(now[0].parent.value_or(""), "map");
    CHECK_EQ(then[0].parent.value_or(""), "odom");
    CHECK(buffer.samples("base").parents == std::vector<std::string>({"map", "odom", "map"}));
    CHECK(buffer.samples("eye").stamps == std::vector<StampNs>({-1}));
    const Snapshot held = buffer.snapshot();
    buffer.clear();
    CHECK(buffer.frame_info("base").cleared && !held.frame_info("base").cleared);
    CHECK(!buffer.frame_info("eye").cleared && !buffer.frame_info("map").cleared);
    set(buffer, "map", "base", 40, pose_of(5));
    CHECK(!buffer.frame_info("base").cleared);
}

TFDB_TEST(frames_before_their_first_sample_never_hang_under_themselves) {
    Buffer buffer(keeping(std::nullopt));
    set_static(buffer, "map", "odom", pose_of(1));
    set(buffer, "base", "map", 10, pose_of(2));  // map hangs under base, then under hand
    set(buffer, "hand", "map", 20, pose_of(3));
    set(buffer, "odom", "base", 30, pose_of(4));  // what base hangs under now, but not before
    const auto parents = [](const auto& reads, std::optional<StampNs> stamp) {
        std::string all;
        for (const FrameInfo& info : reads.tree(stamp)) {
            CHECK(reads.parent_of(info.name, stamp) == info.parent);
            all += info.name + "<" + info.parent.value_or("-") + " ";
        }
        return all;
    };
    const Snapshot held = buffer.snapshot();
    for (const StoreReader* reads :
         {static_cast<const StoreReader*>(&buffer), static_cast<const StoreReader*>(&held)}) {
        for (const StampNs stamp : {5, 10, 19}) {
            const char* const expected =
                stamp < 10 ? "base<- hand<- map<- odom<map " : "base<- hand<- map<base odom<map ";
            CHECK_EQ(parents(*reads, stamp), expected);
        }
        for (const StampNs stamp : {20, 29, 30, 99})
            CHECK_EQ(parents(*reads, stamp), "base<odom hand<- map<hand odom<map ");
        CHECK_EQ(parents(*reads, std::nullopt), "base<odom hand<- map<hand odom<map ");
    }
    set(buffer, "base", "tip", 30, pose_of(5));  // below the circle, not in it
    CHECK_EQ(buffer.parent_of("tip", 10).value_or(""), "base");
    Transaction tx(buffer);
    CHECK(!tx.parent_of("base", 10) && tx.parent_of("base", 30) == "odom");
    CHECK(tx.parent_of("map", 10) == "base" && tx.parent_of("tip", 10) == "base");
}

TFDB_TEST(frames_reach_tells_which_edge_has_no_data) {
    Buffer buffer(keeping(std::nullopt));
    set(buffer, "map", "odom", 10, pose_of(1));
    set(buffer, "map", "odom", 30, pose_of(2));
    set(buffer, "odom", "base", 20, pose_of(3));
    set_static(buffer, "base", "eye", pose_of(4));
    set(buffer, "world", "arm", 20, pose_of(5));
    const auto is_gap = [](const Reach& reach, std::string_view edge, StampNs oldest,
                           StampNs newest) {
        return reach.end == Reach::kGap && reach.edge == edge && reach.oldest == oldest &&
               reach.newest == newest;
    };
    for (const auto& [target, source] : {std::pair("map", "eye"), std::pair("eye", "map")}) {
        CHECK(buffer.reach(target, source, 20).end == Reach::kMet);
        const Reach latest = buffer.reach(target, source, {});
        CHECK(latest.end == Reach::kMet && latest.stamp == 20);
        CHECK(is_gap(buffer.reach(target, source, 25), "base", 20, 20));
        CHECK(is_gap(buffer.reach(target, source, -1), "base", 20, 20));
    }
    CHECK(buffer.reach("base", "eye", -1).end == Reach::kMet);
    CHECK(buffer.reach("eye", "eye", 99).end == Reach::kMet);
    CHECK(is_gap(buffer.reach("map", "odom", 40), "odom", 10, 30));
    CHECK(buffer.reach("arm", "eye", 20).end == Reach::kApart);
    CHECK(buffer.reach("arm", "eye", {}).end == Reach::kApart);
    CHECK(is_gap(buffer.reach("arm", "eye", 30), "arm", 20, 20));
    CHECK(is_gap(buffer.reach("world", "eye", 30), "base", 20, 20));
    // The walk from the source continues above the frame at which the two could meet.
    set(buffer, "odom", "lamp", 40, pose_of(6));
    set(buffer, "odom", "lamp", 50, pose_of(6));
    CHECK(buffer.reach("base", "lamp", 40).end == Reach::kGap);
    set(buffer, "lamp", "bulb", 40, pose_of(7));
    CHECK(buffer.reach("lamp", "bulb", 40).end == Reach::kMet);
    CHECK(buffer.reach("map", "ghost", 20).end == Reach::kNowhere);
    CHECK(buffer.reach("ghost", "ghost", {}).end == Reach::kNowhere);
    const Snapshot held = buffer.snapshot();
    buffer.clear();
    CHECK(is_gap(buffer.reach("map", "eye", 20), "base", -1, -1));
    CHECK(held.reach("map", "eye", 20).end == Reach::kMet);
}

}  // namespace tfdb
