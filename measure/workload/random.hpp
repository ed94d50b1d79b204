// Random numbers that cost a few cycles, and Zipf's law over ranks.
#pragma once

#include <cmath>
#include <cstdint>

namespace tfdb::driver {

// SplitMix64 (Steele, Lea, Flood 2014). Threads: one. Guarantee: the same numbers for a seed.
class Random {
public:
    explicit Random(std::uint64_t seed) noexcept : state_(seed) {}

    std::uint64_t next() noexcept {
        state_ += 0x9E3779B97F4A7C15ULL;
        std::uint64_t z = state_;
        z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ULL;
        z = (z ^ (z >> 27)) * 0x94D049BB133111EBULL;
        return z ^ (z >> 31);
    }
    /// Uniform in [0, limit), limit < 2^32.
    std::uint32_t below(std::uint32_t limit) noexcept {
        return static_cast<std::uint32_t>(((next() >> 32) * limit) >> 32);
    }
    /// Uniform in (0, 1].
    double unit() noexcept { return (static_cast<double>(next() >> 11) + 1.0) * 0x1p-53; }

private:
    std::uint64_t state_;
};

// Ranks 0 .. count-1 with a probability that falls as 1 / (rank + 1)^theta, theta >= 0, by
// rejection-inversion (Hoermann and Derflinger 1996): no table, whatever the count.
// Threads: any. Guarantee: theta 0 is uniform.
class Zipf {
public:
    Zipf(std::uint32_t count, double theta)
        : count_(count),
          theta_(theta),
          at_first_(integral(1.5) - 1.0),
          at_last_(integral(count + 0.5)),
          cut_(2.0 - inverse(integral(2.5) - height(2.0))) {}

    [[nodiscard]] std::uint32_t draw(Random& random) const {
        for (;;) {
            const double u = at_last_ + random.unit() * (at_first_ - at_last_);
            const double x = inverse(u);
            double k = std::floor(x + 0.5);
            k = k < 1.0 ? 1.0 : (k > count_ ? count_ : k);
            if (k - x <= cut_ || u >= integral(k + 0.5) - height(k)) {
                return static_cast<std::uint32_t>(k) - 1;
            }
        }
    }

private:
    [[nodiscard]] double height(double x) const { return std::exp(-theta_ * std::log(x)); }
    /// An antiderivative of `height`, written so that theta = 1 is no special case.
    [[nodiscard]] double integral(double x) const {
        const double log_x = std::log(x);
        const double t = (1.0 - theta_) * log_x;
        return log_x * (std::fabs(t) > 1e-8 ? std::expm1(t) / t : 1.0 + t / 2.0);
    }
    [[nodiscard]] double inverse(double y) const {
        double t = y * (1.0 - theta_);
        t = t < -1.0 ? -1.0 : t;
        return std::exp(y * (std::fabs(t) > 1e-8 ? std::log1p(t) / t : 1.0 - t / 2.0));
    }

    double count_, theta_, at_first_, at_last_, cut_;
};

}  // namespace tfdb::driver
