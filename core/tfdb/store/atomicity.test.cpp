// A commit is all or nothing, at every position of the bad member in the batch.
#include <algorithm>
#include <functional>
#include <limits>

#include "tfdb/store/fixture.hpp"

namespace tfdb {
namespace {

using namespace fixture;

struct Bad {
    const char* name;
    TransformView transform;
    ErrorCode code;
};

const std::string kLongName(2000, 'x');

std::vector<Bad> bad_members() {
    Pose nan = pose_of(1);
    nan.translation.y = std::numeric_limits<double>::quiet_NaN();
    Pose zero = pose_of(1);
    zero.rotation = {0, 0, 0, 0};
    return {
        {"not finite", {"map", "base", 50 * kSecond, nan}, ErrorCode::kInvalidTransform},
        {"zero quaternion", {"map", "base", 50 * kSecond, zero}, ErrorCode::kInvalidTransform},
        {"own parent", {"new", "new", 50 * kSecond, pose_of(1)}, ErrorCode::kInvalidTransform},
        {"name", {"map", kLongName, 50 * kSecond, pose_of(1)}, ErrorCode::kInvalidName},
        {"stamp", {"map", "base", -5, pose_of(1)}, ErrorCode::kInvalidStamp},
        {"too old", {"map", "base", 1, pose_of(1)}, ErrorCode::kTooOld},
        {"static edge", {"base", "camera", kSecond, pose_of(1)}, ErrorCode::kStaticConflict},
        {"cycle", {"camera", "map", 50 * kSecond, pose_of(1)}, ErrorCode::kCycle},
    };
}

/// Valid members that make frames, extend an edge, come late, correct, and re-parent.
std::vector<TransformView> good_members() {
    return {{"map", "fresh", 50 * kSecond, pose_of(21)},
            {"fresh", "fresher", 50 * kSecond, pose_of(22)},
            {"map", "base", 49 * kSecond, pose_of(23)},
            {"map", "base", 50 * kSecond, pose_of(24)},
            {"map", "base", 40 * kSecond + 1, pose_of(25)},
            {"map", "base", 45 * kSecond, pose_of(26)},
            {"odom", "wheel", 50 * kSecond, pose_of(27)},
            {"map", "wheel", 51 * kSecond, pose_of(28)}};
}

Buffer robot() {
    Buffer buffer(keeping(10 * kSecond));
    for (StampNs stamp = 40; stamp < 48; ++stamp)
        set(buffer, "map", "base", stamp * kSecond, pose_of(static_cast<double>(stamp)));
    set(buffer, "map", "wheel", 47 * kSecond, pose_of(7));
    set_static(buffer, "base", "camera", pose_of(3));
    return buffer;
}

struct Picture {
    CommitNumber commit;
    std::vector<std::string> frames;
    std::vector<Samples> samples;
    std::vector<std::uint64_t> late;

    explicit Picture(const Buffer& buffer) : commit(buffer.commit()), frames(buffer.frames()) {
        for (const std::string& frame : frames) {
            samples.push_back(buffer.samples(frame));
            late.push_back(buffer.frame_info(frame).late);
        }
    }
    [[nodiscard]] bool same(const Picture& other) const {
        if (commit != other.commit || frames != other.frames || late != other.late)
            return false;
        for (std::size_t i = 0; i < samples.size(); ++i) {
            if (samples[i].stamps != other.samples[i].stamps ||
                samples[i].parents != other.samples[i].parents ||
                !std::equal(samples[i].poses.begin(), samples[i].poses.end(),
                            other.samples[i].poses.begin(), identical)) {
                return false;
            }
        }
        return true;
    }
};

}  // namespace

TFDB_TEST(atomicity_one_bad_member_anywhere_stores_nothing) {
    Buffer buffer = robot();
    const Picture before(buffer);
    for (const Bad& bad : bad_members()) {
        for (std::size_t at = 0; at <= good_members().size(); ++at) {
            auto batch = good_members();
            batch.insert(batch.begin() + static_cast<long>(at), bad.transform);
            const auto error = THROWN(Error, buffer.set_transforms(batch, false, "ekf"));
            CHECK(error && error->code() == bad.code);
            CHECK(error && error->detail().index == at);
            CHECK(before.same(Picture(buffer)));
        }
    }
    CHECK_THROWS_AS(buffer.lookup_transform("map", "fresh"), UnknownFrame);
    CHECK_EQ(buffer.set_transforms(good_members(), false, "ekf"), before.commit + 1);
    CHECK_EQ(number_of(buffer.lookup_transform("map", "base", 45 * kSecond).pose), 26.0);
    CHECK_EQ(number_of(buffer.lookup_transform("map", "fresh").pose), 21.0);
}

TFDB_TEST(atomicity_aborted_frames_do_not_exist_and_cost_nothing) {
    Buffer buffer = robot();
    const std::size_t frames = buffer.frames().size();
    std::size_t used = 0;
    for (int i = 0; i < 2000; ++i) {
        const std::string name = "ghost_" + std::to_string(i);
        const std::string below = name + "_";
        const TransformView batch[] = {{"map", name, 50 * kSecond, pose_of(1)},
                                       {name, below, 50 * kSecond, pose_of(1)},
                                       {"camera", "map", 50 * kSecond, pose_of(1)}};
        CHECK_THROWS_AS(buffer.set_transforms(batch, false, ""), CycleError);
        FrameHandle handle;
        CHECK(!buffer.find_frame(name, handle));
        if (i == 100)
            used = buffer.memory().used_bytes;
    }
    CHECK_EQ(buffer.frames().size(), frames);
    CHECK(buffer.memory().used_bytes <= used + 8 * 1024);
    CHECK(buffer.memory().frames <= frames + 2);
}

TFDB_TEST(atomicity_members_of_one_batch_meet_the_later_one_wins) {
    Buffer buffer(keeping(std::nullopt));
    const TransformView batch[] = {{"map", "base", 30, pose_of(1)},
                                   {"map", "base", 10, pose_of(2)},
                                   {"odom", "base", 20, pose_of(3)},
                                   {"map", "base", 10, pose_of(4)},
                                   {"map", "base", 20, pose_of(5)}};
    CHECK_EQ(buffer.set_transforms(batch, false, ""), 1U);
    const Samples samples = buffer.samples("base");
    CHECK(samples.stamps == std::vector<StampNs>({10, 20, 30}));
    CHECK(samples.parents == std::vector<std::string>({"map", "map", "map"}));
    CHECK_EQ(number_of(samples.poses[0]), 4.0);
    CHECK_EQ(number_of(samples.poses[1]), 5.0);
    CHECK_EQ(number_of(samples.poses[2]), 1.0);
    const TransformView statics[] = {{"base", "eye", 0, pose_of(6)},
                                     {"base", "eye", 0, pose_of(7)}};
    buffer.set_transforms(statics, true, "");
    CHECK_EQ(number_of(buffer.lookup_transform("base", "eye").pose), 7.0);
}

TFDB_TEST(atomicity_an_empty_batch_is_no_commit) {
    Buffer buffer = robot();
    const CommitNumber before = buffer.commit();
    CHECK_EQ(buffer.set_transforms({}, false, ""), before);
    const WriteResult result = buffer.write({.is_static = true, .wait = false});
    CHECK(!result.busy);
    CHECK_EQ(result.commit, before);
    CHECK_EQ(buffer.commit(), before);
}

TFDB_TEST(atomicity_a_batch_of_many_frames_takes_no_square_time) {
    constexpr std::size_t kFrames = 200'000;
    std::vector<std::string> names;
    std::vector<TransformView> batch;
    for (std::size_t i = 0; i < kFrames; ++i)
        names.push_back("f" + std::to_string(i));
    for (const std::string& name : names)
        batch.push_back({"map", name, 0, pose_of(1)});
    Buffer buffer(defaults());
    CHECK_EQ(buffer.set_transforms(batch, true, ""), 1U);
    CHECK_EQ(buffer.memory().frames, kFrames + 1);
}

}  // namespace tfdb
