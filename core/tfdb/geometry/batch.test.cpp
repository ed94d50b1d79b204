#include "tfdb/geometry/batch.hpp"

#include <cmath>
#include <cstring>
#include <limits>

#include "tfdb/geometry/random_track.hpp"
#include "tfdb/testing/check.hpp"

namespace tfdb::geometry {
namespace {

using testing::evaluate_one;
using testing::make_stamps;
using testing::make_static;
using testing::make_track;
using testing::RandomPoses;
using testing::RandomTrack;
using testing::ScalarAnswer;
using testing::TrackShape;

using Sizes = std::initializer_list<std::size_t>;

constexpr KernelChoice kBoth[] = {KernelChoice::kBest, KernelChoice::kPortable};

Pose pose_of_row(const double* row) {
    return Pose{{row[0], row[1], row[2]}, {row[3], row[4], row[5], row[6]}};
}

template <class Numbers>
bool identical(const Numbers& a, const Numbers& b) {
    return std::memcmp(&a, &b, sizeof a) == 0;
}

bool all_nan(const double* row, std::size_t width) {
    return std::all_of(row, row + width, [](double value) { return std::isnan(value); });
}

/// Tracks that overlap in [low, high], and a path through them.
struct Scene {
    std::vector<RandomTrack> tracks;
    std::vector<TrackView> source_side;
    std::vector<TrackView> target_side;
    StampNs low = 0;
    StampNs high = std::numeric_limits<StampNs>::max();

    void add(RandomTrack track, bool inverted) {
        if (!track.is_static) {
            low = std::max(low, track.stamps.front());
            high = std::min(high, track.stamps.back());
        }
        tracks.push_back(std::move(track));
        (inverted ? target_side : source_side).push_back(tracks.back().view());
    }
    [[nodiscard]] Path path() const { return {source_side, target_side}; }
};

Scene moving_scene(RandomPoses& random, std::size_t edges, const TrackShape& shape) {
    Scene scene;
    scene.tracks.reserve(edges);
    for (std::size_t i = 0; i < edges; ++i) {
        scene.add(make_track(random, shape), i % 2 == 1);
    }
    return scene;
}

/// Poses and matrices are those of the scalar loop, bit for bit.
void judge_poses(const Scene& scene, const Rule& rule, const std::vector<StampNs>& stamps,
                 KernelChoice choice) {
    BatchScratch scratch(choice);
    std::vector<double> poses(7 * stamps.size() + 1, 42.0);
    std::vector<double> matrices(16 * stamps.size() + 1, 42.0);
    const BatchResult result = evaluate_poses(scene.path(), rule, stamps, PoseLayout::kPose,
                                              poses.data(), OnRefused::kNan, scratch);
    evaluate_poses(scene.path(), rule, stamps, PoseLayout::kMatrix, matrices.data(),
                   OnRefused::kNan, scratch);
    std::size_t refused = 0;
    std::size_t first = kNoneRefused;
    for (std::size_t i = 0; i < stamps.size(); ++i) {
        const ScalarAnswer expected = evaluate_one(scene.path(), rule, stamps[i]);
        const double* row = poses.data() + 7 * i;
        const double* rows = matrices.data() + 16 * i;
        if (expected.refused) {
            CHECK(all_nan(row, 7) && all_nan(rows, 16));
            ++refused;
            first = std::min(first, i);
            continue;
        }
        CHECK(identical(pose_of_row(row), expected.pose));
        const auto& [m] = matrix(expected.pose.rotation);
        const Vec3& t = expected.pose.translation;
        const double whole[16] = {m[0], m[1], m[2], t.x, m[3], m[4], m[5], t.y,
                                  m[6], m[7], m[8], t.z, 0.0,  0.0,  0.0,  1.0};
        CHECK(std::memcmp(whole, rows, sizeof whole) == 0);
    }
    CHECK_EQ(result.refused, refused);
    CHECK_EQ(result.first_refused, first);
    CHECK_EQ(poses.back(), 42.0);
    CHECK_EQ(matrices.back(), 42.0);
    CHECK_EQ(first_refused(scene.path(), rule, stamps, scratch), first);
}

TFDB_TEST(batch_poses_equal_the_scalar_loop) {
    RandomPoses random("batch_poses_equal_the_scalar_loop", 11);
    for (const double turn : {0.001, 0.02, 0.15, 1.5}) {
        for (const std::size_t size : Sizes{2, 3, 7, 300}) {
            for (const std::size_t edges : Sizes{1, 2, 3, 6}) {
                const TrackShape shape{.size = size, .turn = turn, .flip = 0.1};
                const Scene scene = moving_scene(random, edges, shape);
                if (scene.low > scene.high) {
                    continue;
                }
                for (const std::size_t count : Sizes{1, 2, 3, 4, 5, 255, 256, 257, 3000}) {
                    for (const bool sorted : {true, false}) {
                        const auto stamps = make_stamps(random, scene.tracks[0], scene.low,
                                                        scene.high, count, sorted);
                        for (const KernelChoice choice : kBoth) {
                            judge_poses(scene, Rule{}, stamps, choice);
                        }
                    }
                }
            }
        }
    }
}

TFDB_TEST(batch_of_angles_of_every_width_in_one_group) {
    RandomPoses random("batch_of_angles_of_every_width_in_one_group", 12);
    // From one sample to the next: by nothing, by less and more than each series takes, by half a
    // turn (90 degrees of the sphere), and to the other quaternion of the same rotation.
    const double angles[] = {0.0,   1e-8,  0.02, 0.0278, 0.0280, 0.15,
                             0.191, 0.193, 0.8,  1.5707, 1.571};
    RandomTrack track = make_track(random, {.size = 4000});
    for (std::size_t i = 1; i < track.poses.size(); ++i) {
        const Quat& before = track.poses[i - 1].rotation;
        const double angle = angles[static_cast<std::size_t>(random.stamp(0, 10))];
        Quat& q = track.poses[i].rotation;
        q = random.apart(before, angle);
        if (i % 5 == 0) {
            q = {-before.y, before.x, -before.w, before.z};  // the dot product is 0
        }
        if (i % 3 == 0) {
            q = {-q.x, -q.y, -q.z, -q.w};
        }
        if (i % 7 == 0) {
            q = {-before.x, -before.y, -before.z, -before.w};
        }
    }
    Scene scene;
    scene.tracks.reserve(1);
    scene.add(std::move(track), false);
    for (const bool sorted : {true, false}) {
        auto stamps = make_stamps(random, scene.tracks[0], scene.low, scene.high, 60'000, sorted);
        for (const Selection selection : {Selection::kInterpolate, Selection::kExtrapolate,
                                          Selection::kPrevious, Selection::kNearest}) {
            for (const KernelChoice choice : kBoth) {
                judge_poses(scene, {selection, kNoLimit}, stamps, choice);
            }
        }
    }
}

TFDB_TEST(batch_gives_samples_as_they_are_stored) {
    RandomPoses random("batch_gives_samples_as_they_are_stored", 20);
    // q, then exactly -q: half way between them there is no turn to make.
    RandomTrack track = make_track(random, {.size = 300, .turn = 1.5, .flip = 0.5});
    track.poses[100].translation = {-1e308, 0.0, -0.0};
    track.poses[101].translation = {1e308, -0.0, 0.0};
    Scene scene;
    scene.tracks.reserve(1);
    scene.add(std::move(track), false);
    const RandomTrack& stored = scene.tracks[0];
    for (const Selection selection : {Selection::kInterpolate, Selection::kExact}) {
        for (const KernelChoice choice : kBoth) {
            BatchScratch scratch(choice);
            std::vector<double> rows(7 * stored.stamps.size());
            evaluate_poses(scene.path(), {selection, kNoLimit}, stored.stamps, PoseLayout::kPose,
                           rows.data(), OnRefused::kStop, scratch);
            CHECK(std::memcmp(rows.data(), stored.poses.data(), 8 * rows.size()) == 0);
        }
    }
}

TFDB_TEST(batch_folds_constant_edges) {
    RandomPoses random("batch_folds_constant_edges", 13);
    for (int round = 0; round < 200; ++round) {
        Scene scene;
        const auto edges = static_cast<std::size_t>(random.stamp(0, 9));
        scene.tracks.reserve(edges);
        for (std::size_t i = 0; i < edges; ++i) {
            const bool inverted = random.uniform(0.0, 1.0) < 0.5;
            if (random.uniform(0.0, 1.0) < 0.6) {
                scene.add(make_static(random), inverted);
            } else {
                scene.add(make_track(random, {.turn = 0.05}), inverted);
            }
        }
        const RandomTrack none;
        scene.high = std::min(scene.high, TrackShape{}.start * 2);
        const auto stamps = make_stamps(random, none, scene.low, scene.high, 130, round % 2 == 0);
        for (const KernelChoice choice : kBoth) {
            judge_poses(scene, Rule{}, stamps, choice);
        }
    }
}

TFDB_TEST(batch_obeys_every_rule_as_the_scalar_loop_does) {
    RandomPoses random("batch_obeys_every_rule_as_the_scalar_loop_does", 14);
    const Selection selections[] = {Selection::kInterpolate, Selection::kExact,
                                    Selection::kPrevious, Selection::kNearest,
                                    Selection::kExtrapolate};
    for (const Selection selection : selections) {
        for (const StampNs limit : {StampNs{0}, StampNs{900'000}, StampNs{3'000'000}, kNoLimit}) {
            for (const std::size_t size : Sizes{1, 2, 3, 40}) {
                const TrackShape shape{.size = size, .turn = 0.2, .flip = 0.1, .new_parent = 0.2};
                Scene scene = moving_scene(random, 2, shape);
                const RandomTrack& track = scene.tracks[0];
                const StampNs low = track.stamps.front() - 2'000'000;
                const StampNs high = track.stamps.back() + 2'000'000;
                for (const bool sorted : {true, false}) {
                    const auto stamps = make_stamps(random, track, low, high, 700, sorted);
                    for (const KernelChoice choice : kBoth) {
                        // One edge first: two random tracks are rarely both met exactly.
                        Scene lone;
                        lone.source_side = {scene.source_side[0]};
                        judge_poses(lone, {selection, limit}, stamps, choice);
                        judge_poses(scene, {selection, limit}, stamps, choice);
                    }
                }
            }
        }
    }
}

TFDB_TEST(batch_without_samples_or_stamps) {
    RandomPoses random("batch_without_samples_or_stamps", 15);
    for (const KernelChoice choice : kBoth) {
        BatchScratch scratch(choice);
        const std::vector<StampNs> stamps(300, 5);
        std::vector<double> out(7 * 300, 42.0);
        const auto run = [&](const Path& path, std::span<const StampNs> at, OnRefused on_refused) {
            return evaluate_poses(path, Rule{}, at, PoseLayout::kPose, out.data(), on_refused,
                                  scratch);
        };
        const TrackView nothing;
        const Path empty_track{{&nothing, 1}, {}};
        CHECK_EQ(run(empty_track, stamps, OnRefused::kStop).first_refused, std::size_t{0});
        CHECK_EQ(out[0], 42.0);
        CHECK_EQ(run(empty_track, stamps, OnRefused::kNan).refused, stamps.size());
        CHECK(all_nan(out.data(), out.size()));
        CHECK_EQ(run(empty_track, {}, OnRefused::kStop).first_refused, kNoneRefused);
        CHECK_EQ(run({}, stamps, OnRefused::kStop).refused, std::size_t{0});
        CHECK(identical(pose_of_row(out.data() + 7 * 299), identity()));
    }
}

TFDB_TEST(batch_that_stops_writes_nothing) {
    RandomPoses random("batch_that_stops_writes_nothing", 16);
    const Scene scene = moving_scene(random, 3, {});
    auto stamps = make_stamps(random, scene.tracks[0], scene.low, scene.high, 2000, true);
    stamps[1234] = scene.high + 1'000'000'000;
    stamps[1300] = scene.low - 1'000'000'000;
    for (const KernelChoice choice : kBoth) {
        BatchScratch scratch(choice);
        std::vector<double> out(16 * stamps.size(), 42.0);
        const BatchResult result = evaluate_poses(scene.path(), Rule{}, stamps, PoseLayout::kMatrix,
                                                  out.data(), OnRefused::kStop, scratch);
        CHECK_EQ(result.first_refused, std::size_t{1234});
        CHECK_EQ(result.refused, std::size_t{1});
        CHECK(std::all_of(out.begin(), out.end(), [](double v) { return v == 42.0; }));
        std::vector<float> points(3 * stamps.size(), 42.0F);
        const BatchResult moved =
            transform_points(scene.path(), Rule{}, stamps, stamps.size(), {points.data()},
                             {points.data()}, OnRefused::kStop, scratch);
        CHECK_EQ(moved.first_refused, std::size_t{1234});
        CHECK(std::all_of(points.begin(), points.end(), [](float v) { return v == 42.0F; }));
    }
}

// --- points ----------------------------------------------------------------------------------

struct PointCase {
    std::size_t count;
    std::ptrdiff_t in_stride;
    std::ptrdiff_t out_stride;
    bool in_place;
    bool one_stamp;
};

template <class Number>
void judge_points(RandomPoses& random, const Scene& scene, const PointCase& c,
                  KernelChoice choice) {
    BatchScratch scratch(choice);
    const std::size_t stamp_count = c.one_stamp ? 1 : c.count;
    auto stamps = make_stamps(random, scene.tracks[0], scene.low, scene.high, stamp_count, false);
    const bool some_refused = !c.one_stamp && c.count > 10;
    if (some_refused) {
        stamps[7] = scene.low - 1'000'000'000;
    }
    const auto in_stride = static_cast<std::size_t>(c.in_stride);
    const auto out_stride = static_cast<std::size_t>(c.in_place ? c.in_stride : c.out_stride);
    std::vector<Number> in(c.count * in_stride + 1, Number{42});
    for (std::size_t i = 0; i < c.count; ++i) {
        for (std::size_t k = 0; k < 3; ++k) {
            in[i * in_stride + k] = static_cast<Number>(3.0 * random.normal());
        }
    }
    const std::vector<Number> original = in;
    std::vector<Number> other(c.count * out_stride + 1, Number{42});
    std::vector<Number>& out = c.in_place ? in : other;
    const BatchResult result = transform_points(
        scene.path(), Rule{}, stamps, c.count, PointRows<const Number>{in.data(), c.in_stride},
        PointRows<Number>{out.data(), static_cast<std::ptrdiff_t>(out_stride)}, OnRefused::kNan,
        scratch);
    CHECK_EQ(result.refused, std::size_t{some_refused ? 1U : 0U});
    for (std::size_t i = 0; i < c.count; ++i) {
        const Number* row = out.data() + i * out_stride;
        for (std::size_t k = 3; k < out_stride; ++k) {
            CHECK_EQ(row[k], Number{42});
        }
        const ScalarAnswer at = evaluate_one(scene.path(), Rule{}, stamps[c.one_stamp ? 0 : i]);
        if (at.refused) {
            CHECK(std::isnan(row[0]) && std::isnan(row[1]) && std::isnan(row[2]));
            continue;
        }
        const Number* from = original.data() + i * in_stride;
        const Vec3 p = apply(at.pose, {double{from[0]}, double{from[1]}, double{from[2]}});
        const Number moved[3] = {static_cast<Number>(p.x), static_cast<Number>(p.y),
                                 static_cast<Number>(p.z)};
        CHECK(std::memcmp(moved, row, sizeof moved) == 0);
    }
    CHECK_EQ(out.back(), Number{42});
}

TFDB_TEST(batch_points_move_each_at_its_own_stamp) {
    RandomPoses random("batch_points_move_each_at_its_own_stamp", 17);
    const Scene scene = moving_scene(random, 3, {.turn = 0.1});
    for (const std::size_t count : Sizes{1, 2, 3, 5, 255, 256, 257, 1000}) {
        for (const std::ptrdiff_t stride : {3, 4, 7}) {
            for (const bool in_place : {true, false}) {
                for (const bool one_stamp : {true, false}) {
                    const PointCase c{count, stride, count % 2 == 0 ? 5 : 3, in_place, one_stamp};
                    for (const KernelChoice choice : kBoth) {
                        judge_points<double>(random, scene, c, choice);
                        judge_points<float>(random, scene, c, choice);
                    }
                }
            }
        }
    }
}

TFDB_TEST(batch_points_may_run_backwards_and_may_be_none) {
    RandomPoses random("batch_points_may_run_backwards_and_may_be_none", 18);
    const Pose pose = random.pose();
    for (const KernelChoice choice : kBoth) {
        BatchScratch scratch(choice);
        std::vector<double> in(3 * 50);
        for (double& value : in) {
            value = random.normal();
        }
        std::vector<double> out(in.size(), 0.0);
        // A reversed numpy view: the first row lies last in memory.
        transform_points(pose, 50, {in.data() + 3 * 49, -3}, {out.data()}, scratch);
        for (std::size_t i = 0; i < 50; ++i) {
            const double* from = in.data() + 3 * (49 - i);
            const double* to = out.data() + 3 * i;
            CHECK(identical(apply(pose, {from[0], from[1], from[2]}), Vec3{to[0], to[1], to[2]}));
        }
        transform_points(pose, 0, PointRows<const double>{}, PointRows<double>{}, scratch);
    }
}

TFDB_TEST(batch_scratch_can_be_used_again_for_other_paths) {
    RandomPoses random("batch_scratch_can_be_used_again_for_other_paths", 19);
    BatchScratch scratch;
    for (int round = 0; round < 60; ++round) {
        const auto size = static_cast<std::size_t>(random.stamp(2, 2000));
        const Scene scene =
            moving_scene(random, 1 + static_cast<std::size_t>(round % 3), {.size = size});
        if (scene.low > scene.high) {
            continue;
        }
        const auto stamps =
            make_stamps(random, scene.tracks[0], scene.low, scene.high, 400, round % 2 == 0);
        std::vector<double> out(7 * stamps.size());
        evaluate_poses(scene.path(), Rule{}, stamps, PoseLayout::kPose, out.data(),
                       OnRefused::kStop, scratch);
        for (std::size_t i = 0; i < stamps.size(); i += 17) {
            CHECK(identical(pose_of_row(out.data() + 7 * i),
                            evaluate_one(scene.path(), Rule{}, stamps[i]).pose));
        }
    }
}

}  // namespace
}  // namespace tfdb::geometry
