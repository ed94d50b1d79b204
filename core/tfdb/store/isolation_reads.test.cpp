// Anomalies of plain lookups beside plain writes, in every engine and both directions of a path.
#include <mutex>
#include <utility>

#include "tfdb/store/isolation.test.hpp"

namespace tfdb {
namespace {

using namespace isolation;

constexpr int kJoints = 4;
constexpr const char* kChain[] = {"map", "j1", "j2", "j3", "j4"};
constexpr int kCommits = 3'000;

/// The chain's poses in one generation. Different generations compose to different poses.
Pose joint_pose(int joint, int generation) {
    return pose_of(10.0 * joint + 0.25 * generation);
}
/// T[map<-j4] if each joint has its own generation.
Pose composed(const int (&generations)[kJoints]) {
    Pose pose = joint_pose(1, generations[0]);
    for (int joint = 2; joint <= kJoints; ++joint)
        pose = geometry::compose(pose, joint_pose(joint, generations[joint - 1]));
    return pose;
}
Pose composed(int generation) {
    return composed({generation, generation, generation, generation});
}

/// One generation in one batch. It is unsorted and has each frame twice; the later member counts.
void write_whole(Buffer& buffer, int generation) {
    const StampNs stamp = 10 * generation;
    std::vector<TransformView> batch;
    for (const int joint : {3, 1, 4, 2})
        batch.push_back({kChain[joint - 1], kChain[joint], stamp, pose_of(7777)});
    for (const int joint : {2, 4, 1, 3}) {
        batch.push_back({kChain[joint - 1], kChain[joint], stamp, joint_pose(joint, generation)});
    }
    buffer.set_transforms(batch, false, "");
}

/// Calls `look` until all writers have ended, and then once more.
void beside(const std::vector<std::function<void()>>& writers,
            const std::vector<std::function<void()>>& looks) {
    std::atomic<std::size_t> writing{writers.size()};
    std::vector<std::function<void()>> bodies;
    for (const auto& look : looks) {
        bodies.push_back([&] {
            while (writing.load() != 0)
                look();
            look();
        });
    }
    for (const auto& writer : writers) {
        bodies.push_back([&] {
            try {
                writer();
            } catch (const std::exception& error) {
                testing::report_failure(__FILE__, __LINE__, error.what());
            }
            writing.fetch_sub(1);
        });
    }
    side_by_side(bodies);
}

/// Reads the whole chain beside a writer of batches. Returns how many results mix generations.
long torn_batches(const Case& c, const std::function<bool(long)>& enough) {
    Buffer buffer(options_of(c.engine, 2000));
    write_whole(buffer, 0);
    std::atomic<int> begun{0};
    std::atomic<long> torn{0};
    const auto look = [&] {
        // In `fine` the joints' samples may be so far apart that no common time exists.
        for (const bool latest : {true, c.engine == Concurrency::kFine}) {
            const CommitNumber least = buffer.commit();
            const Answer answer = c.direction == Direction::kDown
                                      ? (latest ? buffer.lookup_latest_transform("map", "j4")
                                                : buffer.lookup_transform("map", "j4"))
                                      : (latest ? buffer.lookup_latest_transform("j4", "map")
                                                : buffer.lookup_transform("j4", "map"));
            CHECK(answer.commit >= least);
            const int generation = static_cast<int>(answer.edges.front().before / 10);
            const Pose seen =
                c.direction == Direction::kDown ? answer.pose : geometry::inverse(answer.pose);
            torn += apart(seen, composed(generation)) > 1e-6 || generation > begun.load();
            CHECK_EQ(answer.edges.size(), 4U);
        }
    };
    beside({[&] {
               for (int i = 1; !enough(torn.load()) && i < 1'000'000; ++i) {
                   begun.store(i);
                   write_whole(buffer, i);
                   if (i >= kCommits && c.engine != Concurrency::kFine)
                       break;
               }
           }},
           {look, look});
    return torn.load();
}

/// A lookup that sees a later commit must also see the earlier one. The writer sets the upper joint
/// first in one test, and the lower one in the other.
long torn_paths(const Case& c, bool upper_first) {
    Buffer buffer(options_of(c.engine, 2000));
    write_whole(buffer, 0);
    const int first = upper_first ? 1 : 4;
    const int second = upper_first ? 4 : 1;
    std::atomic<long> torn{0};
    const auto look = [&] {
        const Answer answer = c.direction == Direction::kDown
                                  ? buffer.lookup_latest_transform("map", "j4")
                                  : buffer.lookup_latest_transform("j4", "map");
        int generation[2] = {-1, -1};
        for (const EdgeUse& use : answer.edges) {
            const std::string name = buffer.frame_name(use.child, use.generation);
            for (const int which : {0, 1}) {
                if (name == kChain[which == 0 ? first : second])
                    generation[which] = static_cast<int>(use.before / 10);
            }
        }
        torn += generation[1] > generation[0] || generation[0] > generation[1] + 1;
        int of_joint[kJoints] = {0, 0, 0, 0};
        of_joint[first - 1] = generation[0];
        of_joint[second - 1] = generation[1];
        const Pose seen =
            c.direction == Direction::kDown ? answer.pose : geometry::inverse(answer.pose);
        torn += apart(seen, composed(of_joint)) > 1e-6;
    };
    beside({[&] {
               for (int i = 1; i <= kCommits; ++i) {
                   for (const int joint : {first, second}) {
                       set(buffer, kChain[joint - 1], kChain[joint], 10 * i, joint_pose(joint, i));
                   }
               }
           }},
           {look, look});
    return torn.load();
}

/// Two writers with an edge each, and readers of the path between them. All readers must agree on
/// one order.
void long_fork(const Case& c) {
    Buffer buffer(options_of(c.engine, 2000));
    const TransformView both[] = {{"map", "right", 0, pose_of(1)}, {"map", "left", 0, pose_of(1)}};
    buffer.set_transforms(both, false, "");
    std::mutex mutex;
    std::vector<std::pair<StampNs, StampNs>> all;
    const auto reader = [&] {
        std::vector<std::pair<StampNs, StampNs>> mine;
        for (int i = 0; i < 2 * kCommits; ++i) {
            const Answer answer = c.direction == Direction::kDown
                                      ? buffer.lookup_latest_transform("left", "right")
                                      : buffer.lookup_latest_transform("right", "left");
            const bool swapped = c.direction == Direction::kUp;
            const std::pair<StampNs, StampNs> seen{answer.edges[swapped ? 0 : 1].before,
                                                   answer.edges[swapped ? 1 : 0].before};
            if (mine.empty() || mine.back() != seen)
                mine.push_back(seen);
        }
        const std::lock_guard<std::mutex> guard(mutex);
        all.insert(all.end(), mine.begin(), mine.end());
    };
    const auto writer = [&](const char* frame) {
        for (int i = 1; i <= kCommits; ++i)
            set(buffer, "map", frame, i, pose_of(1 + i));
    };
    side_by_side({[&] { writer("left"); }, [&] { writer("right"); }, reader, reader});
    std::sort(all.begin(), all.end());
    for (std::size_t i = 1; i < all.size(); ++i)
        CHECK(all[i - 1].second <= all[i].second);
}

/// A lookup sees all commits of all writers that ended before it began.
void stale_read(const Case& c) {
    Buffer buffer(options_of(c.engine, 2000));
    write_whole(buffer, 0);
    std::atomic<int> done{0};
    std::atomic<long> stale{0};
    const auto look = [&] {
        const int least = done.load();
        const Answer latest = c.direction == Direction::kDown
                                  ? buffer.lookup_latest_transform("map", "j4")
                                  : buffer.lookup_latest_transform("j4", "map");
        for (const EdgeUse& use : latest.edges)
            stale += use.before < 10 * least;
        const Snapshot held = buffer.snapshot();
        stale += held.lookup_transform("map", "j4").stamp < 10 * least;
    };
    beside({[&] {
               for (int i = 1; i <= kCommits; ++i) {
                   write_whole(buffer, i);
                   done.store(i);
                   const Pose own = newest(buffer, c.direction, "map", "j1");
                   stale += apart(own, joint_pose(1, i)) > 1e-6;
               }
           }},
           {look, look});
    CHECK_EQ(stale.load(), 0);
}

}  // namespace

TFDB_TEST(isolation_torn_batch) {
    in_every_case([](const Case& c) { CHECK_EQ(torn_batches(c, [](long) { return false; }), 0); });
}

TFDB_TEST(isolation_torn_batch_is_shown_by_fine) {
    for (const Direction direction : {Direction::kDown, Direction::kUp}) {
        const Case c{Concurrency::kFine, direction};
        CHECK(torn_batches(c, [](long torn) { return torn > 0; }) > 0);
    }
}

TFDB_TEST(isolation_torn_path) {
    in_every_case([](const Case& c) {
        CHECK_EQ(torn_paths(c, true), 0);
        CHECK_EQ(torn_paths(c, false), 0);
    });
}

TFDB_TEST(isolation_long_fork) {
    in_every_case(long_fork);
}

TFDB_TEST(isolation_stale_read) {
    in_every_case(stale_read);
}

}  // namespace tfdb
