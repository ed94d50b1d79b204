// tfdb_costs: what tfdb costs where its data are unusual, or many: growth, late samples, held
// snapshots, depth of history, names. Prints rows as tfdb_against_tf2 does.
//
//   tfdb_costs [--rounds N] [--samples N] [writes] [held] [depth] [names] [growth] [bytes] [watch]
//
// A round fills stores of N samples (a million), so few of them do.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <exception>
#include <functional>
#include <memory>
#include <numeric>
#include <optional>
#include <random>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "measure.hpp"
#include "tfdb/graph/names.hpp"
#include "tfdb/store/buffer.hpp"
#include "tfdb/store/transaction.hpp"
#include "tfdb/store/watch.hpp"

namespace bench {
namespace {

using tfdb::Buffer;
using tfdb::Pose;
using tfdb::StampNs;
using tfdb::TransformView;

constexpr StampNs kPeriod = 10;  // between samples; late ones fall in between
const Pose kPose{{1.0, 2.0, 3.0}, {0.0, 0.0, 0.6, 0.8}};

struct Costs {
    int rounds = 3;
    StampNs samples = 1'000'000;
};

Buffer keeping_all() {
    tfdb::BufferOptions options;
    options.history_ns = std::nullopt;
    options.snapshot_memory = std::size_t{4} << 30;
    return Buffer(options);
}

void put(Buffer& buffer, StampNs stamp, const char* parent = "map") {
    buffer.set_transform({parent, "base", stamp, kPose}, false, "");
}

double nanos_of(const std::function<void()>& work) {
    const double start = thread_seconds();
    work();
    return 1e9 * (thread_seconds() - start);
}

void add(Rounds& rounds, const std::string& name, double value) {
    for (auto& [known, values] : rounds) {
        if (known == name) {
            values.push_back(value);
            return;
        }
    }
    rounds.emplace_back(name, std::vector<double>{value});
}

// -- writes of one edge in every order ---------------------------------------------------------

using Order = std::vector<StampNs> (*)(StampNs count);

std::vector<StampNs> in_order(StampNs count) {
    std::vector<StampNs> stamps(static_cast<std::size_t>(count));
    std::iota(stamps.begin(), stamps.end(), 1);
    return stamps;
}
std::vector<StampNs> backwards(StampNs count) {
    auto stamps = in_order(count);
    std::reverse(stamps.begin(), stamps.end());
    return stamps;
}
std::vector<StampNs> behind_one(StampNs count) {
    auto stamps = in_order(count);
    std::rotate(stamps.begin(), stamps.end() - 1, stamps.end());
    return stamps;
}
std::vector<StampNs> shuffled(StampNs count) {
    auto stamps = in_order(count);
    std::shuffle(stamps.begin(), stamps.end(), std::mt19937_64(1));
    return stamps;
}

constexpr std::pair<const char*, Order> kOrders[] = {{"in order", in_order},
                                                     {"each older than the last", backwards},
                                                     {"each older than the newest", behind_one},
                                                     {"in random order", shuffled}};

void order_rows(const Costs& costs) {
    Rounds rounds;
    for (int round = 0; round < costs.rounds; ++round) {
        for (const auto& [name, order] : kOrders) {
            for (const StampNs count : {costs.samples, costs.samples / 4}) {
                const auto stamps = order(count);
                Buffer buffer = keeping_all();
                const double took = nanos_of([&] {
                    for (const StampNs stamp : stamps) {
                        put(buffer, kPeriod * stamp);
                    }
                });
                add(rounds, name + std::string(count == costs.samples ? "" : ", a quarter of them"),
                    took / static_cast<double>(count));
            }
        }
    }
    print_row("write, n samples of one edge", 0, "ns", rounds);
}

/// Of each write the fastest of all rounds: what the machine does beside it comes elsewhere.
void longest_rows(const Costs& costs) {
    for (const auto& [name, order] : kOrders) {
        const auto stamps = order(costs.samples);
        std::vector<double> fastest(stamps.size(), 1e300);
        for (int round = 0; round < std::max(3, costs.rounds); ++round) {
            Buffer buffer = keeping_all();
            for (std::size_t i = 0; i < stamps.size(); ++i) {
                const double start = wall_seconds();
                put(buffer, kPeriod * stamps[i]);
                fastest[i] = std::min(fastest[i], 1e9 * (wall_seconds() - start));
            }
        }
        // The first one makes the store's tables and the edge.
        const double first = std::exchange(fastest.front(), 0.0);
        const double longest = *std::max_element(fastest.begin(), fastest.end());
        const auto middle = fastest.begin() + static_cast<std::ptrdiff_t>(fastest.size() / 2);
        std::nth_element(fastest.begin(), middle, fastest.end());
        print_row(std::string("one write of n, ") + name, 0, "ns",
                  {{"longest", {longest}}, {"median", {*middle}}, {"first", {first}}});
    }
}

/// Blocks of a hundred writes, then of a hundred lookups near the newest sample.
void few_late_rows(const Costs& costs) {
    constexpr int kBlock = 100;
    Rounds writes;
    Rounds lookups;
    for (int round = 0; round < costs.rounds; ++round) {
        for (const bool late : {false, true}) {
            tfdb::BufferOptions options;
            options.history_ns = 20'000 * kPeriod;
            Buffer buffer(options);
            StampNs newest = 0;
            for (int i = 0; i < 10'000; ++i) {
                put(buffer, newest += kPeriod);
            }
            double writing = 0.0;
            double looking = 0.0;
            const StampNs blocks = costs.samples / 4 / kBlock;
            for (StampNs block = 0; block < blocks; ++block) {
                writing += nanos_of([&] {
                    for (int i = 1; i < kBlock; ++i) {
                        put(buffer, newest += kPeriod);
                    }
                    put(buffer, late ? newest - 25 * kPeriod + 3 : newest += kPeriod);
                });
                looking += nanos_of([&] {
                    for (int i = 0; i < kBlock; ++i) {
                        keep(buffer.lookup_transform("map", "base",
                                                     newest - (10 + i % 8) * kPeriod - 4));
                    }
                });
            }
            const char* name = late ? "1 of 100 late" : "in order";
            add(writes, name, writing / static_cast<double>(blocks * kBlock));
            add(lookups, name, looking / static_cast<double>(blocks * kBlock));
        }
    }
    print_row("write, few late", 0, "ns", writes);
    print_row("lookup near the newest, few late", 0, "ns", lookups);
}

void write_rows(const Costs& costs) {
    order_rows(costs);
    longest_rows(costs);
    few_late_rows(costs);
}

// -- what held snapshots cost ------------------------------------------------------------------

/// At stamps first + 1, first + 1 + step, ... of which there are `count`.
double lookup_ns(const tfdb::StoreReader& reads, StampNs first, StampNs step, int count) {
    const double took = nanos_of([&] {
        for (int i = 0; i < count; ++i) {
            keep(reads.lookup_transform("map", "base", first + 1 + step * i));
        }
    });
    return took / count;
}

void held_after_change(Rounds& rounds, StampNs samples) {
    const int count = static_cast<int>(std::min<StampNs>(samples - 2, 100'000));
    for (const bool clears : {true, false}) {
        Buffer buffer = keeping_all();
        for (StampNs i = 1; i <= samples; ++i) {
            put(buffer, kPeriod * i);
        }
        const tfdb::Snapshot held = buffer.snapshot();
        add(rounds, "before", lookup_ns(held, kPeriod, kPeriod, count));
        if (clears) {
            buffer.clear();
        }
        buffer.set_transform({"odom", "map", 0, kPose}, true, "");
        for (StampNs i = 1; i <= 1'000; ++i) {
            put(buffer, kPeriod * (clears ? i : samples + i), clears ? "map" : "odom");
        }
        add(rounds, clears ? "after clear()" : "after re-parenting",
            lookup_ns(held, kPeriod, kPeriod, count));
    }
}

/// As many late samples as there were, each between two that the snapshot sees.
void held_after_flood(Rounds& rounds, StampNs samples) {
    const int count = static_cast<int>(std::min<StampNs>(samples - 2, 100'000));
    Buffer spread = keeping_all();
    for (StampNs i = 1; i <= samples; ++i) {
        put(spread, kPeriod * i);
    }
    const tfdb::Snapshot held = spread.snapshot();
    for (StampNs i = 1; i < samples; ++i) {
        put(spread, kPeriod * i + 5);
    }
    add(rounds, "after n late samples, spread", lookup_ns(held, kPeriod, kPeriod, count));
    const tfdb::Snapshot fresh = spread.snapshot();
    add(rounds, "fresh, after the same", lookup_ns(fresh, kPeriod, kPeriod, count));

    Buffer gap = keeping_all();
    put(gap, 1);
    put(gap, kPeriod * samples);
    const tfdb::Snapshot before = gap.snapshot();
    for (StampNs i = 2; i <= samples; ++i) {
        put(gap, kPeriod * i - 7);
    }
    add(rounds, "after n late samples, in one gap",
        lookup_ns(before, kPeriod, std::max<StampNs>(1, samples / 100) * kPeriod, 90));

    Buffer ahead = keeping_all();
    for (StampNs i = 1; i <= samples; ++i) {
        put(ahead, kPeriod * i);
    }
    const tfdb::Snapshot passed = ahead.snapshot();
    for (StampNs i = samples + 1; i <= 2 * samples; ++i) {
        put(ahead, kPeriod * i);
    }
    add(rounds, "after n later samples", lookup_ns(passed, kPeriod, kPeriod, count));
}

void held_rows(const Costs& costs) {
    Rounds rounds;
    for (int round = 0; round < costs.rounds; ++round) {
        held_after_change(rounds, costs.samples);
        held_after_flood(rounds, costs.samples);
    }
    print_row("lookup in a held snapshot of n samples", 0, "ns", rounds);
}

// -- depth of history --------------------------------------------------------------------------

/// Time of a load whose address the one before has told, each from a line of its own: a cycle
/// through memory that no cache holds.
double dependent_miss_ns() {
    constexpr std::size_t kLines = std::size_t{4} << 20;
    constexpr std::size_t kPerLine = 8;
    std::vector<std::uint64_t> memory(kLines * kPerLine);
    std::vector<std::uint32_t> order(kLines);
    std::iota(order.begin(), order.end(), 0U);
    std::shuffle(order.begin(), order.end(), std::mt19937_64(3));
    for (std::size_t i = 0; i < kLines; ++i) {
        memory[order[i] * kPerLine] = order[(i + 1) % kLines] * kPerLine;
    }
    constexpr int kSteps = 1'000'000;
    std::uint64_t at = 0;
    const double took = nanos_of([&] {
        for (int i = 0; i < kSteps; ++i) {
            at = memory[at];
        }
    });
    keep(at);
    return took / kSteps;
}

void depth_rows(const Costs& costs) {
    const StampNs depths[] = {1'000, 10'000, 36 * costs.samples / 10};
    std::vector<Buffer> buffers;
    for (const StampNs depth : depths) {
        buffers.push_back(keeping_all());
        for (StampNs i = 1; i <= depth; ++i) {
            put(buffers.back(), kPeriod * i);
        }
    }
    constexpr int kLookups = 200'000;
    Rounds times;
    Rounds misses;
    for (int round = 0; round < std::max(5, costs.rounds); ++round) {
        double each[3] = {};
        for (std::size_t which = 0; which < 3; ++which) {
            const Buffer& buffer = buffers[which];
            tfdb::FrameHandle target;
            tfdb::FrameHandle source;
            if (!buffer.find_frame("map", target) || !buffer.find_frame("base", source)) {
                throw std::runtime_error("the edge was not stored");
            }
            std::mt19937_64 random(11);
            std::uniform_int_distribution<StampNs> any(kPeriod, kPeriod * depths[which]);
            std::vector<StampNs> stamps(kLookups);
            std::generate(stamps.begin(), stamps.end(), [&] { return any(random); });
            tfdb::Answer answer;
            tfdb::Failure failure;
            each[which] = nanos_of([&] {
                              for (const StampNs stamp : stamps) {
                                  keep(buffer.ask(tfdb::store::at_stamp(target, source, stamp, {}),
                                                  answer, failure));
                              }
                          }) /
                          kLookups;
            add(times, which == 2 ? "3.6 n samples" : std::to_string(depths[which]) + " samples",
                each[which]);
        }
        const double miss = dependent_miss_ns();
        add(times, "a dependent miss", miss);
        add(misses, "3.6 n samples over 1000", (each[2] - each[0]) / miss);
    }
    print_row("lookup at random, one edge", 0, "ns", times);
    print_row("lookup at random, in dependent misses", 0, "misses", misses);
}

// -- names -------------------------------------------------------------------------------------

/// Mean number of entries looked at for a name, in a table that is at most half full.
double probes(const std::string& prefix, std::size_t count) {
    std::vector<std::uint64_t> table(16);
    std::vector<std::uint64_t> hashes;
    const auto place = [&](std::uint64_t hash) {
        std::size_t tried = 1;
        std::size_t at = hash & (table.size() - 1);
        for (; table[at] != 0 && table[at] != hash; at = (at + 1) & (table.size() - 1)) {
            ++tried;
        }
        table[at] = hash;
        return tried;
    };
    for (std::size_t i = 0; i < count; ++i) {
        hashes.push_back(tfdb::graph::hash_name(prefix + std::to_string(i)));
        if (2 * hashes.size() > table.size()) {
            table.assign(2 * table.size(), 0);
            for (const std::uint64_t hash : hashes) {
                place(hash);
            }
        } else {
            place(hashes.back());
        }
    }
    std::size_t all = 0;
    for (const std::uint64_t hash : hashes) {
        all += place(hash);
    }
    return static_cast<double>(all) / static_cast<double>(count);
}

void name_rows(const Costs&) {
    double worst = 0.0;
    Rounds rounds;
    for (const std::size_t count : {10U, 100U, 1'000U, 10'000U, 100'000U}) {
        double most = 0.0;
        for (const char* prefix : {"joint", "link_", "robot_7/left_arm/finger_", "f", "frame"}) {
            most = std::max(most, probes(prefix, count));
        }
        add(rounds, std::to_string(count) + " frames", most);
        worst = std::max(worst, most);
    }
    add(rounds, "worst", worst);
    print_row("entries looked at per name, prefixN", 0, "entries", rounds);
}

// -- how calls grow ----------------------------------------------------------------------------

struct Growth {
    const char* name;
    StampNs share;  // of the samples, at the greatest n
    std::function<void(Buffer&, StampNs)> before;
    std::function<void(Buffer&, StampNs)> call;
};

void fill(Buffer& buffer, StampNs count) {
    std::vector<TransformView> batch;
    for (StampNs stamp = 1; stamp <= count; ++stamp) {
        batch.push_back({"map", "base", stamp, kPose});
    }
    buffer.set_transforms(batch, false, "");
}

/// `a` hangs below `p` and `q` by turns; `x` below `a`.
void re_parent(Buffer& buffer, StampNs count) {
    buffer.set_transform({"a", "x", 0, kPose}, true, "");
    buffer.set_transform({"y", "z", 0, kPose}, true, "");
    std::vector<TransformView> batch;
    for (StampNs stamp = 1; stamp <= count; ++stamp) {
        batch.push_back({stamp % 2 == 0 ? "p" : "q", "a", stamp, kPose});
    }
    buffer.set_transforms(batch, false, "");
}

void write_refused(Buffer& buffer, StampNs) {
    try {
        buffer.set_transform({"x", "p", 1, kPose}, false, "");
    } catch (const tfdb::CycleError&) {
        return;
    }
    throw std::runtime_error("the cycle was not refused");
}

void descend(Buffer& buffer, StampNs count) {
    tfdb::Transaction tx(buffer);
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
    for (StampNs i = 0; i < count; ++i) {
        buffer.set_transform({"map", "joint" + std::to_string(i), 0, kPose}, true, "");
    }
}

void growth_rows(const Costs& costs) {
    const auto nothing = [](Buffer&, StampNs) {};
    const Growth all[] = {
        {"a write that is accepted, above n parents", 10, re_parent,
         [](Buffer& b, StampNs) {
             b.set_transform({"x", "y", 1, kPose}, false, "");
         }},
        {"a write that is refused, above n parents", 10, re_parent, write_refused},
        {"a transaction of n descending stamps", 10, nothing, descend},
        {"n writes, each of a new authority", 100, nothing, name_authors},
        {"n frames jointN", 10, nothing, name_frames},
        {"tree() of n samples", 1, fill, [](Buffer& b, StampNs) { keep(b.tree(std::nullopt)); }},
        {"frame_info of n samples", 1, fill,
         [](Buffer& b, StampNs) { keep(b.frame_info("base")); }},
        {"samples() of n", 1, fill, [](Buffer& b, StampNs) { keep(b.samples("base")); }},
    };
    for (const Growth& growth : all) {
        Rounds rounds;
        for (int round = 0; round < std::max(3, costs.rounds); ++round) {
            for (const StampNs parts : {8, 1}) {
                Buffer buffer = keeping_all();
                const StampNs count = std::max<StampNs>(costs.samples / growth.share / parts, 1);
                growth.before(buffer, count);
                add(rounds, parts == 1 ? "n" : "an eighth of n",
                    1e-6 * nanos_of([&] { growth.call(buffer, count); }));
            }
        }
        print_row(growth.name, 0, "ms", rounds);
    }
}

// -- commits as bytes ----------------------------------------------------------------------------

/// Ten joints that move, at a time.
class Joints {
public:
    Joints() {
        for (int i = 0; i <= 10; ++i)
            names_.push_back("joint" + std::to_string(i));
    }
    [[nodiscard]] const std::vector<TransformView>& at(StampNs commit) {
        members_.clear();
        for (std::size_t i = 0; i < 10; ++i) {
            const double turn = 0.001 * static_cast<double>(commit) + static_cast<double>(i);
            const Pose pose{{std::sin(turn), std::cos(turn), turn},
                            {0.6 * std::sin(turn), 0.48 * std::sin(turn), 0.64 * std::sin(turn),
                             std::cos(turn)}};
            members_.push_back({names_[i], names_[i + 1], 10'000'000 * commit, pose});
        }
        return members_;
    }

private:
    std::vector<std::string> names_;
    std::vector<TransformView> members_;
};

void state_row(const Costs& costs) {
    using Bytes = std::vector<std::byte>;
    Rounds whole;
    for (int round = 0; round < std::max(3, costs.rounds); ++round) {
        Buffer source = keeping_all();
        for (StampNs stamp = 1; stamp <= 10; ++stamp) {
            std::vector<std::string> names;
            std::vector<TransformView> members;
            for (int i = 0; i < 10'000; ++i)
                names.push_back("frame" + std::to_string(i));
            for (const std::string& name : names)
                members.push_back({"map", name, stamp, kPose});
            source.set_transforms(members, false, "");
        }
        const tfdb::Snapshot held = source.snapshot();
        Bytes sample;
        add(whole, "encode", 1e-6 * nanos_of([&] { sample = held.state_bytes(); }));
        Buffer applied = keeping_all();
        add(whole, "apply", 1e-6 * nanos_of([&] { applied.apply(sample); }));
    }
    print_row("a state of 10,000 frames of ten samples", 0, "ms", whole);
}

void bytes_rows(const Costs& costs) {
    constexpr StampNs kCommits = 4096;
    using Bytes = std::vector<std::byte>;
    Rounds each;
    Rounds state;
    for (int round = 0; round < std::max(5, costs.rounds); ++round) {
        Joints joints;
        Buffer source = keeping_all();
        std::vector<Bytes> messages(kCommits);
        for (StampNs i = 0; i < kCommits; ++i) {
            tfdb::wire::encode_tf_message(joints.at(i), tfdb::wire::Encoding::kCdr,
                                          messages[static_cast<std::size_t>(i)]);
            source.set_transforms(joints.at(i), false, "");
        }
        std::vector<Bytes> samples;
        const auto per_commit = [&](const char* name, const std::function<void()>& work) {
            add(each, name, 1e-3 * nanos_of(work) / static_cast<double>(kCommits));
        };
        per_commit("commits_bytes", [&] {
            for (tfdb::CommitNumber since = 0; since < kCommits; since += 64)
                samples.push_back(source.commits_bytes(since));
        });
        per_commit("changes", [&] { keep(source.changes(0)); });
        Buffer ingested = keeping_all();
        std::vector<TransformView> members;
        per_commit("a TFMessage", [&] {
            for (const Bytes& message : messages) {
                tfdb::wire::decode_tf_message(message, tfdb::wire::Encoding::kCdr, members);
                ingested.set_transforms(members, false, "");
            }
        });
        Buffer applied = keeping_all();
        per_commit("apply", [&] {
            for (const Bytes& sample : samples)
                applied.apply(sample);
        });
        std::size_t bytes = 0;
        for (const Bytes& sample : samples)
            bytes += sample.size();
        std::size_t message_bytes = 0;
        for (const Bytes& message : messages)
            message_bytes += message.size();
        add(state, "bytes a transform", static_cast<double>(bytes) / (10.0 * kCommits));
        add(state, "of a TFMessage", static_cast<double>(message_bytes) / (10.0 * kCommits));
    }
    print_row("a commit of ten, in samples of 64", 0, "us", each);
    print_row("bytes a transform, in samples of 64 commits of ten", 0, "B", state);
    state_row(costs);
}

/// A commit of ten beside 1,000 watches on other frames, some of which wait, and without them; the
/// two stores take turns.
void watch_rows(const Costs& costs) {
    constexpr int kWatches = 1'000;
    constexpr std::size_t kWaiting = 4;
    constexpr StampNs kCommits = 40'000;
    constexpr StampNs kTurn = 500;
    Rounds rounds;
    for (int round = 0; round < std::max(9, costs.rounds); ++round) {
        Joints joints;
        Buffer none = keeping_all();
        Buffer watched = keeping_all();
        std::vector<std::shared_ptr<tfdb::Watch>> watches;
        for (int i = 0; i < kWatches; ++i) {
            const std::string name = "other" + std::to_string(i);
            watched.set_transform({"map", name, 1, kPose}, false, "");
            watches.push_back(watched.watch({{}, {{"map", name}}}));
        }
        for (const auto& watch : watches)
            keep(watch->next(watched.commit(), 0));
        std::vector<std::thread> waiting;
        for (std::size_t i = 0; i < kWaiting; ++i) {
            waiting.emplace_back([&watched, watch = watches[i]] {
                keep(watch->next(watched.commit(), std::nullopt));
            });
        }
        double without = 0;
        double with = 0;
        for (StampNs stamp = 0; stamp < kCommits; stamp += kTurn) {
            const auto write = [&](Buffer& buffer) {
                return nanos_of([&] {
                    for (StampNs i = stamp; i < stamp + kTurn; ++i)
                        buffer.set_transforms(joints.at(i), false, "");
                });
            };
            without += write(none);
            with += write(watched);
        }
        watched.stop_waits(true);
        for (std::thread& thread : waiting)
            thread.join();
        add(rounds, "no watch", 1e-3 * without / static_cast<double>(kCommits));
        add(rounds, "1,000 watches on other frames", 1e-3 * with / static_cast<double>(kCommits));
    }
    print_row("a commit of ten, watched", 0, "us", rounds);
}

const std::pair<const char*, void (*)(const Costs&)> kGroups[] = {
    {"writes", write_rows},  {"held", held_rows},   {"depth", depth_rows}, {"names", name_rows},
    {"growth", growth_rows}, {"bytes", bytes_rows}, {"watch", watch_rows}};

int run(const std::vector<std::string>& arguments) {
    Costs costs;
    std::vector<std::string> wanted;
    for (std::size_t i = 0; i < arguments.size(); ++i) {
        if (arguments[i] == "--rounds" && i + 1 < arguments.size()) {
            costs.rounds = std::max(1, std::stoi(arguments[++i]));
        } else if (arguments[i] == "--samples" && i + 1 < arguments.size()) {
            costs.samples = std::max(10'000, std::stoi(arguments[++i]));
        } else {
            wanted.push_back(arguments[i]);
        }
    }
    for (const auto& [name, rows] : kGroups) {
        if (wanted.empty() || std::find(wanted.begin(), wanted.end(), name) != wanted.end()) {
            rows(costs);
        }
    }
    return 0;
}

}  // namespace
}  // namespace bench

int main(int argc, char** argv) {
    try {
        return bench::run({argv + 1, argv + argc});
    } catch (const std::exception& error) {
        std::fprintf(stderr, "tfdb_costs: %s\n", error.what());
        return 1;
    }
}
