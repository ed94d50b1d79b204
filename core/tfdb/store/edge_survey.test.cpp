#include "tfdb/store/edge_survey.hpp"

#include <limits>
#include <map>
#include <random>
#include <string>
#include <vector>

#include "tfdb/store/fixture.hpp"

namespace tfdb {
namespace {

using namespace fixture;
using wire::TransformView;

/// Gives the same messages to a survey and to a store.
class Both {
public:
    void add(const std::vector<TransformView>& members, bool is_static = false) {
        survey.add(members, is_static);
        store_.write({.transforms = members, .is_static = is_static, .partial = true});
    }
    void check() const {
        std::size_t edges = 0;
        for (const FrameInfo& info : store_.tree()) {
            if (!info.parent)
                continue;
            ++edges;
            const auto found = survey.edges().find(info.name);
            CHECK(found != survey.edges().end());
            if (found == survey.edges().end())
                continue;
            CHECK_EQ(found->second.parent, *info.parent);
            CHECK_EQ(found->second.is_static, info.is_static);
            if (!info.is_static) {
                CHECK_EQ(found->second.first, info.oldest);
                CHECK_EQ(found->second.last, info.newest);
            }
        }
        CHECK_EQ(edges, survey.edges().size());
    }

    EdgeSurvey survey;

private:
    Buffer store_{keeping(std::nullopt)};
};

TransformView view(std::string_view parent, std::string_view child, StampNs stamp) {
    return {parent, child, stamp, pose_of(7)};
}

}  // namespace

TFDB_TEST(edge_survey_has_the_edges_of_a_store) {
    Both both;
    both.add({view("map", "odom", 50), view("odom", "base", 40)});
    both.add({view("map", "odom", 30), view("odom", "base", 60)});
    both.add({view("base", "camera", 0)}, true);
    both.check();
    CHECK(both.survey.is_tree());
    const auto& odom = both.survey.edges().find("odom")->second;
    CHECK_EQ(odom.first, 30);
    CHECK_EQ(odom.last, 50);
}

TFDB_TEST(edge_survey_passes_over_what_a_store_refuses) {
    Both both;
    auto not_finite = view("map", "a", 900);
    not_finite.pose.translation.x = std::numeric_limits<double>::quiet_NaN();
    auto no_rotation = view("map", "b", 900);
    no_rotation.pose.rotation = {0, 0, 0, 0};
    both.add({not_finite, no_rotation, view("map", "map", 900), view("map", "c", -5),
              view("map", "new\nline", 900), view("", "d", 900), view("map", "\xff", 900)});
    both.add({view("map", "odom", 50)});
    both.add({view("map", "odom", 50)}, true);  // it moves
    both.add({view("map", "fixed", 0)}, true);
    both.add({view("other", "fixed", 70)});  // it is static
    both.add({view("\n", "odom", 60)});
    both.check();
    CHECK(both.survey.is_tree());
    CHECK_EQ(both.survey.edges().size(), 2U);
}

TFDB_TEST(edge_survey_is_no_tree_with_a_second_parent_or_a_circle) {
    EdgeSurvey moved;
    moved.add(std::vector{view("map", "box", 1)}, false);
    CHECK(moved.is_tree());
    moved.add(std::vector{view("hand", "box", 2)}, false);
    CHECK(!moved.is_tree());
    EdgeSurvey circle;
    circle.add(std::vector{view("x", "y", 1), view("a", "b", 1), view("b", "c", 1)}, false);
    CHECK(circle.is_tree());
    circle.add(std::vector{view("c", "a", 1), view("c", "d", 1)}, false);
    CHECK(!circle.is_tree());
}

TFDB_TEST(edge_survey_of_random_trees_is_that_of_a_store) {
    std::mt19937 random(4);
    int trees = 0;
    for (int round = 0; round < 60; ++round) {
        Both both;
        const auto frames = static_cast<unsigned>(3 + random() % 20);
        std::vector<std::string> names{"root"};
        std::map<std::string, std::string> parents;
        for (unsigned i = 0; i < frames; ++i) {
            names.push_back("f" + std::to_string(i));
            parents[names.back()] = names[random() % (names.size() - 1)];
        }
        for (int message = 0; message < 40; ++message) {
            std::vector<TransformView> members;
            for (unsigned i = random() % 4; i > 0; --i) {
                const std::string& child = names[1 + random() % frames];
                members.push_back(view(parents[child], child, static_cast<StampNs>(random() % 99)));
                if (random() % 8 == 0)
                    members.back().pose.rotation.w = 9.0;
            }
            both.add(members, random() % 4 == 0);
        }
        both.check();
        trees += both.survey.is_tree() ? 1 : 0;
    }
    CHECK_EQ(trees, 60);
}

}  // namespace tfdb
