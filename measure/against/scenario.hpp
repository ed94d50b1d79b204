// The same moving chain of frames in the real tf2 and in tfdb: f0 <- f1 <- ... <- fN at 1 kHz.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "tf2/tf2.hpp"
#include "tfdb/store/buffer.hpp"

namespace bench {

inline constexpr tfdb::StampNs kStart = 1'700'000'000'000'000'000;
inline constexpr tfdb::StampNs kPeriod = 1'000'000;
inline constexpr double kTolerance = 1e-12;

/// T[parent<-child] of one edge at one time: about 1 m/s and 1 rad/s, and never at rest (tf2 does
/// not interpolate turns of less than 1.5e-8 rad).
inline tfdb::Pose moving_pose(int edge, double t) {
    const double phase = 0.37 * edge;
    const double angle = 0.6 + 0.9 * t + 0.3 * std::sin(0.5 * t + phase);
    const double tilt = 0.9 + 0.1 * edge;
    const double s = std::sin(angle / 2);
    const double c = std::cos(angle / 2);
    const std::array<double, 3> axis{std::sin(tilt), 0.6 * std::cos(tilt), 0.8 * std::cos(tilt)};
    return {{0.3 + std::sin(t + phase), 0.2 * edge + 0.5 * std::cos(0.7 * t), 0.1 + 0.05 * t},
            {s * axis[0], s * axis[1], s * axis[2], c}};
}

inline real_tf2::Pose7 plain(const tfdb::Pose& pose) {
    const auto& [t, q] = pose;
    return {{t.x, t.y, t.z, q.x, q.y, q.z, q.w}};
}

/// Largest difference between two answers, relative to large translations; q and -q are the same.
inline double difference(const tfdb::Pose& ours, const real_tf2::Pose7& theirs) {
    const real_tf2::Pose7 mine = plain(ours);
    double scale = 1.0;
    double dot = 0.0;
    for (std::size_t i = 0; i < 3; ++i) {
        scale = std::max(scale, std::fabs(theirs.values[i]));
    }
    for (std::size_t i = 3; i < 7; ++i) {
        dot += mine.values[i] * theirs.values[i];
    }
    const double sign = dot < 0 ? -1.0 : 1.0;
    double worst = 0.0;
    for (std::size_t i = 0; i < 7; ++i) {
        const double apart = i < 3 ? (mine.values[i] - theirs.values[i]) / scale
                                   : mine.values[i] - sign * theirs.values[i];
        worst = std::max(worst, std::fabs(apart));
    }
    return worst;
}

/// Both stores, filled with the same samples. Threads: as the stores allow.
/// Guarantee: `verify` ends the program if they answer differently by more than 1e-12.
struct Chain {
    Chain(int edges, int samples, double history_seconds = 10.0)
        : length(edges),
          theirs(
              std::make_unique<real_tf2::Tf2>(static_cast<tfdb::StampNs>(history_seconds * 1e9))),
          ours(std::make_unique<tfdb::Buffer>(options(history_seconds))) {
        for (int i = 0; i <= edges; ++i) {
            names.push_back("frame_" + std::to_string(i));
        }
        for (int i = 0; i < samples; ++i) {
            for (int edge = 0; edge < edges; ++edge) {
                append(edge);
            }
        }
        if (!ours->find_frame(names.front(), target) || !ours->find_frame(names.back(), source)) {
            std::fprintf(stderr, "the chain was not stored\n");
            std::exit(1);
        }
    }

    static tfdb::BufferOptions options(double history_seconds) {
        tfdb::BufferOptions result;
        result.history_ns = static_cast<tfdb::StampNs>(history_seconds * 1e9);
        return result;
    }

    /// One more sample of an edge, in both stores.
    void append(int edge) {
        if (edge == 0) {
            newest = next;
            next += kPeriod;
        }
        const double t = 1e-9 * static_cast<double>(newest - kStart);
        const auto at = static_cast<std::size_t>(edge);
        const tfdb::Pose pose = moving_pose(edge, t);
        theirs->set(names[at], names[at + 1], newest, plain(pose).values, message);
        ours->set_transform({names[at], names[at + 1], newest, pose}, false, "bench");
    }

    /// Random stamps, none on a sample, between `from` and `to` ns before the newest one.
    [[nodiscard]] std::vector<tfdb::StampNs> stamps(std::size_t count, tfdb::StampNs from,
                                                    tfdb::StampNs to) const {
        std::mt19937_64 random(7);
        std::uniform_int_distribution<tfdb::StampNs> any(to, from);
        std::vector<tfdb::StampNs> result(count);
        for (tfdb::StampNs& stamp : result) {
            stamp = newest - any(random);
            stamp += (stamp - kStart) % kPeriod == 0 ? 1 : 0;
        }
        return result;
    }

    [[nodiscard]] tfdb::Pose ask_ours(tfdb::StampNs stamp) const {
        return ours->lookup_transform(names.front(), names.back(), stamp).pose;
    }

    void verify(const std::vector<tfdb::StampNs>& stamps) const {
        double worst = 0;
        for (const tfdb::StampNs stamp : stamps) {
            const auto answer = theirs->get(names.front(), names.back(), stamp);
            worst = std::max(worst, difference(ask_ours(stamp), answer.pose));
        }
        if (!(worst <= kTolerance)) {
            std::fprintf(stderr, "answers differ by %g in a chain of %d\n", worst, length);
            std::exit(1);
        }
    }

    int length;
    tfdb::StampNs next = kStart;
    tfdb::StampNs newest = kStart;
    std::vector<std::string> names;
    std::unique_ptr<real_tf2::Tf2> theirs;
    real_tf2::Tf2::Message message;
    std::unique_ptr<tfdb::Buffer> ours;
    tfdb::FrameHandle target;
    tfdb::FrameHandle source;
};

}  // namespace bench
