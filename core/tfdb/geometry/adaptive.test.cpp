#include "tfdb/geometry/adaptive.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "tfdb/geometry/random_pose.hpp"
#include "tfdb/geometry/slerp.hpp"
#include "tfdb/testing/check.hpp"

namespace tfdb::geometry {
namespace {

using testing::distance;
using testing::RandomPoses;
using testing::rotation_distance;

constexpr double kAny = std::numeric_limits<double>::infinity();

struct Walk {
    std::vector<std::int64_t> stamps;
    std::vector<Pose> poses;
};

Walk random_walk(RandomPoses& random, std::size_t count, double metres, double radians) {
    Walk walk{{random.stamp(0, 1000)}, {random.pose()}};
    while (walk.poses.size() < count) {
        const Pose& before = walk.poses.back();
        const Vec3 step = random.point(metres);
        const Vec3& at = before.translation;
        walk.poses.push_back({{at.x + step.x, at.y + step.y, at.z + step.z},
                              random.apart(before.rotation, random.uniform(0.0, radians / 2))});
        walk.stamps.push_back(walk.stamps.back() + random.stamp(1, 1'000'000));
    }
    return walk;
}

TFDB_TEST(adaptive_stays_within_its_tolerances_between_rows_too) {
    RandomPoses random("adaptive_stays_within_its_tolerances_between_rows_too", 71);
    constexpr int kParts = 16;
    for (const double turn : {0.02, 0.5, 2.5}) {
        for (const double metres : {0.05, kAny}) {
            const double radians = 3.0 * turn < 3.0 ? 3.0 * turn : 0.8;
            const Walk walk = random_walk(random, 300, 0.02, turn);
            const auto rows = enough_rows(walk.stamps, walk.poses, metres, radians);
            CHECK(rows.front() == 0 && rows.back() == walk.poses.size() - 1);
            CHECK(rows.size() < walk.poses.size());
            double moved = 0.0;
            double turned = 0.0;
            for (std::size_t i = 1; i < rows.size(); ++i) {
                CHECK(rows[i - 1] < rows[i]);
                for (std::size_t row = rows[i - 1]; row < rows[i]; ++row) {
                    for (int part = 0; part <= kParts; ++part) {
                        const double in = static_cast<double>(part) / kParts;
                        const auto at = [&](std::size_t k) {
                            return static_cast<double>(walk.stamps[k] - walk.stamps[rows[i - 1]]);
                        };
                        const double u = (at(row) + in * (at(row + 1) - at(row))) / at(rows[i]);
                        const Pose was = interpolate(walk.poses[row], walk.poses[row + 1], in);
                        const Pose is =
                            interpolate(walk.poses[rows[i - 1]], walk.poses[rows[i]], u);
                        moved = std::max(moved, distance(was.translation, is.translation));
                        turned = std::max(turned, rotation_distance(was.rotation, is.rotation));
                    }
                }
            }
            CHECK(moved <= metres * (1 + 1e-9));
            CHECK(turned <= radians * (1 + 1e-9));
        }
    }
}

TFDB_TEST(adaptive_goes_as_far_as_one_interpolation_reaches) {
    RandomPoses random("adaptive_goes_as_far_as_one_interpolation_reaches", 72);
    const Pose from = random.pose();
    const Pose to{random.point(3.0), random.apart(from.rotation, 0.7)};
    Walk walk;
    for (int i = 0; i <= 5000; ++i) {
        walk.stamps.push_back(std::int64_t{1000} * i * i);
        walk.poses.push_back(interpolate(from, to, 1e-6 * i * i / 25.0));
    }
    CHECK(enough_rows(walk.stamps, walk.poses, 1e-9, 1e-7).size() == 2);
    walk.poses[1234].translation.z += 1.0;  // an outlier: it and its neighbours are kept
    const std::vector<std::size_t> around{0, 1233, 1234, 1235, 5000};
    CHECK(enough_rows(walk.stamps, walk.poses, 1e-9, 1e-7) == around);
}

TFDB_TEST(adaptive_of_no_one_and_two_rows) {
    RandomPoses random("adaptive_of_no_one_and_two_rows", 73);
    const Walk walk = random_walk(random, 2, 1.0, 1.0);
    CHECK(enough_rows({}, {}, 0.0, 0.0).empty());
    CHECK(enough_rows(std::span(walk.stamps).first(1), std::span(walk.poses).first(1), 0.0, 0.0)
              .size() == 1);
    CHECK(enough_rows(walk.stamps, walk.poses, kAny, kAny).size() == 2);
}

}  // namespace
}  // namespace tfdb::geometry
