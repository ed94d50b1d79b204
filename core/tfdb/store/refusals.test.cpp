// Batches with invalid members: the error names each, and `partial` stores the valid ones.
#include <algorithm>
#include <limits>

#include "tfdb/store/fixture.hpp"

namespace tfdb {
namespace {

using namespace fixture;
using Indices = std::vector<std::size_t>;

/// map <- base <- arm <- hand move from 40 s to 47 s, hand <- tip is static; history 10 s.
Buffer robot() {
    Buffer buffer(keeping(10 * kSecond));
    for (StampNs stamp = 40; stamp < 48; ++stamp) {
        const TransformView batch[] = {{"map", "base", stamp * kSecond, pose_of(1)},
                                       {"base", "arm", stamp * kSecond, pose_of(2)},
                                       {"arm", "hand", stamp * kSecond, pose_of(3)}};
        buffer.set_transforms(batch, false, "driver");
    }
    set_static(buffer, "hand", "tip", pose_of(4));
    return buffer;
}

/// The store's whole visible state, except memory.
std::string picture(const Buffer& buffer) {
    std::string text = std::to_string(buffer.commit()) + " " +
                       std::to_string(buffer.memory().samples) + " " +
                       std::to_string(buffer.counters().normalised);
    for (const FrameInfo& info : buffer.tree()) {
        text += " " + info.name + "<" + info.parent.value_or("-") + ":" + info.authority + "+" +
                std::to_string(info.late);
        const Samples samples = buffer.samples(info.name);
        for (std::size_t i = 0; i < samples.poses.size(); ++i) {
            text += "," + std::to_string(samples.stamps[i]) + "@" + samples.parents[i] + "=" +
                    std::to_string(number_of(samples.poses[i]));
        }
    }
    return text;
}

Indices indices(const std::vector<RefusedMember>& refused) {
    Indices found;
    for (const RefusedMember& member : refused)
        found.push_back(member.index);
    return found;
}

/// Checks that the whole batch is refused without a change. Edges may grow in the attempt, but not
/// again in the next one.
template <class E>
std::vector<RefusedMember> refused(Buffer& buffer, std::span<const TransformView> batch,
                                   bool is_static = false) {
    const std::string before = picture(buffer);
    const auto error = THROWN(E, buffer.set_transforms(batch, is_static, "ekf"));
    CHECK(picture(buffer) == before);
    const MemoryUse use = buffer.memory();
    CHECK_THROWS_AS(buffer.set_transforms(batch, is_static, "ekf"), E);
    CHECK_EQ(buffer.memory().used_bytes, use.used_bytes);
    CHECK_EQ(buffer.memory().frames, use.frames);
    CHECK(picture(buffer) == before);
    if (!error)
        return {};
    const auto& members = error->detail().refused;
    CHECK(!members.empty() && members.front().code == error->code());
    CHECK(!members.empty() && members.front().index == error->detail().index);
    CHECK_EQ(error->detail().authority, "ekf");
    if (members.size() > 1)
        CHECK(says(*error, std::to_string(members.size()) + " of " + std::to_string(batch.size()) +
                               " transforms were refused"));
    CHECK(!members.empty() && says(*error, members.front().message));
    return members;
}

/// The refused members of a batch that is stored with `partial`.
std::vector<RefusedMember> left_out(Buffer& buffer, std::span<const TransformView> batch,
                                    bool is_static = false) {
    const CommitNumber before = buffer.commit();
    const WriteResult result = buffer.write(
        {.transforms = batch, .is_static = is_static, .authority = "ekf", .partial = true});
    CHECK_EQ(result.commit, buffer.commit());
    CHECK_EQ(result.commit, before + (result.refused.size() < batch.size() ? 1U : 0U));
    return result.refused;
}

const std::string kLongName(2000, 'x');

/// Unsorted, with valid members between: 1 to 9 are invalid, each for another reason.
std::vector<TransformView> mixed_batch() {
    Pose nan = pose_of(1);
    nan.translation.y = std::numeric_limits<double>::quiet_NaN();
    Pose zero = pose_of(1);
    zero.rotation = {0, 0, 0, 0};
    return {
        {"map", "base", 49 * kSecond, pose_of(21)},
        {"map", "base", 50 * kSecond, nan},
        {"new", "new", 50 * kSecond, pose_of(22)},
        {"map", kLongName, 50 * kSecond, pose_of(23)},
        {"map", "base", -5, pose_of(24)},
        {"map", "base", 1, pose_of(25)},
        {"hand", "tip", 50 * kSecond, pose_of(26)},
        {"tip", "base", 50 * kSecond, pose_of(27)},
        {"map", "base", 50 * kSecond, zero},
        {"", "base", 50 * kSecond, pose_of(28)},
        {"map", "fresh", 50 * kSecond, pose_of(29)},
        {"map", "base", 48 * kSecond, pose_of(30)},
        {"map", "base", 49 * kSecond, pose_of(31)},
    };
}
const Indices kBad = {1, 2, 3, 4, 5, 6, 7, 8, 9};
constexpr ErrorCode kCodes[] = {ErrorCode::kInvalidTransform,
                                ErrorCode::kInvalidTransform,
                                ErrorCode::kInvalidName,
                                ErrorCode::kInvalidStamp,
                                ErrorCode::kTooOld,
                                ErrorCode::kStaticConflict,
                                ErrorCode::kCycle,
                                ErrorCode::kInvalidTransform,
                                ErrorCode::kInvalidName};
constexpr const char* kTexts[] = {"translation is not finite",
                                  "its own parent",
                                  "longer than 1024",
                                  "stamp -5 ns",
                                  "retained history",
                                  "is static",
                                  "its own ancestor",
                                  "squared norm of 0",
                                  "is empty"};

void check_mixed(const std::vector<RefusedMember>& members) {
    CHECK(indices(members) == kBad);
    for (std::size_t i = 0; i < members.size() && i < kBad.size(); ++i) {
        CHECK(members[i].code == kCodes[i]);
        CHECK(members[i].message.find(kTexts[i]) != std::string::npos);
        CHECK(members[i].message.find("from 'ekf'") != std::string::npos);
    }
    CHECK_EQ(members.at(0).reason, "its translation is not finite");
    CHECK_EQ(members.at(8).reason, "is empty");
}

}  // namespace

TFDB_TEST(refusals_name_every_bad_member_in_order) {
    Buffer buffer = robot();
    const auto batch = mixed_batch();
    check_mixed(refused<InvalidTransform>(buffer, batch));
    const std::span<const TransformView> all(batch);
    CHECK(indices(refused<InvalidStamp>(buffer, all.subspan(4, 4))) == Indices({0, 1, 2, 3}));
    CHECK(indices(refused<CycleError>(buffer, all.subspan(7, 1))) == Indices({0}));
    CHECK(!indices(refused<StaticConflict>(buffer, batch, true)).empty());
    const auto one = THROWN(TooOld, buffer.set_transforms(all.subspan(5, 1), false, "ekf"));
    CHECK(one && one->detail().newest == 47 * kSecond && one->detail().limit == 10 * kSecond);
    CHECK(one && one->detail().refused.size() == 1 &&
          one->what() == one->detail().refused[0].message);
}

TFDB_TEST(refusals_partial_stores_the_others_in_one_commit) {
    Buffer buffer = robot();
    const Snapshot before = buffer.snapshot();
    check_mixed(left_out(buffer, mixed_batch()));
    CHECK_EQ(number_of(buffer.lookup_transform("map", "base", 48 * kSecond).pose), 30.0);
    // Of the same stamp the later member counts.
    CHECK_EQ(number_of(buffer.lookup_transform("map", "base", 49 * kSecond).pose), 31.0);
    CHECK(apart(buffer.lookup_transform("fresh", "map").pose, geometry::inverse(pose_of(29))) <
          1e-12);
    CHECK_EQ(buffer.frame_info("base").authority, "ekf");
    CHECK_EQ(buffer.frame_info("arm").authority, "driver");
    CHECK(buffer.samples("base").stamps.back() == 49 * kSecond);
    CHECK_EQ(buffer.frames().size(), before.frames().size() + 1);
    CHECK_THROWS_AS(before.lookup_transform("map", "fresh"), UnknownFrame);
}

TFDB_TEST(refusals_partial_of_bad_ones_only_commits_nothing) {
    Buffer buffer = robot();
    const std::string before = picture(buffer);
    const auto batch = mixed_batch();
    CHECK_EQ(left_out(buffer, std::span(batch).subspan(1, 9)).size(), 9U);
    CHECK(picture(buffer) == before);
    CHECK(left_out(buffer, {}).empty());
    CHECK(picture(buffer) == before);
    const TransformView good[] = {{"map", "base", 48 * kSecond, pose_of(5)}};
    CHECK(left_out(buffer, good).empty());
}

TFDB_TEST(refusals_of_a_cycle_take_the_last_member_that_closes_it) {
    const TransformView pair[] = {{"a", "b", kSecond, pose_of(1)}, {"b", "a", kSecond, pose_of(2)}};
    const TransformView ring[] = {{"x", "y", 3, pose_of(1)},   {"map", "z", 3, pose_of(2)},
                                  {"y", "z", 9, pose_of(3)},   {"z", "x", 5, pose_of(4)},
                                  {"map", "w", 3, pose_of(5)}, {"w", "v", 3, pose_of(6)}};
    for (const bool is_static : {false, true}) {
        Buffer buffer(defaults());
        CHECK(indices(refused<CycleError>(buffer, pair, is_static)) == Indices({1}));
        CHECK(indices(left_out(buffer, pair, is_static)) == Indices({1}));
        CHECK_EQ(number_of(buffer.lookup_transform("a", "b").pose), 1.0);
        CHECK(indices(left_out(buffer, ring, is_static)) == Indices({3}));
    }
    // A frame that already has children: the walk finds the cycle at another position.
    Buffer buffer(defaults());
    set(buffer, "b", "c", kSecond, pose_of(3));
    set(buffer, "a", "d", kSecond, pose_of(3));
    CHECK(indices(left_out(buffer, pair)) == Indices({1}));
    CHECK_EQ(number_of(buffer.lookup_transform("a", "b", kSecond).pose), 1.0);
}

TFDB_TEST(refusals_of_cycles_spare_what_the_whole_batch_makes_good) {
    Buffer buffer = robot();
    // base and arm swap places: each member alone would close a cycle.
    const TransformView swap[] = {{"arm", "base", 48 * kSecond, pose_of(11)},
                                  {"map", "arm", 48 * kSecond, pose_of(12)}};
    CHECK(left_out(buffer, swap).empty());
    CHECK_EQ(number_of(buffer.lookup_transform("map", "arm", 48 * kSecond).pose), 12.0);
    CHECK_EQ(number_of(buffer.lookup_transform("arm", "base", 48 * kSecond).pose), 11.0);
    CHECK_EQ(number_of(buffer.lookup_transform("base", "arm", 47 * kSecond).pose), 2.0);
    // Without the second member, which is too old, the first one closes a cycle.
    Buffer again = robot();
    const TransformView half[] = {{"arm", "base", 48 * kSecond, pose_of(11)},
                                  {"map", "arm", 8 * kSecond, pose_of(12)},
                                  {"map", "base", 47 * kSecond + 5, pose_of(13)}};
    const auto members = left_out(again, half);
    CHECK(indices(members) == Indices({0, 1}));
    CHECK(members[0].code == ErrorCode::kCycle && members[1].code == ErrorCode::kTooOld);
    CHECK_EQ(number_of(again.lookup_transform("map", "base", 47 * kSecond + 5).pose), 13.0);
}

TFDB_TEST(refusals_of_cycles_concern_the_stamps_at_which_they_close) {
    Buffer buffer = robot();
    // hand is a child of base from 48 s to 50 s. Only then arm may be a child of hand.
    const TransformView batch[] = {{"base", "hand", 48 * kSecond, pose_of(1)},
                                   {"arm", "hand", 50 * kSecond, pose_of(2)},
                                   {"hand", "arm", 47 * kSecond + 1, pose_of(3)},
                                   {"hand", "arm", 49 * kSecond, pose_of(4)},
                                   {"base", "arm", 50 * kSecond, pose_of(5)}};
    // From 47 s to 48 s each would be a child of the other. 49 s is in the same batch but not in
    // the cycle.
    const auto members = left_out(buffer, batch);
    CHECK(indices(members) == Indices({2}));
    CHECK_EQ(number_of(buffer.lookup_transform("hand", "arm", 49 * kSecond).pose), 4.0);
    CHECK_EQ(number_of(buffer.lookup_transform("arm", "hand", 50 * kSecond).pose), 2.0);
    CHECK_EQ(number_of(buffer.lookup_transform("base", "arm", 47 * kSecond).pose), 2.0);
}

TFDB_TEST(refusals_of_many_cycles_at_once) {
    constexpr std::size_t kPairs = 5000;
    Buffer buffer(defaults());
    std::vector<std::string> names;
    for (std::size_t i = 0; i < 2 * kPairs; ++i)
        names.push_back("f" + std::to_string(i));
    std::vector<TransformView> batch;
    for (std::size_t i = 0; i < kPairs; ++i)
        batch.push_back({names[2 * i], names[2 * i + 1], kSecond, pose_of(1)});
    for (std::size_t i = 0; i < kPairs; ++i)
        batch.push_back({names[2 * i + 1], names[2 * i], kSecond, pose_of(2)});
    const auto members = left_out(buffer, batch);
    CHECK_EQ(members.size(), kPairs);
    CHECK(members.front().index == kPairs && members.back().index == 2 * kPairs - 1);
    CHECK_EQ(buffer.frames().size(), 2 * kPairs);
    CHECK_EQ(number_of(buffer.lookup_transform("f4242", "f4243").pose), 1.0);
}

TFDB_TEST(refusals_of_cycles_that_show_one_after_another) {
    // A chain of frames, each of which becomes a child of the chain's end. Without one of them the
    // next one up closes a cycle, so all are refused.
    constexpr int kLinks = 200;
    Buffer buffer(defaults());
    const auto name = [](int i) { return "link" + std::to_string(i); };
    std::vector<std::string> names;
    for (int i = 0; i <= kLinks; ++i)
        names.push_back(name(i));
    for (std::size_t i = 0; i < kLinks; ++i)
        set(buffer, names[i], names[i + 1], kSecond, pose_of(static_cast<double>(i)));
    std::vector<TransformView> batch{{"map", "other", 2 * kSecond, pose_of(7)}};
    for (std::size_t i = 0; i < kLinks; ++i)
        batch.push_back({names[kLinks], names[i], 2 * kSecond, pose_of(1)});
    const std::string before = picture(buffer);
    CHECK_EQ(refused<CycleError>(buffer, batch).size(), static_cast<std::size_t>(kLinks));
    CHECK(picture(buffer) == before);
    CHECK_EQ(left_out(buffer, batch).size(), static_cast<std::size_t>(kLinks));
    CHECK_EQ(buffer.frames().size(), static_cast<std::size_t>(kLinks) + 3);
    CHECK_EQ(buffer.tree().back().name, "other");
}

TFDB_TEST(refusals_of_an_edge_with_many_samples_in_a_cycle) {
    Buffer buffer(defaults());
    set(buffer, "base", "arm", kSecond, pose_of(1));
    std::vector<TransformView> batch;
    for (StampNs i = 0; i < 2000; ++i)
        batch.push_back({"arm", "base", 2 * kSecond + (i * 7919) % 2000, pose_of(2)});
    batch.push_back({"map", "base", 3 * kSecond, pose_of(3)});
    const auto members = left_out(buffer, batch);
    CHECK_EQ(members.size(), 2000U);
    CHECK_EQ(buffer.frame_info("base").samples, 1U);
    CHECK_EQ(number_of(buffer.lookup_transform("map", "base").pose), 3.0);
}

TFDB_TEST(refusals_and_a_store_that_is_full) {
    BufferOptions options = keeping(10 * kSecond);
    options.max_frames = 5;
    Buffer buffer(options);
    set(buffer, "map", "base", 47 * kSecond, pose_of(1));
    set(buffer, "base", "arm", 47 * kSecond, pose_of(2));
    const std::string before = picture(buffer);
    const TransformView batch[] = {{"base", "arm", 1, pose_of(3)},
                                   {"map", "x", 48 * kSecond, pose_of(4)},
                                   {"map", "y", 48 * kSecond, pose_of(5)},
                                   {"map", "z", 48 * kSecond, pose_of(6)}};
    CHECK_THROWS_AS(buffer.write({.transforms = batch, .partial = true}), CapacityExceeded);
    CHECK(picture(buffer) == before);
    // The arm is found to be too old before anything is stored.
    CHECK(indices(refused<TooOld>(buffer, batch)) == Indices({0}));
    const auto full =
        THROWN(CapacityExceeded, buffer.set_transforms(std::span(batch).subspan(1), false, ""));
    CHECK(full && full->detail().refused.empty());
    CHECK(picture(buffer) == before);
    CHECK(indices(left_out(buffer, std::span(batch).first(3))) == Indices({0}));
}

}  // namespace tfdb
