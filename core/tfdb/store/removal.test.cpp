// Many frames removed in one call: all or none, in any order.
#include <algorithm>
#include <random>

#include "tfdb/store/fixture.hpp"

namespace tfdb {
namespace {

using namespace fixture;
using Names = std::vector<std::string_view>;

/// map <- base <- arm <- hand, base <- eye, all moving; space <- moon is static.
Buffer robot() {
    Buffer buffer(defaults());
    const TransformView batch[] = {{"map", "base", kSecond, pose_of(1)},
                                   {"base", "arm", kSecond, pose_of(2)},
                                   {"arm", "hand", kSecond, pose_of(3)},
                                   {"base", "eye", kSecond, pose_of(4)}};
    buffer.set_transforms(batch, false, "");
    set_static(buffer, "space", "moon", pose_of(5));
    return buffer;
}

std::vector<std::size_t> indices(const Error& error) {
    std::vector<std::size_t> found;
    for (const RefusedMember& member : error.detail().refused)
        found.push_back(member.index);
    return found;
}

}  // namespace

TFDB_TEST(removal_takes_parents_and_children_in_any_order) {
    Names names = {"base", "arm", "hand", "eye"};
    std::sort(names.begin(), names.end());
    do {
        Buffer buffer = robot();
        const Snapshot before = buffer.snapshot();
        CHECK_EQ(buffer.remove_frames(names, false), 3U);
        CHECK(buffer.frames() == std::vector<std::string>({"map", "moon", "space"}));
        CHECK_EQ(number_of(buffer.lookup_transform("space", "moon").pose), 5.0);
        CHECK_THROWS_AS(buffer.lookup_transform("map", "base"), UnknownFrame);
        CHECK(apart(before.lookup_transform("eye", "base", kSecond).pose,
                    geometry::inverse(pose_of(4))) < 1e-12);
        CHECK_EQ(before.frames().size(), 7U);
        CHECK_EQ(buffer.remove_frame("map", false), 4U);
    } while (std::next_permutation(names.begin(), names.end()));
}

TFDB_TEST(removal_names_everything_that_cannot_go) {
    Buffer buffer = robot();
    set(buffer, "base", "ear", kSecond, pose_of(6));
    const Names names = {"hand", "nil", "base", "hand", "moon", "map", "nil", "arm"};
    const auto error = THROWN(UnknownFrame, buffer.remove_frames(names, false));
    CHECK(error && indices(*error) == std::vector<std::size_t>({1, 2, 6}));
    CHECK(error && error->detail().index == 1 && error->detail().frame == "nil");
    CHECK(error && says(*error, "3 of 8 frames were refused, the first at index 1: frame 'nil'"));
    CHECK(error && error->detail().refused[1].code == ErrorCode::kFrameInUse);
    // arm is removed as well, so it does not keep base.
    const std::string& kept = error->detail().refused[1].message;
    CHECK(kept.find("'ear', 'eye'") != std::string::npos ||
          kept.find("'eye', 'ear'") != std::string::npos);
    CHECK(kept.find("'arm'") == std::string::npos);
    CHECK(buffer.commit() == 3 && buffer.frames().size() == 8);
    CHECK_EQ(number_of(buffer.lookup_transform("arm", "hand").pose), 3.0);
    const auto used =
        THROWN(FrameInUse, buffer.remove_frames(std::span(names).subspan(2, 4), false));
    CHECK(used && indices(*used) == std::vector<std::size_t>({0}));
    CHECK(used && used->detail().frames.size() == 3 && says(*used, "recursive=True"));
    const auto unknown = THROWN(UnknownFrame, buffer.remove_frames(names, true));
    CHECK(unknown && indices(*unknown) == std::vector<std::size_t>({1, 6}));
    CHECK(buffer.commit() == 3 && buffer.frames().size() == 8);
}

TFDB_TEST(removal_counts_a_name_that_comes_twice_once) {
    Buffer buffer = robot();
    const Names twice = {"hand", "moon", "hand", "arm", "moon"};
    CHECK_EQ(buffer.remove_frames(twice, false), 3U);
    CHECK(buffer.frames() == std::vector<std::string>({"base", "eye", "map", "space"}));
    CHECK_EQ(buffer.remove_frame("space", false), 4U);
    CHECK_EQ(buffer.remove_frame("eye", false), 5U);
    CHECK_EQ(buffer.remove_frame("base", false), 6U);
}

TFDB_TEST(removal_of_nothing_commits_nothing) {
    Buffer buffer = robot();
    CHECK_EQ(buffer.remove_frames({}, true), 2U);
    CHECK_EQ(buffer.commit(), 2U);
    const Names nil = {"nil"};
    CHECK_THROWS_AS(buffer.remove_frames(nil, true), UnknownFrame);
    CHECK_EQ(buffer.commit(), 2U);
}

TFDB_TEST(removal_with_all_below_takes_overlapping_trees) {
    Buffer buffer = robot();
    const Names names = {"arm", "base", "hand", "moon"};
    CHECK_EQ(buffer.remove_frames(names, true), 3U);
    CHECK(buffer.frames() == std::vector<std::string>({"map", "space"}));
}

TFDB_TEST(removal_goes_by_newest_parents) {
    Buffer buffer(keeping(std::nullopt));
    set(buffer, "dock", "cart", 10, pose_of(1));
    set(buffer, "truck", "cart", 20, pose_of(2));
    const Names old = {"dock"};
    CHECK_EQ(buffer.remove_frames(old, false), 3U);
    CHECK_THROWS_AS(buffer.lookup_transform("truck", "cart", 15), Disconnected);
    CHECK_EQ(number_of(buffer.lookup_transform("truck", "cart", 20).pose), 2.0);
    const Names parent = {"truck"};
    CHECK_THROWS_AS(buffer.remove_frames(parent, false), FrameInUse);
    set(buffer, "hall", "cart", 15, pose_of(3));  // late: the newest parent stays
    CHECK_THROWS_AS(buffer.remove_frames(parent, false), FrameInUse);
    CHECK_EQ(buffer.remove_frames(parent, true), 5U);
    CHECK(buffer.frames() == std::vector<std::string>({"hall"}));
}

TFDB_TEST(removal_gives_memory_back_at_once) {
    Buffer buffer(defaults());
    set(buffer, "map", "stays", kSecond, pose_of(1));
    const std::size_t before = buffer.memory().used_bytes;
    for (StampNs i = 0; i < 1000; ++i)
        set(buffer, "map", "goes", kSecond + i, pose_of(2));
    CHECK(buffer.memory().used_bytes > before + 50'000);
    buffer.remove_frame("goes", false);
    CHECK_EQ(buffer.memory().used_bytes, before);
    CHECK_EQ(number_of(buffer.lookup_transform("map", "stays").pose), 1.0);
    // While a snapshot is held, the memory stays. The first removal afterwards frees it.
    {
        const Snapshot held = buffer.snapshot();
        set(buffer, "map", "goes", kSecond, pose_of(3));
        const Snapshot with = buffer.snapshot();
        buffer.remove_frame("goes", false);
        CHECK(buffer.memory().used_bytes > before);
        CHECK_EQ(number_of(with.lookup_transform("map", "goes").pose), 3.0);
        CHECK_THROWS_AS(held.lookup_transform("map", "goes"), UnknownFrame);
    }
    set(buffer, "map", "short", kSecond, pose_of(4));
    buffer.remove_frame("short", false);
    CHECK_EQ(buffer.memory().used_bytes, before);
}

TFDB_TEST(removal_in_bulk_agrees_with_one_by_one) {
    constexpr unsigned kSeed = 3;
    std::mt19937 random(kSeed);
    std::printf("  seed %u\n", kSeed);
    for (int round = 0; round < 200; ++round) {
        Buffer bulk(defaults());
        Buffer single(defaults());
        std::vector<std::string> names;
        for (unsigned i = 0; i < 12; ++i)
            names.push_back("n" + std::to_string(i));
        for (std::size_t i = 1; i < names.size(); ++i) {
            const std::string& parent = names[random() % i];
            set(bulk, parent, names[i], kSecond, pose_of(static_cast<double>(i)));
            set(single, parent, names[i], kSecond, pose_of(static_cast<double>(i)));
        }
        Names chosen;
        for (const std::string& name : names) {
            if (random() % 3 == 0)
                chosen.push_back(name);
        }
        std::shuffle(chosen.begin(), chosen.end(), random);
        const bool recursive = random() % 2 == 0;
        bool stored = true;
        try {
            bulk.remove_frames(chosen, recursive);
        } catch (const FrameInUse&) {
            stored = false;
        }
        // From the leaves upward: frames that were made later are descendants.
        std::sort(chosen.begin(), chosen.end(), [](std::string_view a, std::string_view b) {
            return a.size() != b.size() ? a.size() > b.size() : a > b;
        });
        bool possible = true;
        for (const std::string_view name : chosen) {
            try {
                single.remove_frame(name, recursive);
            } catch (const FrameInUse&) {
                possible = false;
            } catch (const UnknownFrame&) {
                CHECK(recursive);
            }
        }
        CHECK_EQ(stored, possible);
        if (stored)
            CHECK(bulk.frames() == single.frames());
        else
            CHECK_EQ(bulk.frames().size(), names.size());
    }
}

}  // namespace tfdb
