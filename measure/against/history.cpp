// Whole recordings: 1.15 M transforms and 308,471 lookups all over them; memory per stored sample.

#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "groups.hpp"
#include "scenario.hpp"

namespace bench {
namespace {

constexpr int kEdges = 10;
constexpr int kTransforms = 1'150'000;
constexpr std::size_t kLookups = 308'471;
constexpr tfdb::StampNs kForEver = 1'000'000'000'000'000;  // cache of tf2, ns

std::vector<std::string> frame_names(int edges) {
    std::vector<std::string> names;
    for (int i = 0; i <= edges; ++i) {
        names.push_back("frame_" + std::to_string(i));
    }
    return names;
}

std::unique_ptr<tfdb::Buffer> keep_everything() {
    tfdb::BufferOptions options;
    options.history_ns = std::nullopt;
    return std::make_unique<tfdb::Buffer>(options);
}

/// Calls `store(edge, stamp, pose)` for `samples` samples of each edge, edge after edge per stamp.
template <class Store>
void fill(int edges, int samples, Store store) {
    for (int i = 0; i < samples; ++i) {
        const tfdb::StampNs stamp = kStart + i * kPeriod;
        for (int edge = 0; edge < edges; ++edge) {
            store(static_cast<std::size_t>(edge), stamp, moving_pose(edge, 1e-3 * i));
        }
    }
}

std::vector<tfdb::StampNs> random_stamps(std::size_t count, int samples) {
    std::mt19937_64 random(11);
    std::uniform_int_distribution<tfdb::StampNs> any(kStart, kStart + (samples - 1) * kPeriod);
    std::vector<tfdb::StampNs> stamps(count);
    std::generate(stamps.begin(), stamps.end(), [&] { return any(random); });
    return stamps;
}

double ours_seconds(const std::vector<std::string>& names, const std::vector<tfdb::StampNs>& stamps,
                    std::vector<tfdb::Pose>& poses) {
    // The cost of making the poses is not the store's.
    std::vector<tfdb::TransformView> input;
    input.reserve(kTransforms);
    fill(kEdges, kTransforms / kEdges,
         [&](std::size_t edge, tfdb::StampNs stamp, const tfdb::Pose& pose) {
             input.push_back({names[edge], names[edge + 1], stamp, pose});
         });
    const double start = thread_seconds();
    const auto buffer = keep_everything();
    for (const tfdb::TransformView& view : input) {
        buffer->set_transform(view, false, "bench");
    }
    tfdb::FrameHandle target;
    tfdb::FrameHandle source;
    tfdb::Answer answer;
    tfdb::Failure failure;
    if (!buffer->find_frame(names.front(), target) || !buffer->find_frame(names.back(), source)) {
        return -1;
    }
    for (std::size_t i = 0; i < stamps.size(); ++i) {
        if (buffer->ask(tfdb::store::at_stamp(target, source, stamps[i], {}), answer, failure)) {
            poses[i] = answer.pose;
        }
    }
    return thread_seconds() - start;
}

double tf2_seconds(const std::vector<std::string>& names, const std::vector<tfdb::StampNs>& stamps,
                   const std::vector<tfdb::Pose>& ours) {
    real_tf2::Messages input;
    fill(kEdges, kTransforms / kEdges,
         [&](std::size_t edge, tfdb::StampNs stamp, const tfdb::Pose& pose) {
             input.add(names[edge], names[edge + 1], stamp, plain(pose));
         });
    const real_tf2::Question question(names.front(), names.back(), stamps);
    const double start = thread_seconds();
    real_tf2::Tf2 buffer(kForEver);
    buffer.insert(input);
    const std::vector<real_tf2::Pose7> answers = buffer.all_lookups(question);
    const double took = thread_seconds() - start;
    double worst = 0;
    for (std::size_t i = 0; i < stamps.size(); ++i) {
        worst = std::max(worst, difference(ours[i], answers[i]));
    }
    if (!(worst <= kTolerance)) {
        std::fprintf(stderr, "long history: answers differ by %g\n", worst);
        std::exit(1);
    }
    return took;
}

void recording_row(const Options& options) {
    const auto names = frame_names(kEdges);
    const auto stamps = random_stamps(kLookups, kTransforms / kEdges);
    std::vector<tfdb::Pose> poses(stamps.size());
    Rounds rounds{{"tfdb", {}}, {"tf2", {}}};
    for (int round = 0; round < std::min(options.rounds, 5); ++round) {
        rounds[0].second.push_back(ours_seconds(names, stamps, poses));
        rounds[1].second.push_back(tf2_seconds(names, stamps, poses));
    }
    print_row("1.15 M inserts and 308,471 lookups", kEdges, "s", rounds);
}

double resident_bytes() {
    unsigned long pages = 0;
    unsigned long resident = 0;
    std::FILE* file = std::fopen("/proc/self/statm", "r");
    if (file == nullptr || std::fscanf(file, "%lu %lu", &pages, &resident) != 2) {
        return -1;
    }
    std::fclose(file);
    return static_cast<double>(resident) * static_cast<double>(sysconf(_SC_PAGESIZE));
}

void memory_row() {
    constexpr int kSamples = 100'000;
    constexpr double kStored = 1.0 * kEdges * kSamples;
    const auto names = frame_names(kEdges);
    const double empty = resident_bytes();
    const auto ours = keep_everything();
    fill(kEdges, kSamples, [&](std::size_t edge, tfdb::StampNs stamp, const tfdb::Pose& pose) {
        ours->set_transform({names[edge], names[edge + 1], stamp, pose}, false, "bench");
    });
    const double with_ours = resident_bytes();
    real_tf2::Tf2 theirs(kForEver);
    real_tf2::Tf2::Message message;
    fill(kEdges, kSamples, [&](std::size_t edge, tfdb::StampNs stamp, const tfdb::Pose& pose) {
        theirs.set(names[edge], names[edge + 1], stamp, plain(pose).values, message);
    });
    const double with_both = resident_bytes();
    print_row(
        "memory per stored sample", kEdges, "bytes",
        {{"tf2", {(with_both - with_ours) / kStored}}, {"tfdb", {(with_ours - empty) / kStored}}});
    const tfdb::MemoryUse use = ours->memory();
    print_row("memory as reported", kEdges, "bytes",
              {{"tfdb used", {static_cast<double>(use.used_bytes) / kStored}},
               {"tfdb kept for reuse", {static_cast<double>(use.free_bytes) / kStored}}});
}

}  // namespace

void history_rows(const Options& options) {
    memory_row();  // first: nothing freed earlier can be handed out again
    recording_row(options);
}

}  // namespace bench
