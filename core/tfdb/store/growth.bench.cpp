// How costs grow: each call's time at n, 2 n, 4 n and 8 n, and the exponent that fits the ends.
// Then what the order of a million samples of one edge costs, and what it does to held snapshots.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <functional>
#include <numeric>
#include <random>
#include <string>
#include <vector>

#include "tfdb/store/buffer.hpp"
#include "tfdb/store/transaction.hpp"

namespace tfdb {
namespace {

constexpr int kRounds = 3;
constexpr int kDoublings = 3;
const Pose kPose{{1.0, 2.0, 3.0}, {0.0, 0.0, 0.6, 0.8}};

Buffer keeping_all() {
    BufferOptions options;
    options.history_ns = std::nullopt;
    return Buffer(options);
}

std::vector<TransformView> moving(StampNs count) {
    std::vector<TransformView> batch;
    for (StampNs stamp = 1; stamp <= count; ++stamp)
        batch.push_back({"map", "base", stamp, kPose});
    return batch;
}

/// `a` hangs below `p` and `q` by turns; `x` below `a`.
void re_parent(Buffer& buffer, StampNs count) {
    buffer.set_transform({"a", "x", 0, kPose}, true, "");
    buffer.set_transform({"y", "z", 0, kPose}, true, "");
    std::vector<TransformView> batch;
    for (StampNs stamp = 1; stamp <= count; ++stamp)
        batch.push_back({stamp % 2 == 0 ? "p" : "q", "a", stamp, kPose});
    buffer.set_transforms(batch, false, "");
}

void write_accepted(Buffer& buffer, StampNs) {
    buffer.set_transform({"x", "y", 1, kPose}, false, "");
}

void write_refused(Buffer& buffer, StampNs) {
    try {
        buffer.set_transform({"x", "p", 1, kPose}, false, "");
    } catch (const CycleError&) {
        return;
    }
    std::puts("the cycle was not refused");
}

void descend(Buffer& buffer, StampNs count) {
    Transaction tx(buffer);
    for (StampNs stamp = count; stamp > 0; --stamp) {
        const TransformView transform{"map", "base", stamp, kPose};
        tx.set_transforms({&transform, 1}, false, "");
    }
    tx.commit();
}

void name_authors(Buffer& buffer, StampNs count) {
    for (StampNs stamp = 1; stamp <= count; ++stamp) {
        buffer.set_transform({"map", "base", stamp, kPose}, false,
                             "/robot_7/localisation/instance/" + std::to_string(stamp));
    }
}

void name_frames(Buffer& buffer, StampNs count) {
    for (StampNs i = 0; i < count; ++i)
        buffer.set_transform({"map", "joint" + std::to_string(i), 0, kPose}, true, "");
}

struct Growth {
    const char* name;
    StampNs first;
    std::function<void(Buffer&, StampNs)> before;
    std::function<void(Buffer&, StampNs)> call;
};

void fill(Buffer& buffer, StampNs count) {
    buffer.set_transforms(moving(count), false, "");
}
void nothing(Buffer&, StampNs) {}

double fastest_ms(const Growth& growth, StampNs count) {
    double fastest = 1e300;
    for (int round = 0; round < kRounds; ++round) {
        Buffer buffer = keeping_all();
        growth.before(buffer, count);
        const auto start = std::chrono::steady_clock::now();
        growth.call(buffer, count);
        const std::chrono::duration<double, std::milli> took =
            std::chrono::steady_clock::now() - start;
        fastest = std::min(fastest, took.count());
    }
    return fastest;
}

void report(const Growth& growth) {
    std::printf("%-36s", growth.name);
    double first = 0.0;
    double last = 0.0;
    for (int doubling = 0; doubling <= kDoublings; ++doubling) {
        const StampNs count = growth.first << doubling;
        last = fastest_ms(growth, count);
        if (doubling == 0)
            first = last;
        std::printf(" %8lld: %9.3f", static_cast<long long>(count), last);
    }
    std::printf("   n^%.2f\n", std::log2(last / first) / kDoublings);
}

// -- one edge of a million samples ------------------------------------------------------------

constexpr StampNs kSamples = 1'000'000;
constexpr StampNs kPeriod = 10;  // between samples; late ones fall in between

double seconds_of(const std::function<void()>& work) {
    const auto start = std::chrono::steady_clock::now();
    work();
    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
    return took.count();
}
void put(Buffer& buffer, StampNs stamp) {
    buffer.set_transform({"map", "base", stamp, kPose}, false, "");
}

void write_in_order(Buffer& buffer) {
    for (StampNs i = 1; i <= kSamples; ++i)
        put(buffer, kPeriod * i);
}
/// Each older than the one before.
void write_backwards(Buffer& buffer) {
    for (StampNs i = kSamples; i > 0; --i)
        put(buffer, kPeriod * i);
}
/// Each older than the newest.
void write_behind_one(Buffer& buffer) {
    put(buffer, kPeriod * kSamples);
    for (StampNs i = 1; i < kSamples; ++i)
        put(buffer, kPeriod * i);
}
void write_shuffled(Buffer& buffer) {
    std::vector<StampNs> order(static_cast<std::size_t>(kSamples));
    std::iota(order.begin(), order.end(), 1);
    std::shuffle(order.begin(), order.end(), std::mt19937_64(1));
    for (const StampNs i : order)
        put(buffer, kPeriod * i);
}

void report_orders() {
    struct Order {
        const char* name;
        void (*write)(Buffer&);
    };
    const Order orders[] = {{"in order", write_in_order},
                            {"each older than the last", write_backwards},
                            {"each older than the newest", write_behind_one},
                            {"in random order", write_shuffled}};
    double first = 0.0;
    for (const Order& order : orders) {
        double fastest = 1e300;
        std::size_t bytes = 0;
        for (int round = 0; round < kRounds; ++round) {
            Buffer buffer = keeping_all();
            fastest = std::min(fastest, seconds_of([&] { order.write(buffer); }));
            bytes = buffer.memory().used_bytes;
        }
        if (first == 0.0)
            first = fastest;
        std::printf("1 M writes, %-28s %7.1f ns each, %5.2f of in order, %5.1f bytes a sample\n",
                    order.name, fastest * 1e9 / static_cast<double>(kSamples), fastest / first,
                    static_cast<double>(bytes) / static_cast<double>(kSamples));
    }
}

/// A write, then a lookup a few periods before the newest; every hundredth write is late.
void report_few_late() {
    constexpr int kCalls = 300'000;
    double first = 0.0;
    for (const bool late : {false, true}) {
        double writes = 1e300;
        double lookups = 1e300;
        for (int round = 0; round < kRounds; ++round) {
            BufferOptions options;
            options.history_ns = 20'000 * kPeriod;
            Buffer buffer(options);
            for (StampNs i = 1; i <= 10'000; ++i)
                put(buffer, kPeriod * i);
            StampNs newest = 10'000 * kPeriod;
            const auto write = [&](int call) {
                if (late && call % 100 == 0) {
                    put(buffer, newest - 25 * kPeriod + 3);
                } else {
                    put(buffer, newest += kPeriod);
                }
            };
            writes = std::min(writes, seconds_of([&] {
                                  for (int call = 0; call < kCalls; ++call)
                                      write(call);
                              }));
            lookups = std::min(lookups, seconds_of([&] {
                                   for (int call = 0; call < kCalls; ++call) {
                                       write(call);
                                       (void)buffer.lookup_transform("map", "base",
                                                                     newest - 10 * kPeriod - 4);
                                   }
                               }));
        }
        std::printf("%-36s %7.1f ns a write, %7.1f ns a write and a lookup",
                    late ? "1 of 100 late" : "none late", writes * 1e9 / kCalls,
                    lookups * 1e9 / kCalls);
        if (!late)
            first = lookups;
        std::printf(", %5.2f\n", lookups / first);
    }
}

double lookup_ns(const Reads& reads) {
    constexpr int kCalls = 200'000;
    double fastest = 1e300;
    for (int round = 0; round < kRounds; ++round) {
        fastest = std::min(fastest, seconds_of([&] {
                               for (StampNs i = 1; i <= kCalls; ++i)
                                   (void)reads.lookup_transform("map", "base", kPeriod * i + 3);
                           }));
    }
    return fastest * 1e9 / kCalls;
}

/// Late samples until the held snapshot is lost, or a million of them.
void report_flood() {
    constexpr StampNs kStep = 10'000;
    Buffer buffer = keeping_all();
    write_in_order(buffer);
    const Snapshot held = buffer.snapshot();
    std::printf("held snapshot, ns a lookup:          %7.1f before", lookup_ns(held));
    double last = 0.0;
    StampNs late = 0;
    try {
        while (late < kSamples - kStep) {
            for (const StampNs end = late + kStep; late < end; ++late)
                put(buffer, kPeriod * (late + 1) + 5);
            last = lookup_ns(held);
        }
        std::printf(" and %7.1f after %lld late samples\n", last, static_cast<long long>(late));
    } catch (const SnapshotTooOld&) {
        std::printf(" and %7.1f until it is lost, after %lld late samples\n", last,
                    static_cast<long long>(late));
    }
}

void report_held() {
    Buffer cleared = keeping_all();
    write_in_order(cleared);
    const Snapshot before_clear = cleared.snapshot();
    std::printf("held snapshot, ns a lookup:          %7.1f before", lookup_ns(before_clear));
    cleared.clear();
    for (StampNs i = 1; i <= 1'000; ++i)
        put(cleared, kPeriod * i);
    std::printf(" and %7.1f after clear()\n", lookup_ns(before_clear));

    report_flood();
}

/// Of each write the fastest of all rounds: what the machine does beside it comes elsewhere.
void report_longest_write() {
    std::vector<double> fastest(static_cast<std::size_t>(kSamples), 1e300);
    for (int round = 0; round < kRounds; ++round) {
        Buffer buffer = keeping_all();
        StampNs i = 0;
        for (double& write : fastest) {
            ++i;
            write = std::min(write, seconds_of([&] { put(buffer, kPeriod * i); }));
        }
    }
    std::printf("longest of 1 M writes to one edge    %7.1f us\n",
                *std::max_element(fastest.begin(), fastest.end()) * 1e6);
}

}  // namespace
}  // namespace tfdb

int main() {
    using namespace tfdb;
    const Growth all[] = {
        {"accepted above n parents", 12'500, re_parent, write_accepted},
        {"refused above n parents", 12'500, re_parent, write_refused},
        {"transaction, n descending stamps", 10'000, nothing, descend},
        {"n writes, each of a new authority", 12'500, nothing, name_authors},
        {"n frames jointN", 12'500, nothing, name_frames},
        {"tree of n samples", 250'000, fill,
         [](Buffer& b, StampNs) { (void)b.tree(std::nullopt); }},
        {"samples of n", 250'000, fill, [](Buffer& b, StampNs) { (void)b.samples("base"); }},
    };
    std::puts("ms, the fastest of several rounds");
    for (const Growth& growth : all)
        report(growth);
    report_orders();
    report_few_late();
    report_held();
    report_longest_write();
}
