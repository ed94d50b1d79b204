// Two static edges revised as a pair by one writer at full speed, one reader that looks through
// both. Their product is constant: a reader that sees half of a revision sees another pose.
//
//   torn_pair tf2|tfdb SECONDS
//
// prints {"store": ..., "reads": ..., "torn": ..., "writes": ...}.

#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <string>
#include <thread>
#include <vector>

#include "scenario.hpp"

namespace {

using tfdb::Pose;

constexpr std::size_t kRevisions = 256;
const std::string kRoot = "root";
const std::string kMiddle = "middle";
const std::string kTip = "tip";

struct Pair {
    Pose lower, upper;  // T[root<-middle], T[middle<-tip]
};

/// Revisions whose product is the same pose to rounding; any two of them mixed are centimetres off.
std::array<Pair, kRevisions> revisions() {
    std::array<Pair, kRevisions> pairs;
    const Pose product = bench::moving_pose(5, 0.3);
    for (std::size_t i = 0; i < kRevisions; ++i) {
        const Pose lower = bench::moving_pose(2, 0.15 * static_cast<double>(i));
        pairs[i] = {lower, tfdb::geometry::compose(tfdb::geometry::inverse(lower), product)};
    }
    return pairs;
}

bool is_whole(const Pose& pose) {
    static const Pose product = bench::moving_pose(5, 0.3);
    return std::fabs(pose.translation.x - product.translation.x) < 1e-6 &&
           std::fabs(pose.translation.y - product.translation.y) < 1e-6 &&
           std::fabs(pose.translation.z - product.translation.z) < 1e-6;
}

/// One writer, one reader, for a while. `write` stores a revision, `read` gives T[root<-tip].
int race(const char* store, double seconds, const std::function<void(const Pair&)>& write,
         const std::function<Pose()>& read) {
    const auto pairs = revisions();
    write(pairs[0]);
    std::atomic<bool> stop{false};
    std::uint64_t writes = 0;
    std::thread writer([&] {
        for (; !stop.load(std::memory_order_relaxed); ++writes) {
            write(pairs[writes % kRevisions]);
        }
    });
    std::uint64_t reads = 0;
    std::uint64_t torn = 0;
    const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
    while (std::chrono::steady_clock::now() < end) {
        for (int i = 0; i < 1'000; ++i, ++reads) {
            torn += is_whole(read()) ? 0 : 1;
        }
    }
    stop = true;
    writer.join();
    std::printf("{\"store\": \"%s\", \"reads\": %llu, \"torn\": %llu, \"writes\": %llu}\n", store,
                static_cast<unsigned long long>(reads), static_cast<unsigned long long>(torn),
                static_cast<unsigned long long>(writes));
    return 0;
}

int race_tf2(double seconds) {
    real_tf2::Tf2 buffer(10'000'000'000);
    real_tf2::Tf2::Message message;
    const auto write = [&](const Pair& pair) {
        buffer.set(kRoot, kMiddle, 1, bench::plain(pair.lower).values, message, true);
        buffer.set(kMiddle, kTip, 1, bench::plain(pair.upper).values, message, true);
    };
    const auto read = [&] {
        const auto [v] = buffer.get(kRoot, kTip, 1).pose;
        return Pose{{v[0], v[1], v[2]}, {v[3], v[4], v[5], v[6]}};
    };
    return race("tf2", seconds, write, read);
}

int race_ours(double seconds) {
    tfdb::Buffer buffer;
    const auto write = [&](const Pair& pair) {
        const std::array<tfdb::TransformView, 2> batch{
            tfdb::TransformView{kRoot, kMiddle, 1, pair.lower},
            tfdb::TransformView{kMiddle, kTip, 1, pair.upper}};
        buffer.set_transforms(batch, true, "pair");
    };
    const auto read = [&] { return buffer.lookup_transform(kRoot, kTip, 1).pose; };
    return race("tfdb", seconds, write, read);
}

}  // namespace

int main(int argc, char** argv) {
    const std::string store = argc == 3 ? argv[1] : "";
    if (store != "tf2" && store != "tfdb") {
        std::fprintf(stderr, "usage: torn_pair tf2|tfdb SECONDS\n");
        return 2;
    }
    const double seconds = std::strtod(argv[2], nullptr);
    return store == "tf2" ? race_tf2(seconds) : race_ours(seconds);
}
