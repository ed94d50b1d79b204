// Batches of stamps and points: equal to one lookup after another.
#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "tfdb/store/fixture.hpp"

namespace tfdb {
namespace {

using namespace fixture;
using lookup::PolicyKind;

constexpr StampNs kEnd = 40'000;

/// map <- a <- b <- c and map <- d: in order, late, static, re-parented in the middle.
Buffer forest() {
    Buffer buffer(keeping(std::nullopt));
    std::mt19937 random(3);
    std::vector<TransformView> batch;
    const auto some = [&] { return pose_of(static_cast<double>(random() % 1000) / 7); };
    for (StampNs stamp = 0; stamp <= kEnd; stamp += 20) {
        batch.push_back({"map", "a", stamp + static_cast<StampNs>(random() % 10), some()});
        batch.push_back({"b", "c", stamp, some()});
        batch.push_back({stamp < kEnd / 2 ? "map" : "a", "d", stamp, some()});
    }
    buffer.set_transforms(batch, false, "");
    set_static(buffer, "a", "b", pose_of(3));
    for (int i = 0; i < 200; ++i)
        set(buffer, "b", "c", static_cast<StampNs>(random() % kEnd), some());
    return buffer;
}

std::vector<StampNs> some_stamps(bool sorted, StampNs from, StampNs to) {
    std::mt19937_64 random(9);
    std::vector<StampNs> stamps(1500);
    for (StampNs& stamp : stamps)
        stamp = std::uniform_int_distribution<StampNs>(from, to)(random);
    if (sorted)
        std::sort(stamps.begin(), stamps.end());
    return stamps;
}

const Policy kPolicies[] = {{PolicyKind::kInterpolate, lookup::kNoLimit},
                            {PolicyKind::kInterpolate, 18},
                            {PolicyKind::kExact, lookup::kNoLimit},
                            {PolicyKind::kPrevious, lookup::kNoLimit},
                            {PolicyKind::kPrevious, 9},
                            {PolicyKind::kNearest, lookup::kNoLimit},
                            {PolicyKind::kNearest, 4},
                            {PolicyKind::kExtrapolate, 700}};

void check_row(const StoreReader& reads, const char* target, const char* source, StampNs stamp,
               const Policy& policy, const double* row) {
    std::optional<Pose> expected;
    try {
        expected = reads.lookup_transform(target, source, stamp, policy).pose;
    } catch (const Error&) {
    }
    if (!expected) {
        CHECK(std::all_of(row, row + 7, [](double x) { return std::isnan(x); }));
        return;
    }
    Pose got;
    std::copy_n(row, 7, &got.translation.x);
    CHECK(identical(got, *expected));
}

}  // namespace

/// Late samples with another parent, from a refused batch or newer than the snapshot. Stamps are
/// looked up in fours, so that each stamp follows any other.
TFDB_TEST(lookup_many_passes_over_what_its_state_does_not_show) {
    const auto ms = [](StampNs count) { return 1'000'000'000 + 1'000'000 * count; };
    for (const bool refused : {true, false}) {
        Buffer buffer(keeping(std::nullopt));
        set(buffer, "map", "other", ms(0), pose_of(5));
        for (const StampNs stamp : {26, 54, 68, 83})
            set(buffer, "map", "base", ms(stamp), pose_of(static_cast<double>(stamp)));
        std::optional<Snapshot> held;
        std::vector<const StoreReader*> asked{&buffer};
        if (!refused)
            asked.push_back(&held.emplace(buffer.snapshot()));
        std::vector<TransformView> late;
        for (const StampNs stamp : {2, 23, 58})
            late.push_back({"map", "base", ms(stamp), pose_of(99)});
        late.push_back({"other", "base", ms(51), pose_of(99)});
        if (refused) {
            late.push_back({"base", "map", ms(51), pose_of(1)});
            CHECK(THROWN(CycleError, buffer.set_transforms(late, false, "")));
        } else {
            buffer.set_transforms(late, false, "");
        }
        std::mt19937 random(4);
        for (int round = 0; round < 500; ++round) {
            std::array<StampNs, 4> stamps{};
            for (StampNs& stamp : stamps)
                stamp = ms(static_cast<StampNs>(random() % 100));
            for (const StoreReader* reads : asked) {
                for (const Policy& policy : kPolicies) {
                    std::array<double, 28> rows{};
                    reads->lookup_many("map", "base", stamps, policy, Layout::kPose, Missing::kNan,
                                       rows);
                    for (std::size_t i = 0; i < stamps.size(); ++i)
                        check_row(*reads, "map", "base", stamps[i], policy, &rows[7 * i]);
                }
            }
        }
    }
}

TFDB_TEST(lookup_many_equals_scalar_lookups_under_every_policy) {
    const Buffer buffer = forest();
    for (const auto& [target, source] :
         {std::pair{"map", "a"}, {"map", "c"}, {"c", "map"}, {"a", "a"}, {"c", "d"}, {"b", "a"}}) {
        for (const bool sorted : {true, false}) {
            const auto stamps = some_stamps(sorted, 0, kEnd + 900);
            std::vector<double> rows(7 * stamps.size());
            for (const Policy& policy : kPolicies) {
                buffer.lookup_many(target, source, stamps, policy, Layout::kPose, Missing::kNan,
                                   rows);
                for (std::size_t i = 0; i < stamps.size(); i += 3)
                    check_row(buffer, target, source, stamps[i], policy, &rows[7 * i]);
            }
        }
    }
}

TFDB_TEST(lookup_many_gives_matrices_of_the_same_poses) {
    const Buffer buffer = forest();
    const auto stamps = some_stamps(false, 100, kEnd - 100);
    std::vector<double> rows(7 * stamps.size());
    std::vector<double> matrices(16 * stamps.size());
    for (const char* target : {"map", "d"}) {
        buffer.lookup_many(target, "c", stamps, {}, Layout::kPose, Missing::kThrow, rows);
        buffer.lookup_many(target, "c", stamps, {}, Layout::kMatrix, Missing::kThrow, matrices);
        for (std::size_t i = 0; i < stamps.size(); ++i) {
            Pose pose;
            std::copy_n(&rows[7 * i], 7, &pose.translation.x);
            const double* m = &matrices[16 * i];
            const auto& [turn] = geometry::matrix(pose.rotation);
            for (std::size_t row = 0; row < 3; ++row)
                CHECK(std::equal(turn + 3 * row, turn + 3 * row + 3, m + 4 * row));
            const geometry::Vec3 p = geometry::apply(pose, {1.5, -2.5, 0.75});
            CHECK_NEAR(m[0] * 1.5 + m[1] * -2.5 + m[2] * 0.75 + m[3], p.x, 1e-9);
            CHECK_NEAR(m[4] * 1.5 + m[5] * -2.5 + m[6] * 0.75 + m[7], p.y, 1e-9);
            CHECK_NEAR(m[8] * 1.5 + m[9] * -2.5 + m[10] * 0.75 + m[11], p.z, 1e-9);
            CHECK(m[12] == 0.0 && m[13] == 0.0 && m[14] == 0.0 && m[15] == 1.0);
        }
    }
}

TFDB_TEST(lookup_many_says_which_stamp_was_refused_first) {
    const Buffer buffer = forest();
    for (const char* source : {"c", "d"}) {  // copied whole, and looked up one by one
        auto stamps = some_stamps(true, 100, kEnd - 100);
        stamps[700] = kEnd + 5000;
        stamps[900] = kEnd + 6000;
        std::vector<double> rows(7 * stamps.size());
        const auto error = THROWN(
            Extrapolation,
            buffer.lookup_many("map", source, stamps, {}, Layout::kPose, Missing::kThrow, rows));
        CHECK(error && error->detail().index == 700U && error->detail().stamp == kEnd + 5000);
        CHECK(error && error->detail().target == "map" && error->detail().source == source);
        buffer.lookup_many("map", source, stamps, {}, Layout::kPose, Missing::kNan, rows);
        for (std::size_t i = 0; i < stamps.size(); ++i)
            CHECK_EQ(std::isnan(rows[7 * i]), i == 700 || i == 900);
    }
    std::vector<double> row(7);
    const StampNs stamp = 100;
    for (const Missing missing : {Missing::kThrow, Missing::kNan}) {
        CHECK_THROWS_AS(
            buffer.lookup_many("nil", "c", {&stamp, 1}, {}, Layout::kPose, missing, row),
            UnknownFrame);
    }
}

TFDB_TEST(lookup_many_of_no_stamps_and_of_frames_in_two_trees) {
    Buffer buffer = forest();
    set_static(buffer, "space", "moon", pose_of(1));
    std::vector<double> row(7);
    buffer.lookup_many("map", "c", {}, {}, Layout::kPose, Missing::kThrow, {});
    const StampNs stamp = 100;
    CHECK_THROWS_AS(
        buffer.lookup_many("moon", "c", {&stamp, 1}, {}, Layout::kPose, Missing::kThrow, row),
        Disconnected);
    buffer.lookup_many("moon", "c", {&stamp, 1}, {}, Layout::kPose, Missing::kNan, row);
    CHECK(std::all_of(row.begin(), row.end(), [](double x) { return std::isnan(x); }));
}

namespace {

template <class Real>
void check_points(const StoreReader& reads, const char* source, std::size_t stride) {
    const auto stamps = some_stamps(stride == 3, 100, kEnd - 100);
    std::mt19937 random(4);
    std::vector<Real> points(stride * stamps.size());
    for (Real& number : points)
        number = static_cast<Real>(static_cast<double>(random() % 2000) / 100 - 10);
    std::vector<Real> out(3 * stamps.size());
    reads.transform_points("map", source, points.data(), stride, stamps.size(), stamps, {},
                           Missing::kThrow, out.data(), 3);
    auto in_place = points;
    reads.transform_points("map", source, in_place.data(), stride, stamps.size(), stamps, {},
                           Missing::kThrow, in_place.data(), stride);
    for (std::size_t i = 0; i < stamps.size(); ++i) {
        const Pose pose = reads.lookup_transform("map", source, stamps[i]).pose;
        const Real* p = &points[stride * i];
        const geometry::Vec3 moved = geometry::apply(pose, {p[0], p[1], p[2]});
        CHECK(out[3 * i] == static_cast<Real>(moved.x));
        CHECK(out[3 * i + 1] == static_cast<Real>(moved.y));
        CHECK(out[3 * i + 2] == static_cast<Real>(moved.z));
        CHECK(std::equal(&out[3 * i], &out[3 * i] + 3, &in_place[stride * i]));
        for (std::size_t more = 3; more < stride; ++more)
            CHECK(in_place[stride * i + more] == points[stride * i + more]);
    }
}

}  // namespace

TFDB_TEST(transform_points_equals_scalar_lookups_and_moves_none_twice) {
    const Buffer buffer = forest();
    for (const char* source : {"a", "c", "d"}) {  // d was re-parented: one lookup after another
        check_points<double>(buffer, source, 3);
        check_points<double>(buffer, source, 5);
        check_points<float>(buffer, source, 3);
        check_points<float>(buffer, source, 4);
    }
}

TFDB_TEST(transform_points_with_one_stamp_for_all) {
    const Buffer buffer = forest();
    const StampNs stamp = 12'345;
    std::vector<double> points(300);
    for (std::size_t i = 0; i < points.size(); ++i)
        points[i] = static_cast<double>(i) - 150;
    for (const char* source : {"c", "d"}) {
        const Pose pose = buffer.lookup_transform("map", source, stamp).pose;
        std::vector<double> out(300);
        buffer.transform_points("map", source, points.data(), 3, 100, {&stamp, 1}, {},
                                Missing::kThrow, out.data(), 3);
        for (std::size_t i = 0; i < 100; ++i) {
            const geometry::Vec3 moved =
                geometry::apply(pose, {points[3 * i], points[3 * i + 1], points[3 * i + 2]});
            CHECK(out[3 * i] == moved.x && out[3 * i + 1] == moved.y && out[3 * i + 2] == moved.z);
        }
    }
    const StampNs three[] = {1, 2, 3};
    CHECK_THROWS_AS(buffer.transform_points("map", "c", points.data(), 3, 100, three, {},
                                            Missing::kThrow, points.data(), 3),
                    InvalidArgument);
}

TFDB_TEST(transform_points_refused_in_place_leaves_every_point) {
    const Buffer buffer = forest();
    auto stamps = some_stamps(true, 100, kEnd - 100);
    stamps[1200] = kEnd + 5000;
    std::vector<double> points(3 * stamps.size(), 1.25);
    for (const char* source : {"c", "d"}) {
        const auto error = THROWN(
            Extrapolation, buffer.transform_points("map", source, points.data(), 3, stamps.size(),
                                                   stamps, {}, Missing::kThrow, points.data(), 3));
        CHECK(error && error->detail().index == 1200U);
        CHECK(std::all_of(points.begin(), points.end(), [](double x) { return x == 1.25; }));
        auto moved = points;
        buffer.transform_points("map", source, moved.data(), 3, stamps.size(), stamps, {},
                                Missing::kNan, moved.data(), 3);
        for (std::size_t i = 0; i < moved.size(); ++i)
            CHECK_EQ(std::isnan(moved[i]), i / 3 == 1200);
    }
}

namespace {

/// Rows of T[target<-source], each compared with the single lookup.
std::vector<double> rows_like_lookups(const StoreReader& reads, const char* target,
                                      const char* source, const std::vector<StampNs>& stamps,
                                      const Policy& policy) {
    std::vector<double> rows(7 * stamps.size());
    reads.lookup_many(target, source, stamps, policy, Layout::kPose, Missing::kNan, rows);
    for (std::size_t i = 0; i < stamps.size(); ++i)
        check_row(reads, target, source, stamps[i], policy, &rows[7 * i]);
    return rows;
}

Pose turned(double x, const geometry::Quat& rotation) {
    return {{x, 0.0, 0.0}, rotation};
}

}  // namespace

TFDB_TEST(lookup_many_from_a_quaternion_to_its_opposite) {
    Buffer buffer;
    set(buffer, "map", "base", 100, turned(100, {0.0, 0.0, 0.6, 0.8}));
    set(buffer, "map", "base", 200, turned(200, {0.0, 0.0, 0.0, 1.0}));
    set(buffer, "map", "base", 300, turned(300, {0.0, 0.0, 0.0, -1.0}));
    for (const Policy& policy : kPolicies) {
        rows_like_lookups(buffer, "map", "base", {150, 300}, policy);
        rows_like_lookups(buffer, "base", "map", {100, 150, 200, 250, 300}, policy);
    }
    std::vector<double> row(7);
    const StampNs end = 300;
    buffer.lookup_many("map", "base", {&end, 1}, {}, Layout::kPose, Missing::kThrow, row);
    CHECK(row == std::vector<double>({300, 0, 0, 0, 0, 0, -1}));
}

TFDB_TEST(lookup_many_at_half_a_turn) {
    Buffer buffer(keeping(std::nullopt));
    const auto yaw = [](double degrees) {
        const double half = degrees / 360.0 * 3.14159265358979323846;
        return geometry::Quat{0.0, 0.0, std::sin(half), std::cos(half)};
    };
    StampNs stamp = 0;
    for (const double from : {40.0, -140.0, 10.0, 0.0, 90.0, 123.456}) {
        set(buffer, "map", "base", stamp += 100, turned(1, yaw(from)));
        set(buffer, "map", "base", stamp += 100, turned(2, yaw(from + 180.0)));
        set(buffer, "map", "base", stamp += 100, turned(3, {0.0, 1.0, 0.0, 0.0}));
        set(buffer, "map", "base", stamp += 100, turned(4, {1.0, 0.0, 0.0, 0.0}));
    }
    std::vector<StampNs> stamps;
    for (StampNs at = 0; at <= stamp + 300; at += 25)
        stamps.push_back(at);
    for (const Policy& policy : kPolicies)
        rows_like_lookups(buffer, "map", "base", stamps, policy);
}

TFDB_TEST(lookup_many_where_parent_and_child_swapped_roles) {
    Buffer buffer(keeping(std::nullopt));
    set(buffer, "w", "f", 5, pose_of(1));
    const Snapshot before = buffer.snapshot();
    set(buffer, "g", "f", 30, pose_of(2));
    set(buffer, "f", "w", 40, pose_of(3));
    for (const Policy& policy : kPolicies) {
        for (const StoreReader* reads :
             std::initializer_list<const StoreReader*>{&buffer, &before}) {
            rows_like_lookups(*reads, "w", "f", {5}, policy);
            rows_like_lookups(*reads, "w", "f", {3, 5, 6, 20}, policy);
        }
        rows_like_lookups(buffer, "f", "w", {40, 5, 30, 41, 1000}, policy);
    }
    CHECK(identical(before.lookup_transform("w", "f", 5).pose, pose_of(1)));
    const Snapshot after = buffer.snapshot();
    const std::vector<StampNs> stamps{5, 6, 30, 40, 50};
    const std::vector<double> rows = rows_like_lookups(after, "w", "f", stamps, {});
    buffer.clear();
    const std::vector<double> again = rows_like_lookups(after, "w", "f", stamps, {});
    CHECK(std::memcmp(rows.data(), again.data(), 8 * rows.size()) == 0);
}

TFDB_TEST(lookups_refuse_what_is_not_finite) {
    Buffer buffer(keeping(std::nullopt));
    const Pose far{{1e308, 0.0, 0.0}, {0.0, 0.0, 0.0, 1.0}};
    const Pose back{{-1e308, 0.0, 0.0}, {0.0, 0.0, 0.0, 1.0}};
    for (const StampNs stamp : {10, 20}) {
        set(buffer, "map", "a", stamp, far);
        set(buffer, "a", "b", stamp, stamp == 10 ? far : back);
    }
    set(buffer, "map", "c", 10, back);
    set(buffer, "map", "c", 20, far);
    CHECK(identical(buffer.lookup_transform("map", "a", 20).pose, far));
    CHECK(identical(buffer.lookup_transform("map", "c", 20).pose, far));
    CHECK(number_of(buffer.lookup_transform("map", "b", 20).pose) == 0.0);
    for (const char* source : {"b", "c"}) {  // by a sum, and by the difference of two samples
        const StampNs stamp = source[0] == 'b' ? 10 : 15;
        const auto error = THROWN(InvalidTransform, buffer.lookup_transform("map", source, stamp));
        CHECK(error && error->detail().stamp == stamp && error->detail().source == source);
        CHECK(error && error->detail().reason == "not finite" && says(*error, "T[map<-"));
        FrameHandle map;
        FrameHandle handle;
        CHECK(buffer.find_frame("map", map) && buffer.find_frame(source, handle));
        Answer answer;
        Failure failure;
        CHECK(!buffer.ask(store::at_stamp(map, handle, stamp, {}), answer, failure));
        CHECK(!buffer.ask(store::at_stamp(handle, map, stamp, {}), answer, failure));
        const std::vector<double> rows =
            rows_like_lookups(buffer, "map", source, {20, stamp, 20}, {});
        CHECK(std::isnan(rows[7]) && !std::isnan(rows[0]) && !std::isnan(rows[14]));
        const std::vector<StampNs> stamps{20, stamp};
        std::vector<double> out(14);
        const auto refused = THROWN(
            InvalidTransform,
            buffer.lookup_many("map", source, stamps, {}, Layout::kPose, Missing::kThrow, out));
        CHECK(refused && refused->detail().index == 1U);
        std::vector<double> points(6, 1.25);
        CHECK_THROWS_AS(buffer.transform_points("map", source, points.data(), 3, 2, stamps, {},
                                                Missing::kThrow, points.data(), 3),
                        InvalidTransform);
        CHECK(std::all_of(points.begin(), points.end(), [](double x) { return x == 1.25; }));
    }
    CHECK_THROWS_AS(buffer.lookup_velocity("map", "c", 15, 10, "", {}, ""), InvalidTransform);
    set(buffer, "a", "b", 30, far);
    CHECK_THROWS_AS(buffer.lookup_latest_transform("map", "b"), InvalidTransform);
}

TFDB_TEST(batches_refuse_an_output_that_lies_over_the_input) {
    const Buffer buffer = forest();
    std::vector<double> memory(400);
    auto* const stamps = reinterpret_cast<StampNs*>(memory.data() + 20);
    for (StampNs i = 0; i < 10; ++i)
        new (stamps + i) StampNs(100 + i);
    const std::span<const StampNs> when(stamps, 10);
    const std::span<double> all(memory);
    const auto rows = [&](std::size_t first) {
        buffer.lookup_many("map", "a", when, {}, Layout::kPose, Missing::kNan,
                           all.subspan(first, 70));
    };
    CHECK_THROWS_AS(rows(0), InvalidArgument);
    CHECK_THROWS_AS(rows(29), InvalidArgument);
    rows(30);
    const auto points = [&](double* from, double* to) {
        buffer.transform_points("map", "a", from, 3, 10, when, {}, Missing::kThrow, to, 3);
    };
    CHECK_THROWS_AS(points(&memory[100], &memory[10]), InvalidArgument);   // over the stamps
    CHECK_THROWS_AS(points(&memory[100], &memory[103]), InvalidArgument);  // over later points
    CHECK_THROWS_AS(points(&memory[100], &memory[71]), InvalidArgument);
    points(&memory[100], &memory[130]);
    points(&memory[100], &memory[100]);
    CHECK(stamps[9] == 109);
}

TFDB_TEST(path_stamps_of_random_edges_are_the_union_of_theirs) {
    std::mt19937 random(9);
    for (int round = 0; round < 60; ++round) {
        Buffer buffer(keeping(std::nullopt));
        std::set<StampNs> all;
        StampNs first = 0;
        StampNs last = 1'000'000;
        std::string parent = "f0";
        for (int edge = 1; edge <= 4; ++edge) {
            const std::string child = "f" + std::to_string(edge);
            std::set<StampNs> own;
            const auto step = static_cast<StampNs>(1 + random() % 3);
            for (int i = 0; i < 300; ++i)
                own.insert(static_cast<StampNs>(random() % 400) * step);
            for (const StampNs stamp : own)
                set(buffer, parent, child, stamp, pose_of(1));
            all.insert(own.begin(), own.end());
            first = std::max(first, *own.begin());
            last = std::min(last, *own.rbegin());
            parent = child;
        }
        const std::vector<StampNs> expected(all.lower_bound(first), all.upper_bound(last));
        CHECK(buffer.path_stamps("f0", "f4", {}, {}) == expected);
    }
}

TFDB_TEST(path_stamps_are_those_of_the_moving_edges_within_what_all_cover) {
    Buffer buffer(keeping(std::nullopt));
    for (const StampNs stamp : {10, 20, 30, 40, 50})
        set(buffer, "map", "a", stamp, pose_of(1));
    for (const StampNs stamp : {15, 25, 30, 45, 60})
        set(buffer, "a", "b", stamp, pose_of(2));
    set_static(buffer, "b", "c", pose_of(3));
    using Stamps = std::vector<StampNs>;
    CHECK(buffer.path_stamps("map", "c", {}, {}) == Stamps({15, 20, 25, 30, 40, 45, 50}));
    CHECK(buffer.path_stamps("c", "map", 21, 44) == Stamps({25, 30, 40}));
    CHECK(buffer.path_stamps("b", "c", {}, {}).empty());
    CHECK(buffer.path_stamps("a", "a", {}, {}).empty());
}

}  // namespace tfdb
