// Suggestions for the name of a missing frame.
#include "tfdb/store/nearest.hpp"

#include "tfdb/store/fixture.hpp"

namespace tfdb {
namespace {

using namespace fixture;
using Names = std::vector<std::string>;

}  // namespace

TFDB_TEST(nearest_knows_letters_that_are_missing_wrong_or_too_many) {
    const Names known = {"map", "odom", "base_link", "base_laser_link", "camera", "camera_2"};
    CHECK(store::nearest("base_lnk", known) == Names({"base_link"}));
    CHECK(store::nearest("baselink", known) == Names({"base_link"}));
    CHECK(store::nearest("basee_linkk", known) == Names({"base_link"}));
    CHECK(store::nearest("Base_Link", known) == Names({"base_link"}));
    CHECK(store::nearest("maap", known) == Names({"map"}));
    CHECK(store::nearest("camera_1", known) == Names({"camera_2", "camera"}));
    CHECK(store::nearest("zzzzzz", known).empty());
    CHECK(store::nearest("world", known).empty());
    CHECK(store::nearest("", known).empty());
}

TFDB_TEST(nearest_knows_prefixes_of_robots) {
    const Names known = {"r1/base", "r2/base", "r3/base", "r4/base", "rebase"};
    CHECK(store::nearest("base", known) == Names({"r1/base", "r2/base", "r3/base"}));
    CHECK(store::nearest("fleet/r1/base", known) == Names({"r1/base"}));
}

TFDB_TEST(nearest_offers_no_name_that_a_message_would_cut) {
    const std::string longest(64, 'x');
    CHECK(store::nearest(std::string(63, 'x'), {longest, longest + "x"}) == Names({longest}));
    CHECK(store::nearest(longest + "x", {longest}).empty());
}

TFDB_TEST(errors_name_the_nearest_frames_of_their_state) {
    Buffer buffer(keeping(10 * kSecond));
    set(buffer, "map", "base_link", kSecond, pose_of(1));
    const Snapshot before = buffer.snapshot();
    set(buffer, "map", "bose_link", kSecond, pose_of(2));
    const auto says = [](const auto& error, std::string_view text) {
        return error && std::string_view(error->what()).find(text) != std::string_view::npos;
    };
    const auto old = THROWN(UnknownFrame, before.lookup_transform("map", "bse_link", kSecond));
    CHECK(says(old, "; did you mean 'base_link'?"));
    const auto now = THROWN(UnknownFrame, buffer.lookup_transform("map", "bse_link", kSecond));
    CHECK(says(now, "; did you mean 'base_link' or 'bose_link'?"));
    CHECK(says(THROWN(UnknownFrame, buffer.frame_info("mapp")), "; did you mean 'map'?"));
    CHECK(!says(THROWN(UnknownFrame, buffer.samples("nil")), "did you mean"));
    set(buffer, "map", "evil\xC2\x9Bname", kSecond, pose_of(2));
    const auto evil = THROWN(UnknownFrame, buffer.frame_info("evil_name"));
    CHECK(says(evil, "did you mean 'evil"));
}

TFDB_TEST(nearest_takes_swapped_letters_for_one_mistake) {
    CHECK(store::nearest("mpa", {"map", "arm"}) == Names({"map"}));
    CHECK(store::nearest("bsae", {"base", "bas"}) == Names({"base"}));
}

TFDB_TEST(errors_of_a_transaction_name_the_frames_that_it_sees) {
    Buffer buffer(keeping(10 * kSecond));
    set(buffer, "map", "base_link", kSecond, pose_of(1));
    set(buffer, "base_link", "camera", kSecond, pose_of(2));
    const auto says = [](const auto& error, std::string_view text) {
        return error && std::string_view(error->what()).find(text) != std::string_view::npos;
    };
    Transaction tx(buffer);
    const TransformView own{"map", "gripper", kSecond, pose_of(3)};
    tx.set_transforms({&own, 1}, false, "");
    const auto unknown = [&](std::string_view name) {
        return THROWN(UnknownFrame, tx.lookup_transform("map", name, kSecond));
    };
    CHECK(says(unknown("base_lnk"), "; did you mean 'base_link'?"));
    CHECK(says(unknown("griper"), "; did you mean 'gripper'?"));
    CHECK(says(THROWN(UnknownFrame, tx.parent_of("camrea", {})), "; did you mean 'camera'?"));
    tx.remove_frame("camera", false);
    CHECK(!says(unknown("camra"), "did you mean"));
    const auto gone = THROWN(UnknownFrame, tx.remove_frame("griper", false));
    CHECK(says(gone, "nothing was removed; did you mean 'gripper'?"));
}

TFDB_TEST(errors_of_a_removal_name_the_nearest_frame_of_the_first) {
    Buffer buffer(keeping(10 * kSecond));
    set(buffer, "map", "base_link", kSecond, pose_of(1));
    const std::vector<std::string_view> names{"base_lnk", "mapp"};
    const auto error = THROWN(UnknownFrame, buffer.remove_frames(names, false));
    CHECK(error && error->detail().refused.size() == 2);
    CHECK(error && std::string_view(error->what()).find("; did you mean 'base_link'?") !=
                       std::string_view::npos);
}

TFDB_TEST(errors_of_a_large_store_are_not_slow) {
    Buffer buffer(keeping(10 * kSecond));
    for (int i = 0; i < 2001; ++i)
        set_static(buffer, "map", "frame_" + std::to_string(i), pose_of(1));
    const auto error = THROWN(UnknownFrame, buffer.frame_info("frme_7"));
    CHECK(error && std::string_view(error->what()).find("did you mean") == std::string_view::npos);
}

TFDB_TEST(errors_ask_whether_an_offset_was_meant) {
    Buffer buffer(keeping(100 * kSecond));
    for (int i = 0; i < 50; ++i)
        set(buffer, "map", "base", (1'700'000'000 + i) * kSecond, pose_of(i));
    const auto says = [&](StampNs stamp, std::string_view text) {
        const auto error = THROWN(Extrapolation, buffer.lookup_transform("map", "base", stamp));
        return error && std::string_view(error->what()).find(text) != std::string_view::npos;
    };
    CHECK(says(12 * kSecond + kSecond / 2,
               "; stamps are absolute: 12.500000000 s after its first sample is "
               "1700000012.500000000 s"));
    CHECK(says(12, "absolute: 12.000000000 s after its first sample is 1700000012.000000000 s"));
    CHECK(says(60, "absolute: 0.000000060 s after its first sample is 1700000000.000000060 s"));
    CHECK(!says(60 * kSecond, "absolute"));
    CHECK(!says(1'699'999'990 * kSecond, "absolute"));
    CHECK(says(1'700'000'010, "looks like seconds"));
}

}  // namespace tfdb
