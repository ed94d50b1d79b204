// Nanoseconds per stamp of the batch functions: paths of 1 and 4 moving edges of 10,000 jittered
// samples at 1 kHz, 100,000 stamps. Each figure is the best of several passes.

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <random>
#include <vector>

#include "tfdb/geometry/batch.hpp"

namespace {

using namespace tfdb::geometry;

constexpr std::size_t kSamples = 10'000;
constexpr std::size_t kStamps = 100'000;
constexpr StampNs kStart = 1'700'000'000'000'000'000;
constexpr StampNs kSpacing = 1'000'000;
constexpr int kPasses = 15;

struct Track {
    std::vector<StampNs> stamps;
    std::vector<Pose> poses;
};

/// A random walk that turns by about `turn` radians (half angle) from sample to sample.
Track make_track(std::mt19937_64& random, double turn) {
    std::normal_distribution<double> normal;
    std::uniform_int_distribution<StampNs> jitter(-kSpacing / 4, kSpacing / 4);
    Track track;
    Pose pose{{1.0, 2.0, 3.0}, normalized({0.1, 0.2, 0.3, 0.9})};
    for (std::size_t i = 0; i < kSamples; ++i) {
        track.stamps.push_back(kStart + static_cast<StampNs>(i) * kSpacing + jitter(random));
        track.poses.push_back(pose);
        const double s = turn / 1.7;
        const Quat step{s * normal(random), s * normal(random), s * normal(random), 1.0};
        const Vec3 move{0.01 * normal(random), 0.01 * normal(random), 0.01 * normal(random)};
        pose = compose(pose, Pose{move, normalized(step)});
    }
    return track;
}

std::vector<StampNs> make_stamps(std::mt19937_64& random, StampNs duration, bool sorted) {
    const StampNs begin = kStart + 4 * kSpacing;
    std::uniform_int_distribution<StampNs> at(begin, begin + duration);
    std::vector<StampNs> stamps(kStamps);
    std::generate(stamps.begin(), stamps.end(), [&] { return at(random); });
    if (sorted) {
        std::sort(stamps.begin(), stamps.end());
    }
    return stamps;
}

template <class Body>
double best_ns(Body body) {
    double best = 1e300;
    for (int pass = 0; pass < kPasses; ++pass) {
        const auto start = std::chrono::steady_clock::now();
        body();
        const std::chrono::duration<double, std::nano> took =
            std::chrono::steady_clock::now() - start;
        best = std::min(best, took.count() / static_cast<double>(kStamps));
    }
    return best;
}

/// What a caller would write: one search and one slerp per edge and stamp.
void scalar_loop(const Path& path, const std::vector<StampNs>& stamps, std::vector<double>& out) {
    for (std::size_t i = 0; i < stamps.size(); ++i) {
        const auto side = [&](std::span<const TrackView> tracks) {
            Pose pose = identity();
            for (const TrackView& track : tracks) {
                const Selected at = select_sample(track, Rule{}, stamps[i]);
                pose = compose(pose_at(track, at, stamps[i]), pose);
            }
            return pose;
        };
        const Pose pose = compose(inverse(side(path.target_side)), side(path.source_side));
        const double row[7] = {pose.translation.x, pose.translation.y, pose.translation.z,
                               pose.rotation.x,    pose.rotation.y,    pose.rotation.z,
                               pose.rotation.w};
        std::copy(row, row + 7, out.begin() + static_cast<std::ptrdiff_t>(7 * i));
    }
}

struct Buffers {
    std::vector<double> rows = std::vector<double>(16 * kStamps);
    std::vector<double> doubles = std::vector<double>(3 * kStamps, 1.5);
    std::vector<float> floats = std::vector<float>(3 * kStamps, 1.5F);
};

void report(const char* name, const Path& path, const std::vector<StampNs>& stamps,
            KernelChoice choice, Buffers& buffers) {
    BatchScratch scratch(choice);
    const Rule rule;
    const OnRefused stop = OnRefused::kStop;
    const auto poses = [&](PoseLayout layout) {
        return best_ns([&] {
            evaluate_poses(path, rule, stamps, layout, buffers.rows.data(), stop, scratch);
        });
    };
    const double rows = poses(PoseLayout::kPose);
    const double matrices = poses(PoseLayout::kMatrix);
    const double doubles = best_ns([&] {
        transform_points(path, rule, stamps, kStamps, {buffers.doubles.data()},
                         {buffers.rows.data()}, stop, scratch);
    });
    const double floats = best_ns([&] {
        transform_points(path, rule, stamps, kStamps, {buffers.floats.data()},
                         {buffers.floats.data()}, stop, scratch);
    });
    const std::size_t edges = path.source_side.size() + path.target_side.size();
    std::printf("%-28s %zu edge%s %-9s poses %6.2f  matrices %6.2f  points f64 %6.2f  f32 %6.2f\n",
                name, edges, edges == 1 ? " " : "s", scratch.kernel_name(), rows, matrices, doubles,
                floats);
}

void report_one_pose(KernelChoice choice, Buffers& buffers) {
    BatchScratch scratch(choice);
    const Pose pose{{1.0, 2.0, 3.0}, normalized({0.1, 0.2, 0.3, 0.9})};
    const double doubles = best_ns([&] {
        transform_points(pose, kStamps, {buffers.doubles.data()}, {buffers.rows.data()}, scratch);
    });
    const double floats = best_ns([&] {
        transform_points(pose, kStamps, {buffers.floats.data()}, {buffers.floats.data()}, scratch);
    });
    std::printf("one pose for all points              %-9s points f64 %6.2f  f32 %6.2f\n",
                scratch.kernel_name(), doubles, floats);
}

}  // namespace

int main() {
    constexpr unsigned kSeed = 20;
    std::printf("ns per stamp, seed %u\n", kSeed);
    std::mt19937_64 random(kSeed);
    Buffers buffers;
    const struct {
        const char* name;
        double turn;
        StampNs duration;
        bool sorted;
    } cases[] = {
        {"sorted, 0.1 s", 0.005, 100 * kSpacing, true},
        {"sorted, 9.9 s", 0.005, 9900 * kSpacing, true},
        {"unsorted, 0.1 s", 0.005, 100 * kSpacing, false},
        {"unsorted, 9.9 s", 0.005, 9900 * kSpacing, false},
        {"unsorted, 9.9 s, 9 deg", 0.08, 9900 * kSpacing, false},
        {"unsorted, 9.9 s, wide", 0.5, 9900 * kSpacing, false},
    };
    for (const auto& each : cases) {
        std::vector<Track> tracks;
        for (int i = 0; i < 4; ++i) {
            tracks.push_back(make_track(random, each.turn));
        }
        const std::vector<StampNs> stamps = make_stamps(random, each.duration, each.sorted);
        for (const std::size_t edges : {std::size_t{1}, std::size_t{4}}) {
            std::vector<TrackView> sides[2];
            for (std::size_t i = 0; i < edges; ++i) {
                const Track& t = tracks[i];
                sides[i / 2].push_back({t.stamps.data(), t.poses.data(), nullptr, kSamples});
            }
            const Path path{sides[0], sides[1]};
            report(each.name, path, stamps, KernelChoice::kBest, buffers);
            report(each.name, path, stamps, KernelChoice::kPortable, buffers);
            std::printf("%-28s %zu scalar loop %28.2f\n", each.name, edges,
                        best_ns([&] { scalar_loop(path, stamps, buffers.rows); }));
        }
    }
    report_one_pose(KernelChoice::kBest, buffers);
    report_one_pose(KernelChoice::kPortable, buffers);
}
