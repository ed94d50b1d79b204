// How costs grow: each call's time at n, 2 n, 4 n and 8 n, and the exponent that fits the ends.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <functional>
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
}
