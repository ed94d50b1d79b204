// Are the answers right? Judged before and after the measurement by arithmetic of our own.
#pragma once

#include <cmath>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "clock.hpp"
#include "random.hpp"
#include "store.hpp"

namespace tfdb::driver {

inline constexpr double kTolerance = 1e-9;

// Compares paths and edges of a store at rest with the motion that was written.
// Threads: one, nothing else running. Guarantee: NaN and a missing answer count as wrong.
template <Store S>
class Values {
public:
    Values(S& store, const Forest& forest, const Motion& motion, const Options& options)
        : store_(store), forest_(forest), motion_(motion) {
        Random random(options.seed + 5);
        for (std::uint32_t i = 0; i < options.probes; ++i) {
            Path path = forest.path(random.below(forest.paths()));
            if (i % 2 == 1 && options.joints <= S::kDeepestWalk) {  // both directions
                std::swap(path.low, path.high);
            }
            paths_.push_back(path);
        }
    }

    /// Fills every edge at two stamps and looks at the newest of them and between them.
    [[nodiscard]] double after_filling(const Clock& clock) {
        constexpr std::int64_t kApart = 1'000'000;
        const std::int64_t first = clock.now();  // later than any sample there is
        const std::int64_t second = first + kApart;
        store_.fill(first);
        store_.fill(second);
        const std::int64_t inside = first + 2 * kApart / 5;
        double worst = 0.0;
        for (const Path& path : paths_) {
            const Rigid newest =
                expected(path, [&](std::uint32_t edge) { return motion_.at(edge, second); });
            note(worst, path, std::nullopt, newest);
            const Rigid mixed = expected(path, [&](std::uint32_t edge) {
                return midway(motion_.at(edge, first), motion_.at(edge, second), 0.4);
            });
            note(worst, path, inside, mixed);
        }
        clock.sleep_until(second);  // writers to come must not be late
        return worst;
    }

    /// What the threads have left behind: each edge's newest sample, and paths made of them.
    [[nodiscard]] double as_left() {
        double worst = 0.0;
        for (const Path& path : paths_) {
            const auto newest = [&](std::uint32_t edge) {
                const Path one{forest_.parent(edge), edge, 1};
                Used used;
                const Rigid found = Rigid::of(store_.probe(one, std::nullopt, used));
                const Pose& pose = motion_.at(edge, used.newest);
                keep_worse(worst, found.apart(Rigid::of(pose)));
                return pose;
            };
            const Rigid whole = expected(path, newest);
            if (S::kNewestOfEachEdge) {
                note(worst, path, std::nullopt, whole);
            }
        }
        return worst;
    }

private:
    template <class PoseOf>
    Rigid expected(const Path& path, const PoseOf& pose_of) {
        std::vector<std::uint32_t> from_low;
        std::vector<std::uint32_t> from_high;
        forest_.edges_between(path, from_low, from_high);
        const auto climb = [&](const std::vector<std::uint32_t>& edges) {
            Rigid result;
            for (const std::uint32_t edge : edges) {
                result = Rigid::of(pose_of(edge)).after(result);
            }
            return result;
        };
        const Rigid high = climb(from_high);
        return climb(from_low).inverse().after(high);
    }

    void note(double& worst, const Path& path, std::optional<std::int64_t> stamp,
              const Rigid& wanted) {
        Used used;
        keep_worse(worst, Rigid::of(store_.probe(path, stamp, used)).apart(wanted));
    }

    static void keep_worse(double& worst, double apart) {
        worst = apart <= worst || std::isnan(worst) ? worst : apart;
    }

    S& store_;
    const Forest& forest_;
    const Motion& motion_;
    std::vector<Path> paths_;
};

}  // namespace tfdb::driver
