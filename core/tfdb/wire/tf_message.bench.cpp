// Nanoseconds per message and per transform for each encoding: the fastest of several rounds.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <string>

#include "tfdb/wire/tf_message.hpp"
#include "tfdb/wire/tf_message.samples.hpp"

namespace tfdb::wire {

namespace {

constexpr int kRounds = 9;
constexpr int kMessagesPerRound = 20000;

// Keeps the compiler from removing a result.
template <typename T>
void keep(const T& value) {
    asm volatile("" : : "g"(&value) : "memory");
}

template <typename Body>
double fastest_ns(const Body& body) {
    double fastest = 1e300;
    for (int round = 0; round < kRounds; ++round) {
        const auto start = std::chrono::steady_clock::now();
        for (int i = 0; i < kMessagesPerRound; ++i) {
            body();
        }
        const std::chrono::duration<double, std::nano> took =
            std::chrono::steady_clock::now() - start;
        fastest = std::min(fastest, took.count() / kMessagesPerRound);
    }
    return fastest;
}

// Names of typical length for robots.
std::vector<TransformView> message_of(std::size_t count, std::vector<std::string>& names) {
    for (std::size_t i = 0; i <= count; ++i) {
        names.push_back("arm_" + std::string(i % 5, 'x') + "_joint_link" + std::to_string(i));
    }
    std::vector<TransformView> transforms;
    for (std::size_t i = 0; i < count; ++i) {
        const double d = static_cast<double>(i);
        transforms.push_back({names[i],
                              names[i + 1],
                              1'700'000'000'123'456'789 + static_cast<clock::StampNs>(i),
                              {{0.1 + d, -0.2 * d, 0.3}, {0.6, 0.0, 0.0, -0.8}}});
    }
    return transforms;
}

void measure(const char* name, Encoding encoding, std::size_t count) {
    std::vector<std::string> names;
    names.reserve(count + 1);
    const std::vector<TransformView> transforms = message_of(count, names);
    std::vector<std::byte> bytes;
    std::vector<TransformView> out;
    encode_tf_message(transforms, encoding, bytes);
    const double decode = fastest_ns([&] {
        keep(bytes);
        decode_tf_message(bytes, encoding, out);
        keep(out);
    });
    const double encode = fastest_ns([&] {
        keep(transforms);
        encode_tf_message(transforms, encoding, bytes);
        keep(bytes);
    });
    const double n = static_cast<double>(count);
    std::printf("%-12s %4zu %12.1f %12.1f %12.1f %12.1f\n", name, count, decode, decode / n, encode,
                encode / n);
}

}  // namespace

}  // namespace tfdb::wire

int main() {
    using tfdb::wire::Encoding;
    std::printf("%-12s %4s %12s %12s %12s %12s\n", "encoding", "n", "decode ns", "per tf",
                "encode ns", "per tf");
    for (const std::size_t count : {1U, 10U, 50U}) {
        tfdb::wire::measure("ros1", Encoding::kRos1, count);
        tfdb::wire::measure("cdr_le", Encoding::kCdr, count);
        tfdb::wire::measure("cdr_be", Encoding::kCdrBig, count);
        tfdb::wire::measure("cdr2_le", Encoding::kCdr2Little, count);
    }
}
