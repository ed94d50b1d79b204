// The three defects of the published TF-Par code, in every engine: a retry that keeps the first
// attempt's composed poses, an early exit that drops the edge below an ancestor, upgrades that
// deadlock.
#include <set>

#include "tfdb/store/isolation.test.hpp"

namespace tfdb {
namespace {

using namespace isolation;

constexpr int kDepth = 24;
constexpr Concurrency kEngines[] = {
    Concurrency::kSnapshot, Concurrency::kGiant,     Concurrency::kFine, Concurrency::kNoWait,
    Concurrency::kWaitDie,  Concurrency::kWoundWait, Concurrency::kSilo};

std::string link(int i) {
    return i == 0 ? "map" : "link" + std::to_string(i);
}
Pose link_pose(int i, int generation) {
    return pose_of(0.5 * i + 0.125 * (generation % 64));
}
void write_chain(Buffer& buffer, int generation) {
    std::vector<std::string> names;
    for (int i = 0; i <= kDepth; ++i)
        names.push_back(link(i));
    std::vector<TransformView> batch;
    for (int i = kDepth; i >= 1; --i) {
        const auto at = static_cast<std::size_t>(i);
        batch.push_back({names[at - 1], names[at], 10 * generation, link_pose(i, generation)});
    }
    buffer.set_transforms(batch, false, "");
}
/// T[link a<-link b] by arithmetic, for a above b.
Pose between(int a, int b, int generation) {
    Pose pose = geometry::identity();
    for (int i = a + 1; i <= b; ++i)
        pose = geometry::compose(pose, link_pose(i, generation));
    return pose;
}

/// Each edge of the path once, in order, and no other.
bool reports_the_path(const Buffer& buffer, const Answer& answer, int above, int below) {
    std::set<std::string> names;
    for (const EdgeUse& use : answer.edges)
        names.insert(buffer.frame_name(use.child, use.generation));
    bool all = names.size() == answer.edges.size();
    for (int i = above + 1; i <= below; ++i)
        all = all && names.contains(link(i));
    return all && answer.edges.size() == static_cast<std::size_t>(below - above);
}

/// Deep lookups beside writers of the whole path, until enough of them were repeated; all of them
/// reuse one Answer, as one accumulator.
std::uint64_t lookups_that_begin_again(Concurrency engine) {
    constexpr int kMost = 4'000;
    Buffer buffer(options_of(engine, 30));
    write_chain(buffer, 0);
    write_chain(buffer, 1);
    FrameHandle top;
    FrameHandle tip;
    CHECK(buffer.find_frame("map", top) && buffer.find_frame(link(kDepth), tip));
    std::atomic<int> writing{1};
    std::atomic<long> wrong{0};
    const auto restarts = [&] {
        const Counters counters = buffer.counters();
        return counters.retries + counters.lapped_reads;
    };
    const auto read = [&](bool down) {
        Answer answer;
        Failure failure;
        while (writing.load() != 0) {
            const bool found =
                buffer.ask(store::of_newest(down ? top : tip, down ? tip : top, std::nullopt, 0),
                           answer, failure);
            wrong += !found || !reports_the_path(buffer, answer, 0, kDepth);
            if (engine == Concurrency::kFine || !found)
                continue;  // it may mix generations
            const int generation = static_cast<int>(answer.edges.front().before / 10);
            const Pose pose = down ? answer.pose : geometry::inverse(answer.pose);
            wrong += apart(pose, between(0, kDepth, generation)) > 1e-6;
        }
    };
    side_by_side({[&] {
                      for (int i = 2; i < kMost; ++i)
                          write_chain(buffer, i);
                      writing.store(0);
                  },
                  [&] { read(true); }, [&] { read(false); }});
    CHECK_EQ(wrong.load(), 0);
    return restarts();
}

/// All pairs of a frame and its ancestor, both directions, every form of read.
template <class Source>
void ancestors(Source& from, const Buffer& names, int generation) {
    for (int above = 0; above < kDepth; above += 1 + above / 4) {
        for (int below = above; below <= kDepth; ++below) {
            const Pose expected = between(above, below, generation);
            for (const bool down : {true, false}) {
                const std::string target = link(down ? above : below);
                const std::string source = link(down ? below : above);
                const Pose wanted = down ? expected : geometry::inverse(expected);
                const StampNs stamp = 10 * generation;
                const Answer answers[] = {from.lookup_latest_transform(target, source),
                                          from.lookup_transform(target, source),
                                          from.lookup_transform(target, source, stamp)};
                for (const Answer& answer : answers) {
                    CHECK(apart(answer.pose, wanted) < 1e-9);
                    CHECK(reports_the_path(names, answer, above, below));
                }
            }
        }
    }
}

/// Transactions that read one frame and then write it, each starting from the same read lock,
/// beside readers of that frame: no thread waits for ever, and no increment is lost.
void upgrades(Concurrency engine) {
    constexpr int kEach = 60;
    Buffer buffer(options_of(engine, 1000));
    set(buffer, "map", "x", 0, pose_of(1));
    set(buffer, "x", "y", 0, pose_of(5));
    std::atomic<int> writing{2};
    std::atomic<long> reads{0};
    Meeting meeting(Concurrency::kSilo);
    const auto increment = [&] {
        for (int i = 0; i < kEach; ++i) {
            until_committed(buffer, [&](Transaction& tx, bool first) {
                const int seen = whole(newest(tx, Direction::kUp, "map", "x"));
                const Pose below = newest(tx, Direction::kDown, "map", "y");
                const Pose expected = geometry::compose(pose_of(seen), pose_of(5));
                if (engine != Concurrency::kFine)  // it may not repeat the read
                    CHECK(apart(below, expected) < 1e-6);
                if (first && i == 0)
                    meeting.meet(2);
                else if (first && i % 8 == 0)
                    std::this_thread::yield();
                put(tx, "map", "x", seen + 1, seen + 1);
            });
        }
        writing.fetch_sub(1);
    };
    const auto read = [&] {
        do {
            const Answer answer = buffer.lookup_latest_transform("y", "map");
            reads += answer.edges.size() == 2;
        } while (writing.load() != 0);
    };
    side_by_side({increment, increment, read, read});
    CHECK(reads.load() > 0);
    if (engine != Concurrency::kFine)
        CHECK_EQ(whole(newest(buffer, Direction::kUp, "map", "x")), 1 + 2 * kEach);
}

}  // namespace

TFDB_TEST(defects_a_lookup_that_begins_again_forgets_its_first_attempt) {
    std::uint64_t restarts = 0;
    for (const Concurrency engine : kEngines) {
        const std::uint64_t here = lookups_that_begin_again(engine);
        std::printf("  %s: %llu begun again\n", std::string(concurrency_name(engine)).c_str(),
                    static_cast<unsigned long long>(here));
        restarts += here;
    }
    CHECK(restarts > 0);
}

TFDB_TEST(defects_no_edge_below_an_ancestor_is_dropped) {
    for (const Concurrency engine : kEngines) {
        Buffer buffer(options_of(engine));
        for (const int generation : {1, 2, 3})
            write_chain(buffer, generation);
        ancestors(buffer, buffer, 3);
        Snapshot held = buffer.snapshot();
        write_chain(buffer, 4);
        ancestors(held, buffer, 3);
        Transaction tx(buffer);
        ancestors(tx, buffer, 4);
        tx.commit();
    }
}

TFDB_TEST(defects_upgrades_end) {
    for (const Concurrency engine : kEngines)
        upgrades(engine);
}

}  // namespace tfdb
