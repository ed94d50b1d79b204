// Several threads: readers alone, and a reader's latency beside a writer that goes flat out.

#include <algorithm>
#include <atomic>
#include <chrono>
#include <functional>
#include <string>
#include <thread>
#include <vector>

#include "groups.hpp"
#include "scenario.hpp"

namespace bench {
namespace {

constexpr int kChain = 10;
constexpr double kWindow = 0.25;  // seconds of one measurement

/// One reader's loop: does one lookup of each store's kind.
using MakeLookup = std::function<std::function<void(std::size_t)>()>;

/// Lookups per second of all threads together, in thousands.
double throughput(int threads, const MakeLookup& make) {
    std::atomic<bool> go{false};
    std::atomic<bool> stop{false};
    std::atomic<std::size_t> total{0};
    std::vector<std::thread> pool;
    for (int i = 0; i < threads; ++i) {
        pool.emplace_back([&] {
            const auto lookup = make();
            while (!go.load()) {
            }
            std::size_t done = 0;
            for (; !stop.load(std::memory_order_relaxed); ++done) {
                lookup(done);
            }
            total += done;
        });
    }
    const double start = wall_seconds();
    go = true;
    std::this_thread::sleep_for(std::chrono::duration<double>(kWindow));
    stop = true;
    for (std::thread& thread : pool) {
        thread.join();
    }
    return 1e-3 * static_cast<double>(total.load()) / (wall_seconds() - start);
}

struct Latency {
    double p50, p99, p999, max;  // microseconds
    double writes;               // of the writer beside it, thousands per second
};

Latency latency(const MakeLookup& make, const std::function<void()>& write) {
    std::atomic<bool> stop{false};
    std::size_t writes = 0;
    std::thread writer([&] {
        for (; !stop.load(std::memory_order_relaxed); ++writes) {
            write();
        }
    });
    const auto lookup = make();
    std::vector<double> took;
    took.reserve(1'000'000);
    const double start = wall_seconds();
    double before = start;
    for (std::size_t i = 0; before - start < 4 * kWindow; ++i) {
        before = wall_seconds();
        lookup(i);
        took.push_back(1e6 * (wall_seconds() - before));
    }
    stop = true;
    writer.join();
    const double window = wall_seconds() - start;
    std::sort(took.begin(), took.end());
    const auto at = [&](double part) {
        return took[static_cast<std::size_t>(part * static_cast<double>(took.size() - 1))];
    };
    return {at(0.5), at(0.99), at(0.999), took.back(), 1e-3 * static_cast<double>(writes) / window};
}

struct Lookups {
    explicit Lookups(Chain& chain)
        : chain_(chain),
          stamps_(chain.stamps(1'024, 60 * kPeriod, 8 * kPeriod)),
          question_(chain.names.front(), chain.names.back(), stamps_) {
        chain.verify(stamps_);
    }

    [[nodiscard]] MakeLookup tf2() const {
        return
            [this] { return [this](std::size_t i) { chain_.theirs->lookup_one(question_, i); }; };
    }

    [[nodiscard]] MakeLookup ours() const {
        return [this] {
            return
                [this, answer = tfdb::Answer{}, failure = tfdb::Failure{}](std::size_t i) mutable {
                    const tfdb::StampNs stamp = stamps_[i & 1'023];
                    keep(chain_.ours->ask(
                        tfdb::store::at_stamp(chain_.target, chain_.source, stamp, {}), answer,
                        failure));
                };
        };
    }

    Chain& chain_;
    std::vector<tfdb::StampNs> stamps_;
    real_tf2::Question question_;
};

void scaling_rows(const Options& options, const Lookups& lookups) {
    for (const int threads : {1, 2}) {
        Rounds rounds{{"tf2", {}}, {"tfdb", {}}};
        for (int round = 0; round < options.rounds; ++round) {
            rounds[0].second.push_back(throughput(threads, lookups.tf2()));
            rounds[1].second.push_back(throughput(threads, lookups.ours()));
        }
        print_row("readers, " + std::to_string(threads) + " threads", kChain, "kops/s", rounds);
    }
}

void latency_rows(const Options& options, const Lookups& lookups) {
    Chain& chain = lookups.chain_;
    tfdb::StampNs theirs = chain.newest;
    tfdb::StampNs ours = chain.newest;
    std::size_t turn = 0;
    const auto next_edge = [&](tfdb::StampNs& stamp) {
        const std::size_t edge = turn++ % kChain;
        stamp += edge == 0 ? 1'000 : 0;  // the readers' stamps stay in the history
        return edge;
    };
    const tfdb::Pose pose = moving_pose(3, 0.5);
    real_tf2::Tf2::Message message;
    const auto write_tf2 = [&] {
        const std::size_t edge = next_edge(theirs);
        chain.theirs->set(chain.names[edge], chain.names[edge + 1], theirs, plain(pose).values,
                          message);
    };
    const auto write_ours = [&] {
        const std::size_t edge = next_edge(ours);
        chain.ours->set_transform({chain.names[edge], chain.names[edge + 1], ours, pose}, false,
                                  "bench");
    };
    Rounds p50{{"tf2", {}}, {"tfdb", {}}};
    Rounds p99 = p50;
    Rounds p999 = p50;
    Rounds max = p50;
    Rounds writes = p50;
    for (int round = 0; round < options.rounds; ++round) {
        const Latency both[]{latency(lookups.tf2(), write_tf2),
                             latency(lookups.ours(), write_ours)};
        for (std::size_t i = 0; i < 2; ++i) {
            p50[i].second.push_back(both[i].p50);
            p99[i].second.push_back(both[i].p99);
            p999[i].second.push_back(both[i].p999);
            max[i].second.push_back(both[i].max);
            writes[i].second.push_back(both[i].writes);
        }
    }
    print_row("reader latency p50", kChain, "us", p50);
    print_row("reader latency p99", kChain, "us", p99);
    print_row("reader latency p99.9", kChain, "us", p999);
    print_row("reader latency max", kChain, "us", max);
    print_row("writes beside the reader", kChain, "kops/s", writes);
}

}  // namespace

void thread_rows(const Options& options) {
    Chain chain(kChain, 2'000);
    const Lookups lookups(chain);
    scaling_rows(options, lookups);
    latency_rows(options, lookups);
}

}  // namespace bench
