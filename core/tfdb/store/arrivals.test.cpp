#include "tfdb/store/arrivals.hpp"

#include <limits>
#include <random>
#include <string>
#include <vector>

#include "tfdb/store/fixture.hpp"

namespace tfdb {
namespace {

using namespace fixture;
using wire::TransformView;

TransformView view(std::string_view parent, std::string_view child, StampNs stamp,
                   double number = 3) {
    return {parent, child, stamp, pose_of(number)};
}

void add(Arrivals& arrivals, const std::vector<TransformView>& members, std::int64_t received,
         std::string_view publisher, bool is_static = false) {
    arrivals.add(members, {received, publisher, is_static}, [](std::size_t) {});
}

}  // namespace

TFDB_TEST(arrivals_are_columns_by_child) {
    for (const bool with_store : {false, true}) {
        Arrivals arrivals(with_store);
        add(arrivals, {view("map", "odom", 50, 1), view("odom", "base", 40, 2)}, 100, "slam");
        add(arrivals, {view("map", "odom", 30, 4)}, 200, "other");
        add(arrivals, {view("base", "lidar", 7, 5)}, 300, "", true);
        CHECK(arrivals.is_right());
        CHECK_EQ(arrivals.columns().size(), 3U);
        const Arrivals::Columns& odom = arrivals.columns().at("odom");
        CHECK((odom.stamps == std::vector<StampNs>{50, 30}));
        CHECK((odom.received == std::vector<std::int64_t>{100, 200}));
        CHECK_EQ(number_of(odom.poses[1]), 4.0);
        CHECK_EQ(arrivals.names()[static_cast<std::size_t>(odom.parents[1])], "map");
        CHECK_EQ(arrivals.names()[static_cast<std::size_t>(odom.publishers[0])], "slam");
        CHECK_EQ(arrivals.names()[static_cast<std::size_t>(odom.publishers[1])], "other");
        CHECK_EQ(arrivals.columns().at("lidar").is_static[0], 1);
        CHECK_EQ(odom.is_static[0], 0);
    }
}

TFDB_TEST(arrivals_leave_out_what_a_store_refuses) {
    for (const bool with_store : {false, true}) {
        Arrivals arrivals(with_store);
        TransformView bad = view("map", "odom", 60);
        bad.pose.rotation = {0, 0, 0, 3};
        std::vector<std::size_t> kept;
        const std::vector<TransformView> members{bad, view("map", "odom", 61),
                                                 view("map", "map", 61), view("map", "b", 1)};
        arrivals.add(members, {9, "slam", false}, [&](std::size_t i) { kept.push_back(i); });
        CHECK((kept == std::vector<std::size_t>{1, 3}));
        arrivals.hold(std::vector{view("b", "fixed", 0)});
        add(arrivals, {view("map", "odom", 5)}, 10, "slam", true);
        add(arrivals, {view("b", "fixed", 5), view("b", "fixed", 6)}, 11, "slam");
        CHECK_EQ(arrivals.columns().size(), 2U);
        CHECK_EQ(arrivals.conflicts().size(), 2U);
        CHECK_EQ(arrivals.conflicts().at({"fixed", false}), 2U);
        CHECK_EQ(arrivals.conflicts().at({"odom", true}), 1U);
    }
}

TFDB_TEST(arrivals_without_a_store_are_not_right_where_parents_change) {
    Arrivals plain(false);
    Arrivals judged(true);
    for (Arrivals* each : {&plain, &judged}) {
        add(*each, {view("a", "b", 1)}, 1, "");
        add(*each, {view("b", "a", 2)}, 2, "");
    }
    CHECK(!plain.is_right());
    CHECK(judged.is_right());
    CHECK_EQ(judged.columns().size(), 1U);
}

TFDB_TEST(arrivals_of_random_trees_are_those_that_a_store_keeps) {
    std::mt19937 random(11);
    for (int round = 0; round < 30; ++round) {
        Arrivals plain(false);
        Arrivals judged(true);
        for (int message = 0; message < 60; ++message) {
            std::vector<TransformView> members;
            static constexpr std::string_view kNames[] = {"a", "b", "c", "d", "e\n", "f"};
            for (std::size_t i = random() % 4; i > 0; --i) {
                const std::size_t child = 1 + random() % 5;
                members.push_back(view(kNames[child / 2], kNames[child],
                                       static_cast<StampNs>(random() % 50) - 2,
                                       static_cast<double>(random() % 90)));
                if (random() % 9 == 0)
                    members.back().pose.translation.y = std::numeric_limits<double>::infinity();
            }
            const bool is_static = random() % 5 == 0;
            for (Arrivals* each : {&plain, &judged})
                add(*each, members, message, "x", is_static);
        }
        CHECK(plain.is_right());
        CHECK(plain.conflicts() == judged.conflicts());
        CHECK_EQ(plain.columns().size(), judged.columns().size());
        for (const auto& [child, columns] : judged.columns()) {
            const auto found = plain.columns().find(child);
            CHECK(found != plain.columns().end());
            if (found != plain.columns().end()) {
                CHECK(found->second.stamps == columns.stamps);
                CHECK(found->second.received == columns.received);
                CHECK(found->second.is_static == columns.is_static);
            }
        }
    }
}

}  // namespace tfdb
