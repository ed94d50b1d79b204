// The real tf2 under the workload. It has neither batches nor transactions, and its newest pose is
// the one at the latest common time: that is what it is asked for.
#pragma once

#include <cstdint>
#include <optional>

#include "store.hpp"
#include "tf2/tf2.hpp"

namespace tfdb::driver {

using real_tf2::Tf2;

// Threads: any. Guarantee: as tf2's.
class Tf2Store {
public:
    class Worker;
    static constexpr bool kNewestOfEachEdge = false;
    /// tf2 takes a longer walk to the root for a loop.
    static constexpr std::uint32_t kDeepestWalk = 1'000;

    Tf2Store(const Options& options, const Forest& forest, const Motion& motion)
        : options_(options),
          forest_(forest),
          motion_(motion),
          tf2_(static_cast<std::int64_t>(1e9 * options.history_seconds())) {
        if (options.engine != "tf2") {
            throw BadOption("unknown engine '" + options.engine + "': this program has tf2 alone");
        }
        if (options.reads == ReadKind::kTransaction || options.writes == WriteKind::kModify) {
            throw BadOption("tf2 has no transactions: --reads lookup, --writes batch or single");
        }
        if (options.from_low && options.joints > kDeepestWalk) {
            throw BadOption(
                "tf2 follows at most 1000 frames: --lookup-from high, or fewer --joints");
        }
    }

    void fill(std::int64_t stamp) {
        Tf2::Message message;
        for (std::uint32_t frame = 1; frame <= forest_.edges(); ++frame) {
            set(frame, stamp, message);
        }
    }

    [[nodiscard]] Pose probe(const Path& path, std::optional<std::int64_t> at, Used& used) {
        const real_tf2::Found found =
            tf2_.get(forest_.name(path.low), forest_.name(path.high), at.value_or(0));
        used = {found.stamp, found.stamp};
        const double* p = found.pose.values;
        return {{p[0], p[1], p[2]}, {p[3], p[4], p[5], p[6]}};
    }

    [[nodiscard]] StoreCounters counters() { return {}; }

private:
    bool set(std::uint32_t frame, std::int64_t stamp, Tf2::Message& message) {
        return tf2_.set(forest_.name(forest_.parent(frame)), forest_.name(frame), stamp,
                        &motion_.at(frame, stamp).translation.x, message);
    }

    const Options& options_;
    const Forest& forest_;
    const Motion& motion_;
    Tf2 tf2_;
};

// Threads: one. Guarantee: as its store's.
class Tf2Store::Worker {
public:
    explicit Worker(Tf2Store& store)
        : store_(store), climbs_(store.options_.opposite == store.options_.from_low) {}

    bool read(const Path& path, Used* used) {
        const bool from_low = store_.options_.from_low;
        std::int64_t stamp = 0;
        const bool found = store_.tf2_.newest(store_.forest_.name(from_low ? path.high : path.low),
                                              store_.forest_.name(from_low ? path.low : path.high),
                                              stamp, message_);
        if (used != nullptr) {
            *used = {stamp, stamp};
        }
        return found;
    }
    bool read_in_transaction(const Path&, Used*, std::uint64_t&) { return false; }

    bool write_batch(std::uint32_t run, std::int64_t stamp) { return write_singly(run, stamp); }
    bool write_singly(std::uint32_t run, std::int64_t stamp) {
        const std::uint32_t length = store_.options_.write_length;
        bool all = true;
        for (std::uint32_t i = 0; i < length; ++i) {
            all &= store_.set(climbs_ ? run + length - i : run + 1 + i, stamp, message_);
        }
        return all;
    }
    bool modify(std::uint32_t, std::int64_t, std::uint64_t&) { return false; }

private:
    Tf2Store& store_;
    bool climbs_;
    Tf2::Message message_;
};

}  // namespace tfdb::driver
