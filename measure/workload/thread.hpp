// One thread of the workload: draws where, does it, notes how long it took.
#pragma once

#include <pthread.h>
#include <sched.h>
#include <sys/prctl.h>

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <optional>
#include <thread>
#include <vector>

#include "clock.hpp"
#include "random.hpp"
#include "store.hpp"
#include "tally.hpp"

namespace tfdb::driver {

enum class Phase : int { kWarmup, kMeasure, kStop };

/// What the threads share. Each word has a line of its own, else it would be what is measured.
struct Stage {
    alignas(128) std::atomic<Phase> phase{Phase::kWarmup};
    alignas(128) std::atomic<std::uint32_t> ready{0};
    alignas(128) std::atomic<bool> go{false};
};

/// What a thread does: how many of its operations read, and how often it starts one.
struct Role {
    double read_share = 1.0;
    double frequency = 0.0;
};

inline Role role_of(const Options& options, std::uint32_t index) {
    if (index < options.readers()) {
        return {1.0, options.read_frequency};
    }
    if (index < options.readers() + options.mixed()) {
        return {options.mixed_share(), options.read_frequency};
    }
    return {0.0, options.write_frequency};
}

inline void pin_to(std::uint32_t index) {
    cpu_set_t allowed;
    CPU_ZERO(&allowed);
    if (sched_getaffinity(0, sizeof allowed, &allowed) != 0) {
        return;
    }
    const int count = std::max(CPU_COUNT(&allowed), 1);
    int skip = static_cast<int>(index) % count;
    for (int cpu = 0; cpu < CPU_SETSIZE; ++cpu) {
        if (CPU_ISSET(cpu, &allowed) && skip-- == 0) {
            cpu_set_t one;
            CPU_ZERO(&one);
            CPU_SET(cpu, &one);
            pthread_setaffinity_np(pthread_self(), sizeof one, &one);
            return;
        }
    }
}

// Where the next operation goes. Hot ranks are the same for readers and writers, and lie scattered.
// Threads: one. Guarantee: skewed draws are made ahead; `next` costs a few cycles.
class Places {
public:
    Places(std::uint32_t count, const Options& options, std::uint64_t seed)
        : count_(count), random_(seed) {
        if (options.skew <= 0) {
            return;
        }
        const Zipf zipf(options.joints, options.skew);
        ahead_.resize(kAhead);
        for (std::uint32_t& place : ahead_) {
            const std::uint64_t scattered = zipf.draw(random_) * std::uint64_t{2'654'435'761};
            place = static_cast<std::uint32_t>(scattered % options.joints % count_);
        }
    }

    std::uint32_t next() noexcept {
        if (ahead_.empty()) {
            return random_.below(count_);
        }
        return ahead_[at_++ % kAhead];
    }
    bool chance(double share) noexcept { return random_.unit() <= share; }

private:
    static constexpr std::size_t kAhead = 1 << 15;
    std::uint32_t count_;
    Random random_;
    std::vector<std::uint32_t> ahead_;
    std::size_t at_ = 0;
};

// Threads: `run` in its own; the rest before and after. Guarantee: measures without allocating.
template <Store S>
class alignas(128) Thread {
public:
    Thread(S& store, const Forest& forest, const Options& options, const Clock& clock,
           std::uint32_t index)
        : store_(store),
          forest_(forest),
          options_(options),
          clock_(clock),
          index_(index),
          role_(role_of(options, index)),
          reads_(forest.paths(), options, options.seed * 1'000'003 + 2 * index),
          writes_(forest.runs(), options, options.seed * 1'000'003 + 2 * index + 1),
          left_(options.iterations) {}

    void run(Stage& stage) {
        if (options_.pin) {
            pin_to(index_);
        }
        prctl(PR_SET_TIMERSLACK, 1);
        typename S::Worker worker(store_);
        ++stage.ready;
        while (!stage.go.load()) {
            std::this_thread::yield();
        }
        role_.frequency > 0 ? paced(worker, stage) : flat_out(worker, stage);
        ended_ = clock_.now();
    }

    [[nodiscard]] const Tally& tally() const { return tally_; }
    [[nodiscard]] std::int64_t ended() const { return ended_; }

private:
    using Worker = typename S::Worker;
    /// Of so many lookups one notes the stamps that it used: looking at each edge of all of them
    /// would cost a part of what is measured.
    static constexpr std::uint64_t kAgeEvery = 8;

    void flat_out(Worker& worker, Stage& stage) {
        std::int64_t begin = clock_.now();
        for (Phase phase = phase_of(stage); phase != Phase::kStop; phase = phase_of(stage)) {
            const std::int64_t end = operate(worker, stage, phase, begin, nullptr);
            if (phase == Phase::kMeasure && is_last()) {
                return;
            }
            begin = end;
        }
    }

    /// One operation per period at fixed times; a late one skips those that it has missed.
    void paced(Worker& worker, Stage& stage) {
        const auto period = static_cast<std::int64_t>(1e9 / role_.frequency);
        const std::int64_t allowed = options_.deadline_ms > 0
                                         ? static_cast<std::int64_t>(1e6 * options_.deadline_ms)
                                         : period;
        Random random(options_.seed + 31 * index_);
        std::int64_t due =
            clock_.now() + static_cast<std::int64_t>(random.unit() * 1e9 / role_.frequency);
        for (;;) {
            const Phase phase = wait_for(due, stage);
            if (phase == Phase::kStop) {
                return;
            }
            Lane* lane = nullptr;
            const std::int64_t end = operate(worker, stage, phase, clock_.now(), &lane);
            const std::int64_t skipped = std::max<std::int64_t>((end - due) / period, 0);
            if (phase == Phase::kMeasure) {
                lane->due += 1 + static_cast<std::uint64_t>(skipped);
                lane->met += end - due <= allowed ? 1 : 0;
                if (is_last()) {
                    return;
                }
            }
            due += (1 + skipped) * period;
        }
    }

    Phase wait_for(std::int64_t due, Stage& stage) {
        constexpr std::int64_t kLook = 20'000'000;  // how late the end of the run may be noticed
        for (;;) {
            const std::int64_t now = clock_.now();
            const Phase phase = phase_of(stage);
            if (phase == Phase::kStop || now >= due) {
                return phase;
            }
            clock_.sleep_until(std::min(due, now + kLook));
        }
    }

    std::int64_t operate(Worker& worker, Stage& stage, Phase phase, std::int64_t begin,
                         Lane** which) {
        const bool reads =
            role_.read_share >= 1.0 || (role_.read_share > 0.0 && reads_.chance(role_.read_share));
        Lane& lane = reads ? tally_.reads : tally_.writes;
        Path path{};
        Used used;
        std::uint64_t lost = 0;
        if (reads) {
            path = forest_.path(reads_.next());
        }
        const bool ages = reads && ++turn_ % kAgeEvery == 0;
        const bool good =
            reads ? read(worker, path, ages ? &used : nullptr, lost) : write(worker, begin, lost);
        const std::int64_t end = clock_.now();
        if (which != nullptr) {
            *which = &lane;
        }
        if (phase == Phase::kMeasure) {
            lane.latency.record(end - begin);
            lane.lost += lost;
            if (phase_of(stage) == Phase::kMeasure) {
                ++(good ? lane.done : lane.failed);
                lane.edges += good ? (reads ? path.edges : options_.write_length) : 0;
            }
            if (ages && good) {
                tally_.age.record(end - used.oldest);
                tally_.spread.record(used.newest - used.oldest);
            }
        }
        return end;
    }

    bool read(Worker& worker, const Path& path, Used* used, std::uint64_t& lost) {
        return options_.reads == ReadKind::kLookup ? worker.read(path, used)
                                                   : worker.read_in_transaction(path, used, lost);
    }

    bool write(Worker& worker, std::int64_t stamp, std::uint64_t& lost) {
        const std::uint32_t run = writes_.next();
        switch (options_.writes) {
            case WriteKind::kSingle:
                return worker.write_singly(run, stamp);
            case WriteKind::kModify:
                return worker.modify(run, stamp, lost);
            case WriteKind::kBatch:
                break;
        }
        return worker.write_batch(run, stamp);
    }

    bool is_last() { return options_.iterations > 0 && --left_ == 0; }
    static Phase phase_of(const Stage& stage) {
        return stage.phase.load(std::memory_order_relaxed);
    }

    S& store_;
    const Forest& forest_;
    const Options& options_;
    const Clock& clock_;
    std::uint32_t index_;
    Role role_;
    Places reads_, writes_;
    std::uint64_t left_;
    std::int64_t ended_ = 0;
    std::uint64_t turn_ = 0;
    Tally tally_;
};

}  // namespace tfdb::driver
