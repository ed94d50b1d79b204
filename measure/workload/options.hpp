// The parameters of one point of a measurement, as the command line gives them.
#pragma once

#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>

namespace tfdb::driver {

enum class Tree : std::uint8_t { kChain, kStar, kHumanoid, kRandom };
/// Each edge's newest sample; or the newest stamp that all edges have, interpolated.
enum class Time : std::uint8_t { kLatest, kCommon };
enum class ReadKind : std::uint8_t { kLookup, kTransaction };
/// One atomic write; one write per edge; or a transaction that reads edges and writes the same.
enum class WriteKind : std::uint8_t { kBatch, kSingle, kModify };
/// Whether the read ratio is a share of the threads or of each thread's operations.
enum class Share : std::uint8_t { kThreads, kOperations };

/// Defaults are those of the paper, save the sizes, which suit a small machine.
struct Options {
    std::string engine = "snapshot";
    std::uint32_t threads = 2;
    std::uint32_t joints = 1'000;
    double seconds = 1.0;
    std::uint64_t iterations = 0;  // operations per thread instead of seconds
    double read_ratio = 0.5;
    Share share = Share::kThreads;
    std::uint32_t read_length = 16;
    std::uint32_t write_length = 16;
    double read_frequency = 0.0;  // per thread and second; 0: without pause
    double write_frequency = 0.0;
    double deadline_ms = 0.0;  // after an operation's scheduled start; 0: one period
    double skew = 0.0;         // Zipf's theta
    bool opposite = true;      // a batch is given against the order in which a lookup climbs
    bool from_low = false;     // T[high<-low] instead of T[low<-high]
    Tree tree = Tree::kChain;
    Time time = Time::kLatest;
    ReadKind reads = ReadKind::kLookup;
    WriteKind writes = WriteKind::kBatch;
    bool pin = true;
    std::uint64_t seed = 1;
    double warmup = 0.1;   // seconds
    double history = 0.0;  // seconds; 0: chosen from joints and frequency
    std::uint32_t probes = 32;
    bool help = false;

    /// Threads that only read, that only write, and that do both (0 or 1 of them, or all).
    [[nodiscard]] std::uint32_t readers() const;
    [[nodiscard]] std::uint32_t mixed() const;
    [[nodiscard]] std::uint32_t writers() const { return threads - readers() - mixed(); }
    /// Of a thread that does both: how many of its operations read.
    [[nodiscard]] double mixed_share() const;
    [[nodiscard]] double history_seconds() const;
};

// A bad option. Threads: a value. Guarantee: the message says what would be valid.
class BadOption : public std::runtime_error {
public:
    using std::runtime_error::runtime_error;
};

/// Throws BadOption. `arguments` without the program's name.
Options parse(const std::vector<std::string>& arguments);
std::string usage();

}  // namespace tfdb::driver
