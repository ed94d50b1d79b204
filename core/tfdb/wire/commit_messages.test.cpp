// Commits as TFMessages and bytes: together they are complete, and bytes are used only where
// necessary.
#include "tfdb/wire/commit_messages.hpp"

#include <algorithm>
#include <bit>
#include <string>

#include "tfdb/testing/check.hpp"
#include "tfdb/wire/commit_sample.rewritten.hpp"
#include "tfdb/wire/tf_message.hpp"

namespace tfdb::wire {
namespace {

using Bytes = std::vector<std::byte>;
using Row = CommitSample::Row;

constexpr Epoch kEpoch{1'700'000'000'000'000'000, 1, 2};
constexpr clock::StampNs kFar = clock::StampNs{1} << 62;

Row row(clock::StampNs stamp, std::uint32_t parent, bool gone = false) {
    Row made{stamp, parent, gone, {}};
    made.numbers[6] = std::bit_cast<std::uint64_t>(1.0);
    made.numbers[0] = std::bit_cast<std::uint64_t>(static_cast<double>(stamp));
    return made;
}

/// Commits 8 to 13 after 7: plain, with an authority, clearing, removing, far, of a lone frame.
Bytes example() {
    SampleWriter writer;
    writer.start();
    const std::uint32_t map = writer.add_name("map");
    const std::uint32_t base = writer.add_name("base");
    const std::uint32_t lidar = writer.add_name("lidar");
    const std::uint32_t slam = writer.add_authority("slam");
    const std::uint32_t made[] = {map, base, lidar};
    writer.start_commit(1, {.made = made}, 2);
    const Row moving[] = {row(5, map), row(6, lidar)};
    writer.add_edge({.child = base}, moving);
    const Row fixed[] = {row(0, base)};
    writer.add_edge({.child = lidar, .is_static = true}, fixed);
    const Row one[] = {row(7, map)};
    writer.start_commit(1, {}, 1);
    writer.add_edge({.child = base, .authority = slam}, one);
    const std::uint32_t cleared[] = {base};
    writer.start_commit(1, {.cleared = cleared}, 0);
    const std::uint32_t removed[] = {lidar};
    const Row orphan[] = {row(8, lidar, true)};
    writer.start_commit(1, {.removed = removed}, 1);
    writer.add_edge({.child = base}, orphan);
    const Row far[] = {row(9, map), row(kFar, map)};
    writer.start_commit(1, {}, 1);
    writer.add_edge({.child = base}, far);
    const std::uint32_t alone[] = {writer.add_name("alone")};
    writer.start_commit(1, {.made = alone}, 0);
    return writer.finish(CommitSample::Kind::kCommits, kEpoch, 0, 7, 13);
}

Bytes state() {
    SampleWriter writer;
    writer.start();
    const std::uint32_t arm = writer.add_name("arm");
    const std::uint32_t base = writer.add_name("base");
    const std::uint32_t map = writer.add_name("map");
    const Row moving[] = {row(3, base), row(4, base)};
    writer.add_frame({.child = arm, .authority = writer.add_authority("joints")}, moving);
    const Row fixed[] = {row(0, map)};
    writer.add_frame({.child = base, .is_static = true}, fixed);
    writer.add_frame({.child = map}, {});
    return writer.finish(CommitSample::Kind::kState, kEpoch, 0, 13, 13, 3);
}

CommitSample decoded(const Bytes& bytes) {
    CommitSample sample;
    sample.decode(bytes);
    CHECK(testing::rewritten(sample) == bytes);
    return sample;
}

std::string edges_of(const Bytes& message) {
    std::vector<TransformView> views;
    if (!message.empty())
        decode_tf_message(message, Encoding::kCdr, views);
    std::string text;
    for (const TransformView& view : views) {
        text += std::string(view.parent) + ">" + std::string(view.child) + " " +
                std::to_string(view.stamp) + ";";
    }
    return text;
}

ChosenName renamed(std::string_view name) {
    return {"z/" + std::string(name), name != "map" && name != "lidar"};
}

}  // namespace

TFDB_TEST(commit_messages_have_bytes_where_messages_do_not_say_all) {
    const std::vector<CommitMessages> made = messages_of_commits(example(), 7, {});
    CHECK_EQ(made.size(), std::size_t{6});
    CHECK_EQ(edges_of(made[0].moving), "map>base 5;lidar>base 6;");
    CHECK_EQ(edges_of(made[0].fixed), "base>lidar 0;");
    CHECK(made[0].whole.empty());
    CHECK_EQ(edges_of(made[3].moving), "lidar>base 8;");
    CHECK_EQ(edges_of(made[4].moving), "map>base 9;");
    CHECK(made[5].moving.empty());
    for (std::size_t i = 1; i < made.size(); ++i) {
        const CommitSample sample = decoded(made[i].whole);
        CHECK_EQ(sample.since, made[i - 1].commit);
        CHECK_EQ(sample.last, made[i].commit);
        CHECK_EQ(sample.commits.size(), std::size_t{1});
    }
    CHECK_EQ(decoded(made[1].whole).authorities.back(), "slam");
    CHECK_EQ(decoded(made[4].whole).rows[1].stamp, kFar);
    CHECK(decoded(made[3].whole).rows[0].gone);
    CHECK_EQ(decoded(made[5].whole).names[0], "alone");
}

TFDB_TEST(commit_messages_are_commits_again) {
    const CommitMessages first = messages_of_commits(example(), 7, {}).front();
    const Bytes bytes = commit_of_messages(kEpoch, 3, first.commit, first.moving, first.fixed);
    const CommitSample sample = decoded(bytes);
    CHECK(sample.epoch == kEpoch);
    CHECK_EQ(sample.since, CommitNumber{3});
    CHECK_EQ(sample.last, CommitNumber{8});
    const auto edges = sample.edges_of(sample.commits[0]);
    CHECK_EQ(edges.size(), std::size_t{2});
    CHECK_EQ(sample.rows_of(edges[0]).size(), std::size_t{2});
    CHECK_EQ(sample.names[sample.rows_of(edges[0])[1].parent], "lidar");
    CHECK(sample.rows_of(edges[0])[1].numbers == row(6, 0).numbers);
    CHECK(edges[1].is_static && !edges[0].is_static);
    CHECK_THROWS_AS(commit_of_messages(kEpoch, 8, 8, {}, {}), InvalidArgument);
}

TFDB_TEST(commit_messages_rename_and_leave_out) {
    const std::vector<CommitMessages> made = messages_of_commits(example(), 7, renamed);
    CHECK_EQ(made.size(), std::size_t{6});
    CHECK_EQ(edges_of(made[0].moving), "z/map>z/base 5;z/lidar>z/base 6;");
    CHECK(made[0].fixed.empty());
    CHECK_EQ(decoded(made[3].whole).names[0], "z/lidar");
    CHECK_EQ(decoded(made[2].whole).names[0], "z/base");
    const auto same = [](std::string_view) { return ChosenName{"same"}; };
    CHECK_THROWS_AS(messages_of_commits(example(), 7, same), InvalidArgument);
}

TFDB_TEST(commit_messages_of_a_state_have_the_newest_samples) {
    const CommitMessages all = messages_of_commits(state(), 0, {}).front();
    CHECK_EQ(all.commit, CommitNumber{13});
    CHECK_EQ(edges_of(all.moving), "base>arm 4;");
    CHECK_EQ(edges_of(all.fixed), "map>base 0;");
    CHECK(all.whole == state());
    const CommitMessages some = messages_of_commits(state(), 0, [](std::string_view name) {
                                    return renamed(name == "arm" ? "zip" : name);
                                }).front();
    CHECK_EQ(edges_of(some.moving), "z/base>z/zip 4;");
    const CommitSample sample = decoded(some.whole);
    CHECK((sample.names == std::vector<std::string_view>{"z/base", "z/zip", "z/map"}));
    CHECK_EQ(sample.edges.size(), std::size_t{2});
    CHECK_EQ(sample.authorities.back(), "joints");
}

}  // namespace tfdb::wire
