// Every error: its fields, its text, and an unchanged store.
#include <limits>

#include "tfdb/store/fixture.hpp"

namespace tfdb {
namespace {

using namespace fixture;
using lookup::PolicyKind;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// map <- base moves from 1 s to 3 s with a gap of 1 s. base <- camera is static. moon is in
/// another tree.
Buffer robot() {
    Buffer buffer(keeping(10 * kSecond));
    for (const StampNs stamp : {10, 11, 12, 20, 21, 30})
        set(buffer, "map", "base", stamp * kSecond / 10, pose_of(static_cast<double>(stamp)));
    set_static(buffer, "base", "camera", pose_of(3));
    set_static(buffer, "space", "moon", pose_of(4));
    return buffer;
}

/// The store's whole visible state, for comparison.
std::string picture(const Buffer& buffer) {
    std::string text = std::to_string(buffer.commit());
    for (const FrameInfo& info : buffer.tree()) {
        text += " " + info.name + "<" + info.parent.value_or("-") + ":" + info.authority;
        const Samples samples = buffer.samples(info.name);
        for (std::size_t i = 0; i < samples.poses.size(); ++i) {
            text += "," + std::to_string(samples.stamps[i]) + "@" + samples.parents[i] + "=" +
                    std::to_string(number_of(samples.poses[i]));
        }
    }
    return text;
}

template <class E>
std::optional<E> refused(Buffer& buffer, const TransformView& transform, bool is_static = false) {
    const std::string before = picture(buffer);
    auto error = THROWN(E, buffer.set_transform(transform, is_static, "ekf"));
    CHECK_EQ(picture(buffer), before);
    if (error) {
        CHECK_EQ(error->detail().authority, "ekf");
        CHECK_EQ(error->detail().index.value_or(99), 0U);
        CHECK(says(*error, "from 'ekf'"));
    }
    return error;
}

}  // namespace

TFDB_TEST(error_unknown_frame_names_the_argument) {
    const Buffer buffer = robot();
    const auto target = THROWN(UnknownFrame, buffer.lookup_transform("maap", "base", kSecond));
    CHECK(target && target->detail().frame == "maap" && says(*target, "frame 'maap'"));
    const auto source = THROWN(UnknownFrame, buffer.lookup_transform("map", "bas", kSecond));
    CHECK(source && source->detail().frame == "bas" && says(*source, "frame 'bas'"));
    const auto both = THROWN(UnknownFrame, buffer.lookup_transform("nil", "nil"));
    CHECK(both && says(*both, "does not exist"));
    CHECK_THROWS_AS(buffer.frame_info("nil"), UnknownFrame);
    CHECK_THROWS_AS(buffer.samples("nil"), UnknownFrame);
    CHECK_THROWS_AS(buffer.lookup_latest_transform("nil", "map"), UnknownFrame);
    CHECK_THROWS_AS(buffer.path_stamps("map", "nil", {}, {}), UnknownFrame);
}

TFDB_TEST(error_disconnected_names_both_roots) {
    const Buffer buffer = robot();
    const auto error = THROWN(Disconnected, buffer.lookup_transform("moon", "camera", kSecond));
    CHECK(error && error->detail().target == "moon" && error->detail().source == "camera");
    CHECK(error && error->detail().frames == std::vector<std::string>({"space", "map"}));
    CHECK(error && says(*error, "T[moon<-camera]") && says(*error, "root 'space'") &&
          says(*error, "root 'map'"));
    CHECK_THROWS_AS(buffer.lookup_transform("moon", "camera"), Disconnected);
    CHECK_THROWS_AS(buffer.lookup_latest_transform("moon", "camera"), Disconnected);
}

TFDB_TEST(error_disconnected_names_an_edge_that_was_out_of_its_range) {
    // tool is a child of arm until 30 s, and then of ship, which is in another tree.
    Buffer buffer(keeping(std::nullopt));
    set_static(buffer, "map", "arm", pose_of(1));
    set_static(buffer, "sea", "ship", pose_of(2));
    set(buffer, "arm", "tool", 10 * kSecond, pose_of(3));
    set(buffer, "ship", "tool", 30 * kSecond, pose_of(4));
    set_static(buffer, "tool", "tip", pose_of(5));
    const auto late = THROWN(Disconnected, buffer.lookup_transform("map", "tip", 40 * kSecond));
    CHECK(late && late->detail().frames == std::vector<std::string>({"map", "sea"}));
    CHECK(late && late->detail().edge == "tool" && late->detail().parent == "ship");
    CHECK(late && late->detail().stamp == 40 * kSecond && late->detail().reason == "future");
    CHECK(late && late->detail().oldest == 10 * kSecond && late->detail().newest == 30 * kSecond);
    CHECK(late && says(*late, "edge T[ship<-tool] has no data at 40.000000000 s") &&
          says(*late, "(it covers 10.000000000 s to 30.000000000 s)"));
    // In the other direction the failing edge is on the target's side.
    const auto early = THROWN(Disconnected, buffer.lookup_transform("tip", "sea", 5 * kSecond));
    CHECK(early && early->detail().edge == "tool" && early->detail().parent == "arm");
    CHECK(early && early->detail().reason == "past" && early->detail().stamp == 5 * kSecond);
    // If all edges have data, the error names no edge: the newest samples have no common stamp.
    const auto apart = THROWN(Disconnected, buffer.lookup_transform("map", "tip", 30 * kSecond));
    CHECK(apart && apart->detail().edge.empty() && !apart->detail().oldest);
    const auto newest = THROWN(Disconnected, buffer.lookup_transform("map", "tip"));
    CHECK(newest && newest->detail().edge.empty() && !newest->detail().stamp);
}

TFDB_TEST(error_disconnected_of_a_snapshot_without_samples_stays_what_it_is) {
    Buffer buffer = robot();
    buffer.clear();
    const Snapshot held = buffer.snapshot();
    for (const std::optional<StampNs> at : {std::optional<StampNs>(2 * kSecond), {}}) {
        const auto error = THROWN(Disconnected, held.lookup_transform("map", "camera", at));
        CHECK(error && error->detail().frames == std::vector<std::string>({"map", "base"}));
        CHECK(error && error->detail().edge.empty() && error->detail().stamp == at);
        for (StampNs i = 0; i < 100; ++i)  // what it needs is evicted
            set(buffer, "map", "base", 3 * kSecond + i, pose_of(1));
        const auto again = THROWN(Disconnected, held.lookup_transform("map", "camera", at));
        CHECK(error && again && std::string(error->what()) == again->what());
    }
}

TFDB_TEST(error_of_a_lookup_through_a_fixed_frame_is_about_the_half_that_failed) {
    const Buffer buffer = robot();
    const auto past = THROWN(Extrapolation, buffer.lookup_transform_full(
                                                "camera", 2 * kSecond, "base", kSecond / 2, "map"));
    CHECK(past && past->detail().target == "camera" && past->detail().source == "base");
    CHECK(past && past->detail().stamp == kSecond / 2 && says(*past, "T[map<-base]") &&
          says(*past, "(of T[camera<-base])"));
    const auto apart =
        THROWN(Disconnected, buffer.lookup_transform_full("moon", {}, "base", kSecond, "map"));
    CHECK(apart && apart->detail().frames == std::vector<std::string>({"space", "map"}));
    CHECK(apart && says(*apart, "'moon' under root 'space' and 'map' under root 'map'"));
    const auto fixed =
        THROWN(UnknownFrame, buffer.lookup_transform_full("camera", {}, "base", {}, "nil"));
    CHECK(fixed && fixed->detail().frame == "nil" && says(*fixed, "frame 'nil'"));
}

TFDB_TEST(error_extrapolation_tells_past_from_future) {
    const Buffer buffer = robot();
    const auto past = THROWN(Extrapolation, buffer.lookup_transform("map", "camera", 400'000'000));
    CHECK(past && past->detail().reason == "past" && past->detail().edge == "base");
    CHECK(past && past->detail().parent == "map" && past->detail().stamp == 400'000'000);
    CHECK(past && past->detail().oldest == kSecond && past->detail().newest == 3 * kSecond);
    CHECK(past && says(*past, "by 0.600000000 s into the past") &&
          says(*past, "covers 1.000000000 s to "));
    const auto future =
        THROWN(Extrapolation, buffer.lookup_transform("camera", "map", 4 * kSecond));
    CHECK(future && future->detail().reason == "future" && future->detail().edge == "base");
    CHECK(future && says(*future, "by 1.000000000 s into the future"));
    CHECK(future && future->detail().target == "camera" && future->detail().source == "map");
    const Policy beyond{PolicyKind::kExtrapolate, kSecond / 2};
    CHECK_THROWS_AS(buffer.lookup_transform("map", "base", 4 * kSecond, beyond), Extrapolation);
    CHECK_EQ(buffer.lookup_transform("map", "base", 34 * kSecond / 10, beyond).stamp,
             3'400'000'000);
}

TFDB_TEST(error_policies_say_what_they_found_and_what_they_allow) {
    const Buffer buffer = robot();
    const StampNs between = 16 * kSecond / 10;
    const auto gap = THROWN(
        GapTooLarge,
        buffer.lookup_transform("map", "base", between, {PolicyKind::kInterpolate, kSecond / 2}));
    CHECK(gap && gap->detail().edge == "base" && gap->detail().limit == kSecond / 2);
    CHECK(gap && gap->detail().before == 12 * kSecond / 10 && gap->detail().after == 2 * kSecond);
    CHECK(gap && says(*gap, "a gap of 0.800000000 s") && says(*gap, "max_gap"));
    const auto stale = THROWN(
        Stale,
        buffer.lookup_transform("map", "base", between, {PolicyKind::kPrevious, kSecond / 10}));
    CHECK(stale && stale->detail().edge == "base" && stale->detail().before == 12 * kSecond / 10);
    CHECK(stale && says(*stale, "0.400000000 s old") && says(*stale, "max_age"));
    const auto near = THROWN(
        NoSampleNear,
        buffer.lookup_transform("map", "base", between, {PolicyKind::kNearest, kSecond / 10}));
    CHECK(near && near->detail().limit == kSecond / 10 && says(*near, "tolerance"));
    const auto exact =
        THROWN(NoSampleNear, buffer.lookup_transform("map", "base", between, {PolicyKind::kExact}));
    CHECK(exact && exact->detail().edge == "base" && says(*exact, "not at exactly that stamp"));
    CHECK(exact && exact->detail().before == 12 * kSecond / 10);
    const auto latest =
        THROWN(Stale, buffer.lookup_latest_transform("map", "camera", kSecond, 5 * kSecond));
    CHECK(latest && latest->detail().edge == "base" && latest->detail().newest == 3 * kSecond);
    CHECK(latest && latest->detail().limit == kSecond && says(*latest, "2.000000000 s old"));
    CHECK_EQ(buffer.lookup_latest_transform("map", "camera", kSecond, 4 * kSecond).stamp,
             3 * kSecond);
}

TFDB_TEST(error_invalid_transform_says_which_number) {
    Buffer buffer = robot();
    const auto with = [&](Pose pose) {
        return refused<InvalidTransform>(buffer, {"map", "base", 4 * kSecond, pose});
    };
    for (const double bad : {kNan, kInfinity, -kInfinity}) {
        for (int at = 0; at < 7; ++at) {
            Pose pose = pose_of(1);
            (&pose.translation.x)[at] = bad;
            const auto error = with(pose);
            CHECK(error && error->detail().edge == "base" && error->detail().parent == "map");
            CHECK(error && says(*error, at < 3 ? "translation is not finite" : "squared norm"));
        }
    }
    Pose overflow = pose_of(1);
    overflow.translation = {1e308, 1e308, 1e308};  // their sum overflows, each is finite
    CHECK_EQ(set(buffer, "map", "base", 4 * kSecond, overflow), 9U);
    Pose zero = pose_of(1);
    zero.rotation = {0, 0, 0, 0};
    CHECK(with(zero) && says(*with(zero), "squared norm of 0"));
    for (const double norm2 : {0.9899, 1.0101}) {
        Pose pose = pose_of(1);
        for (int at = 3; at < 7; ++at)
            (&pose.translation.x)[at] *= std::sqrt(norm2);
        CHECK(with(pose) && says(*with(pose), "must be within 0.01 of 1"));
    }
    const auto self = refused<InvalidTransform>(buffer, {"base", "base", 5 * kSecond, pose_of(1)});
    CHECK(self && says(*self, "its own parent"));
}

TFDB_TEST(error_quaternions_a_little_off_are_normalised_and_counted) {
    Buffer buffer(defaults());
    CHECK_EQ(buffer.counters().normalised, 0U);
    Pose pose = pose_of(1);
    for (int at = 3; at < 7; ++at)
        (&pose.translation.x)[at] *= std::sqrt(1.0099);
    set(buffer, "map", "base", kSecond, pose);
    CHECK_EQ(buffer.counters().normalised, 1U);
    CHECK(apart(buffer.lookup_transform("map", "base", kSecond).pose, pose_of(1)) < 1e-15);
    pose.rotation = {0.6, 0.0, 0.0, 0.8 + 1e-12};
    set(buffer, "map", "base", 2 * kSecond, pose);
    CHECK_EQ(buffer.counters().normalised, 1U);
}

TFDB_TEST(error_invalid_names) {
    Buffer buffer = robot();
    using namespace std::string_view_literals;
    const std::string longest(kMaxNameBytes, 'n');
    const std::string huge(10'000, 'n');
    const std::pair<std::string_view, const char*> bad[] = {
        {"", "is empty"},
        {huge, "longer than 1024"},
        {"a\0b"sv, "control character"},
        {"a\nb", "control character"},
        {"a\x7F", "control character"},
        {"a\xFF", "not valid UTF-8"},
        {"a\xC0\x80", "not valid UTF-8"},
        {"a\xED\xA0\x80", "not valid UTF-8"},
        {"a\xF4\x90\x80\x80", "not valid UTF-8"},
        {"a\xE2\x82", "not valid UTF-8"},
    };
    for (const auto& [name, reason] : bad) {
        const auto child = refused<InvalidName>(buffer, {"map", name, kSecond, pose_of(1)});
        CHECK(child && child->detail().frame == name && says(*child, "child frame name"));
        CHECK(child && says(*child, reason) && std::string_view(child->what()).size() < 300);
        const auto parent = refused<InvalidName>(buffer, {name, "x", kSecond, pose_of(1)}, true);
        CHECK(parent && parent->detail().frame == name && says(*parent, "parent frame name"));
    }
    for (const std::string_view name : {longest.c_str(), "/map", " ", "\xF0\x9F\xA4\x96", "..."}) {
        set(buffer, "map", name, kSecond, pose_of(9));
        CHECK_EQ(number_of(buffer.lookup_transform("map", name).pose), 9.0);
    }
}

TFDB_TEST(error_invalid_stamps_and_too_old_ones) {
    Buffer buffer = robot();
    for (const StampNs stamp :
         {StampNs{-1}, std::numeric_limits<StampNs>::min(), std::numeric_limits<StampNs>::max()}) {
        const auto error = refused<InvalidStamp>(buffer, {"map", "base", stamp, pose_of(1)});
        CHECK(error && error->detail().stamp == stamp && error->detail().edge == "base");
    }
    set(buffer, "map", "base", 20 * kSecond, pose_of(1));
    const auto old = refused<TooOld>(buffer, {"map", "base", 10 * kSecond - 1, pose_of(1)});
    CHECK(old && old->detail().newest == 20 * kSecond && old->detail().oldest == 10 * kSecond);
    CHECK(old && old->detail().limit == 10 * kSecond && says(*old, "9.999999999 s"));
    CHECK(old && old->detail().stamp == 10 * kSecond - 1 && says(*old, "retained history"));
    set(buffer, "map", "base", 10 * kSecond, pose_of(2));  // at the very edge
    CHECK_EQ(buffer.frame_info("base").oldest, 10 * kSecond);
}

TFDB_TEST(error_static_conflicts_both_ways) {
    Buffer buffer = robot();
    const auto moving = refused<StaticConflict>(buffer, {"base", "camera", kSecond, pose_of(1)});
    CHECK(moving && moving->detail().edge == "camera" &&
          says(*moving, "the stored edge of 'camera' is static"));
    const auto fixed = refused<StaticConflict>(buffer, {"map", "base", kSecond, pose_of(1)}, true);
    CHECK(fixed && fixed->detail().edge == "base" &&
          says(*fixed, "the stored edge of 'base' is moving"));
    CHECK(fixed && says(*fixed, "remove frame 'base' first"));
    buffer.clear();  // then the edge has no samples that could contradict
    CHECK_EQ(set_static(buffer, "map", "base", pose_of(1)), 10U);
}

TFDB_TEST(error_cycles_name_the_edge) {
    Buffer buffer = robot();
    const auto error = refused<CycleError>(buffer, {"camera", "map", 2 * kSecond, pose_of(1)});
    CHECK(error && error->detail().edge == "map" && error->detail().parent == "camera");
    CHECK(error && says(*error, "its own ancestor") && says(*error, "nothing was stored"));
    const auto fixed = refused<CycleError>(buffer, {"base", "map", 0, pose_of(1)}, true);
    CHECK(fixed && says(*fixed, "static T[base<-map] from 'ekf' would make"));
    CHECK_EQ(buffer.frames().size(), 5U);
}

TFDB_TEST(error_frame_in_use_names_the_children) {
    Buffer buffer = robot();
    for (int i = 0; i < 12; ++i)
        set_static(buffer, "map", "m" + std::to_string(i), pose_of(1));
    const std::string before = picture(buffer);
    const auto error = THROWN(FrameInUse, buffer.remove_frame("map", false));
    CHECK(error && error->detail().frame == "map" && error->detail().frames.size() == 13U);
    CHECK(error && says(*error, "'base'") && says(*error, "recursive=True") &&
          says(*error, ", ..."));
    const auto unknown = THROWN(UnknownFrame, buffer.remove_frame("nil", true));
    CHECK(unknown && unknown->detail().frame == "nil" && says(*unknown, "nothing was removed"));
    CHECK_EQ(picture(buffer), before);
}

TFDB_TEST(error_options_and_arguments) {
    CHECK_THROWS_AS(Buffer(keeping(0)), InvalidArgument);
    CHECK_THROWS_AS(Buffer(keeping(-1)), InvalidArgument);
    for (const std::uint32_t frames : {0U, kMaxFrames + 1}) {
        BufferOptions options = defaults();
        options.max_frames = frames;
        CHECK_THROWS_AS(Buffer{options}, InvalidArgument);
    }
    BufferOptions tiny = defaults();
    tiny.memory_limit = 10;
    CHECK_THROWS_AS(Buffer{tiny}, CapacityExceeded);
    const Buffer buffer = robot();
    CHECK_THROWS_AS(buffer.lookup_velocity("map", "base", {}, 0, "", {}, ""), InvalidArgument);
    std::vector<double> out(6);
    const StampNs stamp = kSecond;
    CHECK_THROWS_AS(
        buffer.lookup_many("map", "base", {&stamp, 1}, {}, Layout::kPose, Missing::kThrow, out),
        InvalidArgument);
}

TFDB_TEST(error_long_names_are_cut_in_messages_only) {
    Buffer buffer(defaults());
    const std::string name(1000, 'q');
    set(buffer, "map", name, kSecond, pose_of(1));
    const auto error = THROWN(Extrapolation, buffer.lookup_transform("map", name, 2 * kSecond));
    CHECK(error && error->detail().edge == name && std::string_view(error->what()).size() < 600);
}

}  // namespace tfdb
