#include "tfdb/geometry/adaptive.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "tfdb/base/interruption.hpp"
#include "tfdb/geometry/slerp.hpp"

namespace tfdb::geometry {
namespace {

double squared_distance(const Vec3& a, const Vec3& b) {
    const Vec3 d{a.x - b.x, a.y - b.y, a.z - b.z};
    return d.x * d.x + d.y * d.y + d.z * d.z;
}

Quat negated(const Quat& q) {
    return scaled(q, -1.0);
}

double distance(const Quat& a, const Quat& b) {
    return std::sqrt(norm_squared(Quat{a.x - b.x, a.y - b.y, a.z - b.z, a.w - b.w}));
}

/// The angle between two unit quaternions: half the angle between their rotations if they lie on
/// one side.
double angle(const Quat& a, const Quat& b) {
    return 2.0 * std::atan2(distance(a, b), distance(a, negated(b)));
}

/// A path, and the error of one interpolation between two of its rows. Threads: one.
///
/// Take two paths, one of which has a subset of the other's rows. Their translations differ most at
/// a row. Take the quaternions a and b of two slerps, whose angles over a piece are A and B. They
/// differ by g = a - b, and g'' = -A^2 g + (B^2 - A^2) b. A twice differentiable function leaves
/// the chord between its ends by at most max
/// g''
/// / 8. So anywhere in the piece
/// g
/// <= (m +
/// B^2 - A^2
/// / 8) / (1 - min(A, B)^2 / 8), with m the greater
/// g
/// at its ends. Rotations an angle apart are quaternions 2 sin(angle / 4) apart.
class Path {
public:
    Path(std::span<const std::int64_t> stamps, std::span<const Pose> poses, double metres,
         double radians)
        : stamps_(stamps),
          poses_(poses),
          metres_(metres * metres),
          limit_(radians >= std::numbers::pi ? kAny : 2.0 * std::sin(radians / 4.0)) {
        turns_.reserve(poses.size());
        angles_.reserve(poses.size());
        for (const Pose& pose : poses) {
            const Quat& turn = pose.rotation;
            const Quat& before = turns_.empty() ? turn : turns_.back();
            turns_.push_back(dot(before, turn) < 0.0 ? negated(turn) : turn);
            angles_.push_back(angle(before, turns_.back()));
        }
    }

    /// The farthest row, at most `stop`, that one interpolation from `start` reaches; `good` if
    /// none behind it is in reach.
    [[nodiscard]] std::size_t farthest(std::size_t start, std::size_t good,
                                       std::size_t stop) const {
        // a row before it exceeded the tolerance, and mostly does so again
        std::size_t suspect = stop;
        for (std::size_t end = stop; end > good; --end) {
            if (reaches(start, end, suspect)) {
                return end;
            }
        }
        return good;
    }

private:
    static constexpr double kAny = std::numeric_limits<double>::infinity();

    /// One interpolation between two rows.
    struct Chord {
        std::size_t start, end;
        Apart<double> apart;
    };

    [[nodiscard]] double nanoseconds(std::size_t from, std::size_t to) const {
        return static_cast<double>(stamps_[to] - stamps_[from]);
    }

    [[nodiscard]] bool reaches(std::size_t start, std::size_t end, std::size_t& suspect) const {
        if (end - start == 1) {
            return true;
        }
        const Quat& from = turns_[start];
        const Quat& to = turns_[end];
        if (limit_ != kAny && dot(from, to) < 0.0) {
            return false;  // the shorter arc turns the other way, so the error somewhere is pi
        }
        const Chord chord{start, end, apart(from, to)};
        // A bend is farthest from its chord in the middle.
        for (const std::size_t row : {start + (end - start) / 2, suspect}) {
            if (row < end && !near(chord, row, off(chord, row))) {
                return false;
            }
        }
        interruption_point();
        const double speed = limit_ == kAny ? 0.0 : angle(from, to) / nanoseconds(start, end);
        double before = 0.0;
        std::size_t first = 0;  // of the stretch beyond the tolerance
        for (std::size_t row = start + 1; row <= end; ++row) {
            const double here = off(chord, row);
            const bool fine =
                near(chord, row, here) && near_between(row, std::max(before, here), speed);
            if (!fine && first == 0) {
                first = row;
            }
            if (first != 0 && (fine || row == end)) {
                suspect = first + (row - first) / 2;
                return false;
            }
            before = here;
        }
        return true;
    }

    /// The distance of the chord's quaternion from the path's.
    [[nodiscard]] double off(const Chord& chord, std::size_t row) const {
        if (limit_ == kAny || row == chord.end) {
            return 0.0;
        }
        const double u = share(stamps_[chord.start], stamps_[chord.end], stamps_[row]);
        return distance(slerp(turns_[chord.start], turns_[chord.end], chord.apart, u), turns_[row]);
    }

    /// Whether a row is within both tolerances; `off` is its quaternion distance.
    [[nodiscard]] bool near(const Chord& chord, std::size_t row, double off) const {
        const Vec3& a = poses_[chord.start].translation;
        const Vec3& b = poses_[chord.end].translation;
        const double u = share(stamps_[chord.start], stamps_[chord.end], stamps_[row]);
        const Vec3 place{a.x + u * (b.x - a.x), a.y + u * (b.y - a.y), a.z + u * (b.z - a.z)};
        return off <= limit_ &&
               (row == chord.end || squared_distance(place, poses_[row].translation) <= metres_);
    }

    /// Whether a rotation at this speed stays within the tolerance between a row and the one
    /// before. `off`: the greater quaternion distance at the two rows.
    [[nodiscard]] bool near_between(std::size_t row, double off, double speed) const {
        if (limit_ == kAny) {
            return true;
        }
        const double own = angles_[row];
        const double given = speed * nanoseconds(row - 1, row);
        const double least = std::min(own, given);
        return (off + std::abs(given * given - own * own) / 8.0) / (1.0 - least * least / 8.0) <=
               limit_;
    }

    std::span<const std::int64_t> stamps_;
    std::span<const Pose> poses_;
    std::vector<Quat> turns_;     // the poses' quaternions, each on the side of the previous one
    std::vector<double> angles_;  // between each quaternion and the previous one
    double metres_;               // squared
    double limit_;                // between quaternions
};

}  // namespace

std::vector<std::size_t> enough_rows(std::span<const std::int64_t> stamps,
                                     std::span<const Pose> poses, double metres, double radians) {
    const Path path(stamps, poses, metres, radians);
    std::vector<std::size_t> rows;
    std::size_t row = 0;
    std::size_t step = 1;
    while (row < stamps.size()) {
        rows.push_back(row);
        const std::size_t left = stamps.size() - 1 - row;
        if (left == 0) {
            break;
        }
        // Tries twice the last step's reach, and doubles it while that suffices.
        std::size_t good = 1;
        std::size_t ahead = 2 * step;
        for (;; ahead *= 2) {
            good = path.farthest(row, row + good, row + std::min(ahead, left)) - row;
            if (ahead >= left || good < ahead - ahead / 4) {
                break;
            }
        }
        step = good;
        row += good;
    }
    return rows;
}

}  // namespace tfdb::geometry
