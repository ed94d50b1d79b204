// Every kernel that this processor can run gives the same bits as the functions on single poses.
#include "tfdb/geometry/batch_kernels.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <memory>

#include "tfdb/geometry/random_pose.hpp"
#include "tfdb/geometry/slerp.hpp"
#include "tfdb/testing/check.hpp"

namespace tfdb::geometry {
namespace {

using testing::RandomPoses;

template <class Numbers>
bool identical(const Numbers& a, const Numbers& b) {
    return std::memcmp(&a, &b, sizeof a) == 0;
}

/// A sample in the store's format.
struct alignas(64) Slot {
    std::uint64_t word = 7;
    Pose pose{};
};
static_assert(sizeof(Slot) == 64);

constexpr SlotWords kWords{7, 7 + (9 << 4), 15};

/// One edge: samples, and stamps between them with their pairs.
struct Scene {
    std::vector<Slot> slots;
    std::vector<StampNs> samples;
    std::vector<StampNs> stamps;
    std::unique_ptr<Pairs> pairs = std::make_unique<Pairs>();
    std::vector<std::size_t> before;  // index for each stamp; the sample itself if it is held
    std::vector<bool> held;

    [[nodiscard]] Pose pose_at(std::size_t i) const {
        const std::size_t k = before[i];
        if (held[i])
            return slots[k].pose;
        return interpolate(slots[k].pose, slots[k + 1].pose,
                           share(samples[k], samples[k + 1], stamps[i]));
    }
};

/// The next sample's quaternion, with rotations of every width: zero, within and beyond each
/// series, half a turn, and the opposite quaternion of the same rotation.
Quat turned(RandomPoses& random, const Quat& before, std::size_t i) {
    constexpr std::array kAngles = {0.0,   1e-8,  0.02, 0.0278, 0.0280, 0.15,
                                    0.191, 0.193, 0.8,  1.5707, 1.571};
    Quat q = random.apart(before, kAngles[static_cast<std::size_t>(random.stamp(0, 10))]);
    if (i % 5 == 0)
        q = {-before.y, before.x, -before.w, before.z};  // the dot product is 0
    if (i % 3 == 0)
        q = {-q.x, -q.y, -q.z, -q.w};
    if (i % 7 == 0)
        q = {-before.x, -before.y, -before.z, -before.w};
    return q;
}

/// `run`: approximate number of stamps between two samples; some lie on a sample, some are held.
Scene make_scene(RandomPoses& random, std::size_t count, std::size_t run) {
    Scene scene;
    constexpr StampNs kStart = StampNs{1} << 60;
    for (std::size_t i = 0; i < count + 2; ++i) {
        const StampNs gap = i % 11 == 0 ? StampNs{1} << 52 : random.stamp(1, 40'000'000);
        scene.samples.push_back(i == 0 ? kStart : scene.samples.back() + gap);
        Slot& slot = scene.slots.emplace_back();
        slot.word += static_cast<std::uint64_t>(random.stamp(0, 9)) << 4;
        slot.pose = random.pose(i % 13 == 0 ? 1e150 : 3.0);
        if (i > 0)
            slot.pose.rotation = turned(random, scene.slots[i - 1].pose.rotation, i);
    }
    std::size_t k = 0;
    bool held = false;
    for (std::size_t i = 0; i < count; ++i) {
        const bool next = i == 0 || static_cast<std::size_t>(random.stamp(0, 99)) * run < 100;
        if (next) {
            k = i == 0 ? 0 : k + 1;
            held = random.stamp(0, 9) == 0;
            scene.pairs->add(
                scene.samples[k],
                held ? Pairs::kHeld : static_cast<double>(scene.samples[k + 1] - scene.samples[k]),
                &scene.slots[k], &scene.slots[held ? k : k + 1]);
        }
        scene.pairs->of[i] = static_cast<std::uint32_t>(k);
        scene.before.push_back(k);
        scene.held.push_back(held);
        const StampNs from = scene.samples[k];
        scene.stamps.push_back(
            random.stamp(0, 3) == 0 ? from : random.stamp(from, scene.samples[k + 1] - 1));
        if (held && random.stamp(0, 1) == 0)
            scene.stamps.back() = from - 5;  // the nearest sample may come later
    }
    return scene;
}

void check_block(const PoseBlock& block, const std::vector<Pose>& expected) {
    for (std::size_t i = 0; i < expected.size(); ++i)
        CHECK(identical(pose_at(block, i), expected[i]));
}

/// Whole groups, and sizes of blocks that batches have.
constexpr std::array kCounts = {kGroup, 2 * kGroup, 5 * kGroup, kBlock};

}  // namespace

TFDB_TEST(kernels_interpolate_and_compose_as_single_poses) {
    RandomPoses random("kernels_interpolate_and_compose_as_single_poses", 31);
    for (int round = 0; round < 40; ++round) {
        for (const std::size_t run : {1, 2, 9, 60}) {
            const std::size_t count = kCounts[static_cast<std::size_t>(round) % kCounts.size()];
            Scene first = make_scene(random, count, run);
            Scene second = make_scene(random, count, run);
            const Pose fixed = random.pose();
            std::vector<Pose> one;
            std::vector<Pose> two;
            std::vector<Pose> meeting;
            for (std::size_t i = 0; i < count; ++i) {
                one.push_back(first.pose_at(i));
                two.push_back(compose(fixed, compose(second.pose_at(i), one[i])));
                meeting.push_back(compose(inverse(one[i]), two[i]));
            }
            for (const Kernels* const kernels : runnable_kernels()) {
                const auto block = std::make_unique<PoseBlock>();
                const auto other = std::make_unique<PoseBlock>();
                CHECK(kernels->load(*first.pairs, kWords));
                kernels->join(*block, count, first.stamps.data(), *first.pairs, true);
                check_block(*block, one);
                *other = *block;
                CHECK(kernels->load(*second.pairs, kWords));
                kernels->join(*block, count, second.stamps.data(), *second.pairs, false);
                kernels->join_constant(*block, count, fixed, false);
                check_block(*block, two);
                kernels->meet(*block, *other, count);
                check_block(*block, meeting);
                kernels->turn(*other, count);
                for (std::size_t i = 0; i < count; ++i)
                    CHECK(identical(pose_at(*other, i), inverse(one[i])));
                kernels->join_constant(*block, count, fixed, true);
                check_block(*block, std::vector<Pose>(count, fixed));
            }
        }
    }
}

TFDB_TEST(kernels_tell_slots_that_are_others) {
    RandomPoses random("kernels_tell_slots_that_are_others", 32);
    for (int round = 0; round < 200; ++round) {
        Scene scene = make_scene(random, kBlock, 2);
        const auto k =
            static_cast<std::size_t>(random.stamp(0, static_cast<StampNs>(scene.pairs->count) - 1));
        std::uint64_t& word = scene.slots[k].word;
        const std::uint64_t right = word;
        for (const Kernels* const kernels : runnable_kernels()) {
            for (const std::uint64_t wrong : {kWords.least - 16, kWords.most + 16, right ^ 8,
                                              std::uint64_t{0}, ~std::uint64_t{0}}) {
                word = wrong;
                CHECK(!kWords.contain(wrong) && !kernels->load(*scene.pairs, kWords));
            }
            word = right;
            CHECK(kWords.contain(right) && kernels->load(*scene.pairs, kWords));
        }
    }
}

TFDB_TEST(kernels_find_what_is_not_finite) {
    RandomPoses random("kernels_find_what_is_not_finite", 33);
    for (const Kernels* const kernels : runnable_kernels()) {
        const auto block = std::make_unique<PoseBlock>();
        kernels->join_constant(*block, kBlock, random.pose(1e300), true);
        CHECK(kernels->all_finite(*block, kBlock));
        for (std::size_t i = 0; i < kBlock; ++i) {
            for (double* const column : {block->x, block->y, block->z}) {
                for (const double bad : {std::nan(""), HUGE_VAL, -HUGE_VAL}) {
                    const double good = std::exchange(column[i], bad);
                    CHECK(!kernels->all_finite(*block, kBlock));
                    CHECK_EQ(kernels->all_finite(*block, i / kGroup * kGroup), true);
                    column[i] = good;
                }
            }
        }
    }
}

namespace {

template <class Number>
void judge_points(RandomPoses& random, const Kernels& kernels, const PoseBlock& block,
                  std::size_t count, std::size_t stride) {
    std::vector<Number> points(count * stride + 1, Number{42});
    for (std::size_t i = 0; i < count * stride; ++i)
        points[i] = static_cast<Number>(3.0 * random.normal());
    std::vector<Number> each = points;
    std::vector<Number> all(3 * count + 1, Number{42});
    const auto rows = [](auto& from, std::size_t step) {
        return PointRows<Number>{from.data(), static_cast<std::ptrdiff_t>(step)};
    };
    const PointRows<const Number> in{points.data(), static_cast<std::ptrdiff_t>(stride)};
    const PointRows<const Number> in_place{each.data(), static_cast<std::ptrdiff_t>(stride)};
    const Pose one = pose_at(block, 0);
    if constexpr (std::is_same_v<Number, double>) {
        kernels.move_doubles(block, count, in_place, rows(each, stride));
        kernels.move_doubles_by_one(one, count, in, rows(all, 3));
    } else {
        kernels.move_floats(block, count, in_place, rows(each, stride));
        kernels.move_floats_by_one(one, count, in, rows(all, 3));
    }
    const auto check = [&](std::size_t i, const Pose& pose, const Number* found) {
        const Number* const p = &points[stride * i];
        const Vec3 moved = apply(pose, {double{p[0]}, double{p[1]}, double{p[2]}});
        CHECK(found[0] == static_cast<Number>(moved.x) &&
              found[1] == static_cast<Number>(moved.y) && found[2] == static_cast<Number>(moved.z));
    };
    for (std::size_t i = 0; i < count; ++i) {
        check(i, pose_at(block, i), &each[stride * i]);
        check(i, one, &all[3 * i]);
        for (std::size_t more = 3; more < stride; ++more)
            CHECK(each[stride * i + more] == points[stride * i + more]);
    }
    CHECK(each.back() == Number{42} && all.back() == Number{42});
}

}  // namespace

TFDB_TEST(kernels_write_rows_and_move_points_of_any_count) {
    RandomPoses random("kernels_write_rows_and_move_points_of_any_count", 34);
    const auto block = std::make_unique<PoseBlock>();
    for (std::size_t i = 0; i < kBlock; ++i)
        put_pose(*block, i, random.pose());
    for (const Kernels* const kernels : runnable_kernels()) {
        for (const std::size_t count : {1, 2, 3, 4, 5, 7, 8, 9, 100, 128}) {
            std::vector<double> poses(7 * count + 1, 42.0);
            std::vector<double> matrices(16 * count + 1, 42.0);
            kernels->store_poses(*block, count, poses.data());
            kernels->store_matrices(*block, count, matrices.data());
            for (std::size_t i = 0; i < count; ++i) {
                const Pose pose = pose_at(*block, i);
                CHECK(std::memcmp(&pose, &poses[7 * i], sizeof pose) == 0);
                const auto& [m] = matrix(pose.rotation);
                const Vec3& t = pose.translation;
                const double whole[16] = {m[0], m[1], m[2], t.x, m[3], m[4], m[5], t.y,
                                          m[6], m[7], m[8], t.z, 0.0,  0.0,  0.0,  1.0};
                CHECK(std::memcmp(whole, &matrices[16 * i], sizeof whole) == 0);
            }
            CHECK(poses.back() == 42.0 && matrices.back() == 42.0);
            for (const std::size_t stride : {3, 4, 5}) {
                judge_points<double>(random, *kernels, *block, count, stride);
                judge_points<float>(random, *kernels, *block, count, stride);
            }
        }
    }
}

}  // namespace tfdb::geometry
