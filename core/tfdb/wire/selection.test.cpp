#include "tfdb/wire/selection.hpp"

#include <algorithm>
#include <array>
#include <map>
#include <random>
#include <stdexcept>
#include <string>
#include <tuple>

#include "tfdb/testing/check.hpp"

namespace tfdb::wire {

namespace {

using clock::StampNs;

TransformView view(std::string_view parent, std::string_view child, StampNs stamp) {
    return {parent, child, stamp, {{1.0, 2.0, static_cast<double>(stamp)}, {0.0, 0.6, 0.0, 0.8}}};
}

std::optional<EdgeNames> same(std::uint32_t, std::string_view parent, std::string_view child) {
    return EdgeNames{std::string(parent), std::string(child)};
}

std::vector<std::string> names_of(const std::vector<TransformView>& members) {
    std::vector<std::string> names;
    for (const TransformView& member : members)
        names.push_back(std::string(member.parent) + ">" + std::string(member.child));
    return names;
}

}  // namespace

TFDB_TEST(selection_renames_and_leaves_out) {
    Selection selection([](std::uint32_t, std::string_view parent, std::string_view child) {
        return child == "camera" ? std::nullopt
                                 : std::optional(EdgeNames{"r/" + std::string(parent),
                                                           "r/" + std::string(child)});
    });
    std::vector<TransformView> members{view("map", "odom", 5), view("base", "camera", 5),
                                       view("odom", "base", 6)};
    selection.apply(0, false, members);
    CHECK((names_of(members) == std::vector<std::string>{"r/map>r/odom", "r/odom>r/base"}));
    CHECK_EQ(members[1].stamp, 6);
    CHECK_EQ(members[1].pose.translation.z, 6.0);
    CHECK_EQ(selection.left_out(), 1U);
    CHECK_EQ(selection.moving(), 2U);
}

TFDB_TEST(selection_asks_once_for_each_rule_and_edge) {
    std::map<std::tuple<std::uint32_t, std::string, std::string>, int> asked;
    Selection selection([&](std::uint32_t rule, std::string_view parent, std::string_view child) {
        ++asked[{rule, std::string(parent), std::string(child)}];
        return rule == 1 ? std::nullopt : same(rule, parent, child);
    });
    for (StampNs stamp = 0; stamp < 50; ++stamp) {
        for (const std::uint32_t rule : {0U, 1U}) {
            // The concatenated names of these edges are equal.
            std::vector<TransformView> members{view("a", "bc", stamp), view("ab", "c", stamp),
                                               view("a", "b", stamp)};
            selection.apply(rule, false, members);
            CHECK_EQ(members.size(), rule == 1 ? 0U : 3U);
        }
    }
    CHECK_EQ(asked.size(), 6U);
    for (const auto& [edge, times] : asked)
        CHECK_EQ(times, 1);
    CHECK_EQ(selection.kept().size(), 3U);
}

TFDB_TEST(selection_window_holds_its_ends_and_lets_static_transforms_through) {
    Selection selection(same, {10, 20});
    for (const bool is_static : {false, true}) {
        std::vector<TransformView> members;
        for (const StampNs stamp : {0, 9, 10, 20, 21, 25})
            members.push_back(view("map", "odom", stamp));
        selection.apply(0, is_static, members);
        CHECK_EQ(members.size(), is_static ? 6U : 2U);
        CHECK_EQ(members.front().stamp, is_static ? 0 : 10);
    }
    CHECK_EQ(selection.left_out(), 4U);
    CHECK_EQ(selection.moving(), 2U);
    CHECK_EQ(selection.outside()->first, 0);
    CHECK_EQ(selection.outside()->last, 25);
}

TFDB_TEST(selection_leaves_bad_stamps_to_the_store) {
    Selection selection(same, {10, 20});
    std::vector<TransformView> members{view("map", "odom", -3), view("map", "odom", 21)};
    selection.apply(0, false, members);
    CHECK_EQ(members.size(), 1U);
    CHECK_EQ(members[0].stamp, -3);
    CHECK_EQ(selection.moving(), 0U);
    CHECK_EQ(selection.outside()->first, 21);
}

TFDB_TEST(selection_reports_stamps_outside_of_chosen_edges_only) {
    Selection selection(
        [](std::uint32_t rule, std::string_view parent, std::string_view child) {
            return child == "odom" ? std::nullopt : same(rule, parent, child);
        },
        {10, 20});
    std::vector<TransformView> members{view("map", "odom", 5)};
    selection.apply(0, false, members);
    CHECK(!selection.outside().has_value());
    CHECK(selection.kept().empty());
    members = {view("map", "base", 30)};
    selection.apply(0, false, members);
    CHECK(selection.kept().empty());
    members = {view("map", "base", 11)};
    selection.apply(7, false, members);
    CHECK_EQ(selection.kept().size(), 1U);
    CHECK_EQ(selection.kept()[0].rule, 7U);
    CHECK(selection.kept()[0].child == "base");
}

TFDB_TEST(selection_throws_what_the_choice_throws_and_asks_again) {
    bool fails = true;
    Selection selection([&](std::uint32_t rule, std::string_view parent, std::string_view child) {
        if (fails)
            throw std::runtime_error("interrupted");
        return same(rule, parent, child);
    });
    std::vector<TransformView> members{view("map", "odom", 5)};
    CHECK_THROWS_AS(selection.apply(0, false, members), std::runtime_error);
    fails = false;
    members = {view("map", "odom", 5)};
    selection.apply(0, false, members);
    CHECK_EQ(members.size(), 1U);
}

/// The names stay valid while more edges are added.
TFDB_TEST(selection_agrees_with_a_filter_on_random_messages) {
    std::mt19937 random(20251);
    const std::array<std::string, 6> frames{
        "", "a", "b/c", "\xC3\xA4", "very_long_frame_name_x", std::string("nul\0in", 6)};
    const auto choose = [&](std::uint32_t rule, std::string_view parent,
                            std::string_view child) -> std::optional<EdgeNames> {
        if ((parent.size() + child.size() + rule) % 3 == 0)
            return std::nullopt;
        return EdgeNames{std::to_string(rule) + std::string(parent), "x" + std::string(child)};
    };
    Selection selection(choose, {40, 60});
    std::uint64_t left_out = 0;
    for (int round = 0; round < 300; ++round) {
        const auto rule = static_cast<std::uint32_t>(random() % 3);
        const bool is_static = random() % 4 == 0;
        std::vector<TransformView> members;
        std::vector<std::string> expected;
        for (std::size_t i = random() % 5; i > 0; --i) {
            members.push_back(view(frames[random() % 6], frames[random() % 6],
                                   static_cast<StampNs>(random() % 100)));
            const auto names = choose(rule, members.back().parent, members.back().child);
            const bool inside = members.back().stamp >= 40 && members.back().stamp <= 60;
            if (names && (is_static || inside))
                expected.push_back(names->parent + ">" + names->child);
        }
        left_out += members.size() - expected.size();
        selection.apply(rule, is_static, members);
        CHECK(names_of(members) == expected);
    }
    CHECK_EQ(selection.left_out(), left_out);
}

}  // namespace tfdb::wire
