// The forest that the recorder works on, and poses that tell which values they are made of.
//
// Every edge turns by a third of a turn about (1, 1, 1), so x -> y -> z -> x, exactly: values stand
// on the axis of their edge's depth, and of the edges that share an axis each has digits of its
// own. So the translation of any path says which value of each of its edges was used, to the last
// bit.
#pragma once

#include <sys/mman.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <cmath>
#include <cstdint>
#include <map>
#include <new>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include "tfdb/geometry/pose.hpp"
#include "tfdb/lookup/answer.hpp"

namespace tfdb::recorder {

using clock::StampNs;
using geometry::Pose;

inline constexpr int kBits = 15;
inline constexpr std::int64_t kValues = std::int64_t{1} << kBits;
inline constexpr std::int64_t kUnknown = -1;
inline constexpr double kTolerance = 0.1;  // of mixed values: some units in the last place

struct Edge {
    const char* name;
    const char* parent;  // the first one
    int depth;           // of the frame below the edge
    int digit;
    bool is_static = false;
    bool comes_and_goes = false;
};

inline constexpr std::array<Edge, 9> kEdges{{
    {"a1", "map", 1, 0},
    {"a2", "a1", 2, 0, true},
    {"a3", "a2", 3, 0},
    {"b1", "map", 1, 1},
    {"b2", "b1", 2, 1, true},
    {"b3", "b2", 3, 1},
    {"tool", "a3", 4, 2},  // sometimes below b3
    {"t0", "map", 1, 2, false, true},
    {"t1", "map", 1, 2, false, true},
}};
inline constexpr std::size_t kTool = 6;

inline std::optional<std::size_t> edge_of(std::string_view name) {
    for (std::size_t i = 0; i < kEdges.size(); ++i) {
        if (kEdges[i].name == name)
            return i;
    }
    return std::nullopt;
}
inline int depth_of(std::string_view name) {
    const auto edge = edge_of(name);
    return edge ? kEdges[*edge].depth : 0;
}
inline int axis_of(const Edge& edge) {
    return (edge.depth - 1) % 3;
}

/// The pose of an edge that carries this value.
inline Pose pose_of(const Edge& edge, std::int64_t value) {
    const auto x = static_cast<double>(value << (kBits * edge.digit));
    return {{x, 0.0, 0.0}, {0.5, 0.5, 0.5, 0.5}};
}

/// What all who work in the store share: the clock of the data, and what was written, by number of
/// the value, for each edge. It lies in memory that children of a fork go on sharing.
/// Threads: any, of any process. Guarantee: blocking, for a moment.
class Shared {
public:
    struct Row {
        StampNs stamp = 0;
        std::int32_t parent = 0;  // index of its edge, kMap, kNobody
        std::atomic<std::uint32_t> is_there{};
    };
    static constexpr std::int32_t kMap = -1;
    static constexpr std::int32_t kNobody = -2;

    /// Zeros of a new mapping are an empty one.
    static Shared& make() {
        void* const mapped = ::mmap(nullptr, sizeof(Shared), PROT_READ | PROT_WRITE,
                                    MAP_SHARED | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
        if (mapped == MAP_FAILED)
            throw std::system_error(errno, std::generic_category(), "mmap");
        return *new (mapped) Shared;
    }

    std::atomic<StampNs> clock{1000};
    std::atomic<unsigned> started{};
    std::array<std::atomic<std::int64_t>, kEdges.size()> counts{};
    std::array<std::array<Row, kValues>, kEdges.size()> rows;
};
static_assert(std::atomic<std::int64_t>::is_always_lock_free);

/// What was written, as one worker finds it.
/// Threads: one each. Guarantee: blocking, for a moment.
class Values {
public:
    struct Value {
        StampNs stamp = 0;
        std::string parent;
    };

    explicit Values(Shared& shared) : shared_(&shared) {}

    /// A new value, unlike any before.
    std::int64_t add(std::size_t edge, StampNs stamp, std::string_view parent) {
        const std::int64_t number = ++shared_->counts[edge];
        Shared::Row& row = row_of(edge, number);
        row.stamp = stamp;
        row.parent = parent.empty() ? Shared::kNobody : Shared::kMap;
        if (const auto found = edge_of(parent))
            row.parent = static_cast<std::int32_t>(*found);
        row.is_there.store(1, std::memory_order_release);
        return number;
    }
    [[nodiscard]] bool full() const {
        for (const auto& count : shared_->counts) {
            if (count.load() + kAhead > kValues)
                return true;
        }
        return false;
    }
    [[nodiscard]] std::optional<Value> find(std::size_t edge, std::int64_t number) const {
        if (number < 1 || number > shared_->counts[edge].load())
            return std::nullopt;
        const Shared::Row& row = there(edge, number);
        if (row.parent < 0)
            return Value{row.stamp, row.parent == Shared::kMap ? "map" : ""};
        return Value{row.stamp, kEdges[static_cast<std::size_t>(row.parent)].name};
    }
    /// All that were written so far at a stamp.
    [[nodiscard]] const std::vector<std::int64_t>& at(std::size_t edge, StampNs stamp) {
        const std::int64_t count = shared_->counts[edge].load();
        while (known_[edge] < count) {
            const std::int64_t number = ++known_[edge];
            by_stamp_[edge][there(edge, number).stamp].push_back(number);
        }
        return by_stamp_[edge][stamp];
    }

private:
    static constexpr std::int64_t kAhead = 256;  // that all workers may add after they asked

    [[nodiscard]] Shared::Row& row_of(std::size_t edge, std::int64_t number) const {
        return shared_->rows[edge][static_cast<std::size_t>(number) - 1];
    }
    /// Whoever took the number writes the rest at once.
    [[nodiscard]] const Shared::Row& there(std::size_t edge, std::int64_t number) const {
        const Shared::Row& row = row_of(edge, number);
        while (row.is_there.load(std::memory_order_acquire) == 0)
            std::this_thread::yield();
        return row;
    }

    Shared* shared_;
    std::array<std::int64_t, kEdges.size()> known_{};
    std::array<std::map<StampNs, std::vector<std::int64_t>>, kEdges.size()> by_stamp_;
};

inline geometry::Vec3 turned(geometry::Vec3 v, int times) {
    for (int i = 0; i < times % 3; ++i)
        v = {v.z, v.x, v.y};
    return v;
}

/// One edge of an answer: which value, or which two.
struct Part {
    std::size_t edge = 0;
    lookup::Used used = lookup::Used::kLatest;
    StampNs before_stamp = -1;
    StampNs after_stamp = -1;
    std::int64_t before = 0;  // 0: no value explains the pose
    std::int64_t after = 0;
    int sign = 1;
};

/// Reads the values back from the pose of a lookup.
/// Threads: one each. Guarantee: blocking, for a moment.
class Decoder {
public:
    explicit Decoder(Values& values) : values_(values) {}

    /// The parts with their values; `good` is false where pose, path and report disagree.
    bool decode(const lookup::Answer& answer, const std::string& target, const std::string& source,
                const std::vector<std::pair<std::string, std::string>>& path,
                std::vector<Part>& parts) const {
        parts.clear();
        bool good = joined(answer, target, source, path);
        for (std::size_t i = 0; i < path.size(); ++i) {
            const auto edge = edge_of(path[i].first);
            if (!edge)
                return false;
            const lookup::EdgeUse& use = answer.edges[i];
            parts.push_back({*edge, use.used, use.before, use.after, 0, 0, use.inverted ? -1 : 1});
        }
        const geometry::Vec3 d = turned(answer.pose.translation, depth_of(target));
        const double axes[3] = {d.x, d.y, d.z};
        for (int axis = 0; axis < 3; ++axis) {
            std::vector<Part*> here;
            for (Part& part : parts) {
                if (axis_of(kEdges[part.edge]) == axis)
                    here.push_back(&part);
            }
            good = explain(here, answer.stamp, axes[axis]) && good;
        }
        for (std::size_t i = 0; i < path.size(); ++i)
            good = parent_fits(parts[i], path[i].second) && good;
        return good;
    }

private:
    /// From the source upward, then from the target upward, to one frame; turned as often.
    static bool joined(const lookup::Answer& answer, const std::string& target,
                       const std::string& source,
                       const std::vector<std::pair<std::string, std::string>>& path) {
        std::string up = source;
        std::string down = target;
        for (std::size_t i = 0; i < path.size(); ++i) {
            std::string& end = answer.edges[i].inverted ? down : up;
            if (end != path[i].first)
                return false;
            end = path[i].second;
        }
        const geometry::Quat& q = answer.pose.rotation;
        const int turns = ((depth_of(source) - depth_of(target)) % 3 + 3) % 3;
        const double w = turns == 0 ? 1.0 : 0.5;
        return up == down && std::fabs(std::fabs(q.w) - w) < 1e-12;
    }

    bool explain(const std::vector<Part*>& here, StampNs stamp, double seen) const {
        for (const Part* part : here) {
            if (part->used == lookup::Used::kInterpolated) {
                Guess guess;
                guess_mixed(here, 0, stamp, seen, guess);
                return settle(here, guess);
            }
        }
        // Mixed values on another axis cost this one its last bits.
        if (std::fabs(std::nearbyint(seen) - seen) > kTolerance)
            return false;
        auto left = static_cast<std::int64_t>(std::nearbyint(seen));
        for (int digit = 0; digit < 3; ++digit) {
            for (Part* part : here) {
                if (kEdges[part->edge].digit != digit)
                    continue;
                const std::int64_t scale = std::int64_t{1} << (kBits * digit);
                part->before = ((part->sign * left / scale) % kValues + kValues) % kValues;
                left -= part->sign * part->before * scale;
            }
        }
        bool good = left == 0;
        for (const Part* part : here) {
            const auto value = values_.find(part->edge, part->before);
            good = good && value &&
                   (kEdges[part->edge].is_static || value->stamp == part->before_stamp);
        }
        return good;
    }

    /// The combination that comes nearest to the pose, and by how much the next one is worse.
    struct Guess {
        double best = kTolerance;
        double second = 1e300;
        std::vector<std::pair<std::int64_t, std::int64_t>> values;
        std::vector<std::pair<std::int64_t, std::int64_t>> trial;
    };

    /// Tries the values that were written at the stamps of the report.
    void guess_mixed(const std::vector<Part*>& here, std::size_t from, StampNs stamp, double left,
                     Guess& guess) const {
        if (from == here.size()) {
            const double off = std::fabs(left);
            if (off < guess.best) {
                guess.second = guess.values.empty() ? guess.second : guess.best;
                guess.best = off;
                guess.values = guess.trial;
            } else {
                guess.second = std::fmin(guess.second, off);
            }
            return;
        }
        const Part& part = *here[from];
        const bool mixed = part.used == lookup::Used::kInterpolated;
        const double scale =
            part.sign * static_cast<double>(std::int64_t{1} << (kBits * kEdges[part.edge].digit));
        const double weight = mixed ? static_cast<double>(stamp - part.before_stamp) /
                                          static_cast<double>(part.after_stamp - part.before_stamp)
                                    : 0.0;
        // Copies: what is asked for first may move.
        for (const std::int64_t before : std::vector(values_.at(part.edge, part.before_stamp))) {
            for (const std::int64_t after :
                 mixed ? std::vector(values_.at(part.edge, part.after_stamp))
                       : std::vector{before}) {
                const double value = static_cast<double>(before) * (1.0 - weight) +
                                     static_cast<double>(after) * weight;
                guess.trial.emplace_back(before, after);
                guess_mixed(here, from + 1, stamp, left - scale * value, guess);
                guess.trial.pop_back();
            }
        }
    }

    /// Where two combinations come near, the values stay unknown.
    static bool settle(const std::vector<Part*>& here, const Guess& guess) {
        for (std::size_t i = 0; i < guess.values.size(); ++i) {
            const bool sure = guess.second > 2.0 * kTolerance;
            here[i]->before = sure ? guess.values[i].first : kUnknown;
            here[i]->after = sure ? guess.values[i].second : kUnknown;
        }
        return !guess.values.empty();
    }

    bool parent_fits(const Part& part, const std::string& parent) const {
        if (part.before == kUnknown)
            return true;
        const auto value = values_.find(part.edge, part.before);
        return value && value->parent == parent;
    }

    Values& values_;
};

}  // namespace tfdb::recorder
