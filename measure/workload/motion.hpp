// What every edge's pose is at every stamp: a smooth motion from a table, so that a writer spends
// no time on it and a reader's answer can be judged by arithmetic that is not the library's.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>

#include "tfdb/geometry/pose.hpp"

namespace tfdb::driver {

using geometry::Pose;

// Threads: any, once made. Guarantee: neighbouring entries are 0.2 degrees apart, none is identity.
class Motion {
public:
    static constexpr std::size_t kPoses = 1'024;
    static constexpr unsigned kTick = 16;  // 2^16 ns to an entry

    Motion() {
        for (std::size_t i = 0; i < kPoses; ++i) {
            const double phase = 2.0 * std::numbers::pi * static_cast<double>(i) / kPoses;
            const double angle = 0.9 + 0.6 * std::sin(phase);
            const double s = std::sin(angle / 2);
            table_[i] = {{0.3 + 0.2 * std::cos(phase), 0.1 * std::sin(phase), 0.05},
                         {0.36 * s, 0.48 * s, 0.8 * s, std::cos(angle / 2)}};
        }
    }

    /// T[parent<-child] of an edge.
    [[nodiscard]] const Pose& at(std::uint32_t edge, std::int64_t stamp) const noexcept {
        const auto tick = static_cast<std::uint64_t>(stamp) >> kTick;
        return table_[(tick + edge * std::uint64_t{37}) % kPoses];
    }

private:
    std::array<Pose, kPoses> table_{};
};

// The judge's own arithmetic, written as matrices and angles where the library uses neither.
struct Rigid {
    std::array<std::array<double, 3>, 3> turn{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
    std::array<double, 3> move{};

    static Rigid of(const Pose& pose) {
        const auto& [x, y, z, w] = pose.rotation;
        const auto& [a, b, c] = pose.translation;
        return {{{{1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)},
                  {2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)},
                  {2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)}}},
                {a, b, c}};
    }
    /// This one after `first`.
    [[nodiscard]] Rigid after(const Rigid& first) const {
        Rigid result;
        for (std::size_t i = 0; i < 3; ++i) {
            result.move[i] = move[i];
            for (std::size_t j = 0; j < 3; ++j) {
                result.move[i] += turn[i][j] * first.move[j];
                result.turn[i][j] = 0;
                for (std::size_t k = 0; k < 3; ++k) {
                    result.turn[i][j] += turn[i][k] * first.turn[k][j];
                }
            }
        }
        return result;
    }
    [[nodiscard]] Rigid inverse() const {
        Rigid result;
        for (std::size_t i = 0; i < 3; ++i) {
            result.move[i] = 0;
            for (std::size_t j = 0; j < 3; ++j) {
                result.turn[i][j] = turn[j][i];
                result.move[i] -= turn[j][i] * move[j];
            }
        }
        return result;
    }
    /// Largest difference of any number, translations relative to their size; NaN where one is.
    [[nodiscard]] double apart(const Rigid& other) const {
        double size = 1.0;
        double worst = 0.0;
        const auto note = [&worst](double difference) {
            // Not std::fmax, which passes over a NaN.
            worst =
                std::fabs(difference) <= worst || std::isnan(worst) ? worst : std::fabs(difference);
        };
        for (const double value : move) {
            size = std::fmax(size, std::fabs(value));
        }
        for (std::size_t i = 0; i < 3; ++i) {
            note((move[i] - other.move[i]) / size);
            for (std::size_t j = 0; j < 3; ++j) {
                note(turn[i][j] - other.turn[i][j]);
            }
        }
        return worst;
    }
};

/// Between two poses of `Motion`, whose quaternions are at an acute angle: slerp and lerp.
inline Pose midway(const Pose& a, const Pose& b, double u) {
    const auto& p = a.rotation;
    const auto& q = b.rotation;
    const double cosine = p.x * q.x + p.y * q.y + p.z * q.z + p.w * q.w;
    const double angle = cosine >= 1.0 ? 0.0 : std::acos(cosine);
    const double sine = std::sin(angle);
    const double of_a = sine < 1e-9 ? 1.0 - u : std::sin((1.0 - u) * angle) / sine;
    const double of_b = sine < 1e-9 ? u : std::sin(u * angle) / sine;
    const auto lerp = [u](double from, double to) { return from + u * (to - from); };
    return {{lerp(a.translation.x, b.translation.x), lerp(a.translation.y, b.translation.y),
             lerp(a.translation.z, b.translation.z)},
            {of_a * p.x + of_b * q.x, of_a * p.y + of_b * q.y, of_a * p.z + of_b * q.z,
             of_a * p.w + of_b * q.w}};
}

}  // namespace tfdb::driver
