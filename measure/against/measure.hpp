// Timing: contenders in turns, several rounds, one line of JSON per row.
#pragma once

#include <time.h>

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <string>
#include <utility>
#include <vector>

namespace bench {

struct Options {
    int rounds = 7;
    double batch_seconds = 0.02;  // of one contender in one round
    std::vector<std::string> groups;
};

/// Keeps the compiler from dropping a result that nobody reads.
template <class T>
inline void keep(const T& value) {
    asm volatile("" : : "r,m"(value) : "memory");
}

inline double seconds(clockid_t clock) {
    timespec now{};
    clock_gettime(clock, &now);
    return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

/// CPU time of this thread: another process on the same core does not count.
inline double thread_seconds() {
    return seconds(CLOCK_THREAD_CPUTIME_ID);
}

inline double wall_seconds() {
    return seconds(CLOCK_MONOTONIC);
}

/// Runs its operation `count` times.
using Batch = std::function<void(std::size_t count)>;

struct Contender {
    std::string name;
    Batch batch;
};

using Rounds = std::vector<std::pair<std::string, std::vector<double>>>;

/// Prints one row: {"row": ..., "chain": ..., "unit": ..., "rounds": {"tf2": [...], ...}}.
inline void print_row(const std::string& row, int chain, const char* unit, const Rounds& rounds) {
    std::printf("{\"row\": \"%s\", \"chain\": %d, \"unit\": \"%s\", \"rounds\": {", row.c_str(),
                chain, unit);
    const char* between = "";
    for (const auto& [name, values] : rounds) {
        std::printf("%s\"%s\": [", between, name.c_str());
        for (std::size_t i = 0; i < values.size(); ++i) {
            std::printf("%s%.6g", i == 0 ? "" : ", ", values[i]);
        }
        std::printf("]");
        between = ", ";
    }
    std::printf("}}\n");
    std::fflush(stdout);
}

/// How many operations fill `target` seconds; warms the contender up on the way.
inline std::size_t calibrate(const Batch& batch, double target) {
    std::size_t count = 16;
    for (;;) {
        const double start = thread_seconds();
        batch(count);
        const double took = thread_seconds() - start;
        if (took > 0.3 * target || count > (std::size_t{1} << 30)) {
            const double each = took / static_cast<double>(count);
            return static_cast<std::size_t>(target / each) + 1;
        }
        count *= 2;
    }
}

/// Nanoseconds per operation of each contender, A B A B ...
inline void compare(const std::string& row, int chain, const Options& options,
                    const std::vector<Contender>& contenders) {
    std::vector<std::size_t> counts;
    Rounds rounds;
    for (const Contender& contender : contenders) {
        counts.push_back(calibrate(contender.batch, options.batch_seconds));
        rounds.emplace_back(contender.name, std::vector<double>{});
    }
    for (int round = 0; round < options.rounds; ++round) {
        for (std::size_t i = 0; i < contenders.size(); ++i) {
            const double start = thread_seconds();
            contenders[i].batch(counts[i]);
            const double took = thread_seconds() - start;
            rounds[i].second.push_back(1e9 * took / static_cast<double>(counts[i]));
        }
    }
    print_row(row, chain, "ns", rounds);
}

}  // namespace bench
