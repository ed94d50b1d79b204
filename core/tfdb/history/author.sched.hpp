// Random scripts for walks and simulations.
#pragma once

#include <algorithm>
#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include "tfdb/history/script.sched.hpp"

namespace tfdb::history::script {

// Creates random scripts that the store would accept: no sample is older than the history, and an
// edge is cleared before its kind changes. One thread; the same seed gives the same script.
class Author {
public:
    explicit Author(std::uint64_t seed) : random_(seed) {}

    Script script() {
        static constexpr StampNs kHistories[] = {kForever, 15, 35};
        Script script;
        script.history = kHistories[below(3)];
        script.edges = below(4) == 0 ? 2 : 1;
        newest_.assign(script.edges, kNoStamp);
        is_static_.assign(script.edges, false);
        for (std::uint64_t left = below(6); left > 0; --left) {
            script.before.push_back(batch(script));
        }
        // Either two edges or two batches: the walk must stay small enough to complete.
        const std::uint64_t batches = script.edges == 2 ? 1 : 1 + below(2);
        for (std::uint64_t left = batches; left > 0; --left) {
            script.during.push_back(batch(script));
        }
        return script;
    }
    StampNs stamp() { return static_cast<StampNs>(5 * below(20)); }

private:
    std::uint64_t below(std::uint64_t limit) { return random_() % limit; }

    Batch batch(const Script& script) {
        Batch made;
        made.aborted = below(6) == 0;
        const std::vector<StampNs> newest = newest_;
        const std::vector<bool> is_static = is_static_;
        const std::uint64_t chance = below(8);
        const bool clears = chance == 0;
        for (unsigned edge = 0; edge < script.edges; ++edge) {
            if (clears) {
                if (newest_[edge] >= 0) {
                    made.puts.push_back({edge, kClearMarker, kNoFrame});
                    newest_[edge] = kNoStamp;
                }
                continue;
            }
            if (chance == 1 && (newest_[edge] >= 0 || is_static_[edge])) {
                made.puts.push_back({edge, kClearMarker, kNoFrame});
                newest_[edge] = kNoStamp;
                is_static_[edge] = !is_static_[edge];
                made.puts.push_back(put(edge, script.history));
                continue;
            }
            const bool many = script.edges == 1 && below(5) >= 3;
            for (std::uint64_t left = many ? 2 : 1; left > 0; --left) {
                made.puts.push_back(put(edge, script.history));
            }
        }
        if (made.aborted) {
            newest_ = newest;
            is_static_ = is_static;
        }
        return made;
    }

    Put put(unsigned edge, StampNs history) {
        const auto parent = static_cast<FrameId>(5 + below(8) / 7);
        if (newest_[edge] == kNoStamp && !is_static_[edge] && below(8) == 0) {
            is_static_[edge] = true;
        }
        if (is_static_[edge]) {
            return {edge, kStaticStamp, parent};
        }
        StampNs stamp = newest_[edge] + static_cast<StampNs>(1 + below(20));
        if (newest_[edge] >= 0 && below(3) == 0) {
            stamp =
                newest_[edge] - static_cast<StampNs>(below(2) * below(30));  // or the same stamp
            stamp = std::max({stamp, newest_[edge] - history, StampNs{0}});
        }
        newest_[edge] = std::max(newest_[edge], stamp);
        return {edge, stamp, parent};
    }

    std::mt19937_64 random_;
    std::vector<StampNs> newest_;
    std::vector<bool> is_static_;
};

/// The script in one line, for reports.
inline std::string describe(const Script& script, StampNs stamp) {
    std::string text =
        "history " + std::to_string(script.history) + ", asked at " + std::to_string(stamp) + ":";
    const auto add = [&](const std::vector<Batch>& batches) {
        for (const Batch& batch : batches) {
            text += batch.aborted ? " aborted[" : " [";
            for (const Put& put : batch.puts) {
                text += " e" + std::to_string(put.edge) + "@" + std::to_string(put.stamp) + ">" +
                        std::to_string(put.parent);
            }
            text += " ]";
        }
    };
    add(script.before);
    text += " |";
    add(script.during);
    return text;
}

}  // namespace tfdb::history::script
