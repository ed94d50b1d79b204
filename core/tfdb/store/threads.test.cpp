// Readers beside writers: every result comes from one committed state. Counts end the tests, not
// times.
#include <array>
#include <atomic>
#include <functional>
#include <thread>

#include "tfdb/store/transaction_fixture.test.hpp"

namespace tfdb {
namespace {

using namespace fixture;

/// Runs `writers` to their ends, beside `readers` that repeat until then.
void beside(const std::vector<std::function<void()>>& writers,
            const std::vector<std::function<void()>>& readers) {
    std::atomic<std::size_t> writing{writers.size()};
    std::vector<std::thread> threads;
    const auto guarded = [](const std::function<void()>& body) {
        try {
            body();
        } catch (const std::exception& error) {
            testing::report_failure(__FILE__, __LINE__, error.what());
        }
    };
    for (const auto& reader : readers) {
        threads.emplace_back([&] {
            do {
                guarded(reader);
            } while (writing.load() != 0);
        });
    }
    for (const auto& writer : writers) {
        threads.emplace_back([&] {
            guarded(writer);
            writing.fetch_sub(1);
        });
    }
    for (std::thread& thread : threads)
        thread.join();
}

/// Two edges that a batch always revises together: x of left and of right sum to 0.
Pose shifted(double x) {
    return {{x, 1.0, 2.0}, {0, 0, 0, 1}};
}

void torn_pair(bool is_static) {
    if (skipped_in({Concurrency::kFine}, "it sees batches in parts"))
        return;
    constexpr int kCommits = 20'000;
    Buffer buffer(keeping(500));
    const auto write = [&](int i) {
        const TransformView batch[] = {{"map", "left", i, shifted(i)},
                                       {"left", "right", i, shifted(-i)}};
        buffer.set_transforms(batch, is_static, "");
    };
    write(0);
    std::atomic<long> torn{0};
    const auto reader = [&] {
        const double sum = buffer.lookup_latest_transform("map", "right").pose.translation.x;
        const double at = buffer.lookup_transform("map", "right").pose.translation.x;
        torn += (sum != 0.0) + (at != 0.0);
    };
    beside({[&] {
               for (int i = 1; i <= kCommits; ++i)
                   write(i);
           }},
           {reader, reader});
    CHECK_EQ(torn.load(), 0);
}

constexpr std::array kFarPolicies = {lookup::PolicyKind::kNearest,
                                     lookup::PolicyKind::kExtrapolate};

/// At stamp 2, a is a child of m by its first sample, and m is a root.
void far_from_samples(Buffer& buffer) {
    set_static(buffer, "a", "s", pose_of(1));
    set_static(buffer, "m", "t", pose_of(2));
    set(buffer, "m", "a", 10, pose_of(3));
    set_static(buffer, "a", "x", pose_of(4));
    set_static(buffer, "w_root", "w", pose_of(5));
    set_static(buffer, "elsewhere", "d", pose_of(6));
}

/// Above m the chain leads back to a. That is not a cycle: m leaves x before a's first sample.
void bend(Buffer& buffer) {
    const TransformView batch[] = {{"x", "m", 1, pose_of(7)}, {"w", "m", 5, pose_of(8)}};
    buffer.set_transforms(batch, false, "other");
}

}  // namespace

TFDB_TEST(threads_two_static_edges_are_never_torn) {
    torn_pair(true);
}

TFDB_TEST(threads_two_moving_edges_are_never_torn) {
    torn_pair(false);
}

TFDB_TEST(threads_commit_numbers_never_go_back) {
    constexpr int kCommits = 10'000;
    Buffer buffer(keeping(100));
    set(buffer, "map", "a", 0, pose_of(0));
    set(buffer, "map", "b", 0, pose_of(0));
    std::atomic<long> wrong{0};
    const auto reader = [&] {
        static thread_local CommitNumber last = 0;
        const CommitNumber seen = buffer.commit();
        const Answer answer = buffer.lookup_latest_transform("a", "b");
        const Snapshot held = buffer.snapshot();
        wrong += answer.commit < seen || held.commit() < answer.commit || seen < last;
        wrong += held.lookup_latest_transform("a", "b").commit != held.commit();
        last = buffer.commit() >= held.commit() ? held.commit() : ~CommitNumber{0};
    };
    const auto writer = [&](const char* child) {
        return [&buffer, child] {
            for (int i = 1; i <= kCommits; ++i)
                set(buffer, "map", child, i, pose_of(i));
        };
    };
    beside({writer("a"), writer("b")}, {reader, reader});
    CHECK_EQ(wrong.load(), 0);
    CHECK_EQ(buffer.commit(), 2U + 2 * kCommits);
}

TFDB_TEST(threads_every_answer_comes_from_one_commit_whatever_happens_to_the_forest) {
    // The number in each pose encodes the parent and the tool's generation.
    constexpr int kRounds = 1'500;
    Buffer buffer(keeping(50));
    set_static(buffer, "map", "dock", pose_of(1000));
    set_static(buffer, "map", "arm", pose_of(2000));
    set(buffer, "dock", "tool", 0, pose_of(1));
    std::atomic<long> wrong{0};
    const auto reader = [&] {
        try {
            const Snapshot held = buffer.snapshot();
            const FrameInfo info = held.frame_info("tool");
            const Answer direct = held.lookup_transform(info.parent.value_or("?"), "tool");
            // Odd numbers are children of the dock, even ones of the arm.
            const auto number = static_cast<long>(number_of(direct.pose));
            wrong += (number % 2 == 1) != (info.parent == "dock");
            wrong += info.name != "tool" || info.newest != direct.stamp;
        } catch (const UnknownFrame&) {
            // removed concurrently
        }
        try {
            const Answer answer = buffer.lookup_transform("map", "tool");
            const auto& edges = answer.edges;
            wrong += edges.size() != 2 || edges[1].used != lookup::Used::kStatic;
        } catch (const UnknownFrame&) {
        }
        for (const FrameInfo& info : buffer.tree())
            wrong += info.name != "map" && !info.parent;
    };
    beside({[&] {
                for (int i = 1; i <= kRounds; ++i) {
                    set(buffer, i % 2 == 1 ? "dock" : "arm", "tool", i, pose_of(i));
                    if (i % 7 == 0)
                        buffer.remove_frame("tool", false);
                }
            },
            [&] {
                for (int i = 1; i <= kRounds; ++i) {
                    const std::string name = "visitor" + std::to_string(i % 3);
                    set(buffer, "map", name, i, pose_of(9000 + i));
                    buffer.remove_frame(name, false);
                }
            }},
           {reader, reader});
    CHECK_EQ(wrong.load(), 0);
}

TFDB_TEST(threads_slots_that_change_hands_never_answer_for_another_name) {
    constexpr int kRounds = 20'000;
    BufferOptions options = defaults();
    options.max_frames = 4;  // `map`, and few slots for the names that take turns
    Buffer buffer(options);
    set(buffer, "map", "name0", 1, pose_of(0));
    std::atomic<long> wrong{0};
    std::atomic<int> turn{0};
    const auto reader = [&] {
        const int mine = turn.fetch_add(1) % 5;
        const std::string name = "name" + std::to_string(mine);
        try {
            const Answer answer = buffer.lookup_transform("map", name);
            wrong += static_cast<int>(number_of(answer.pose)) % 5 != mine;
            const Samples samples = buffer.samples(name);
            wrong += samples.poses.size() != 1 ||
                     static_cast<int>(number_of(samples.poses.front())) % 5 != mine;
            const FrameInfo info = buffer.frame_info(name);
            wrong += info.name != name || info.samples != 1 || info.parent != "map";
        } catch (const UnknownFrame&) {
        }
    };
    beside({[&] {
               for (int i = 1; i <= kRounds; ++i) {
                   set(buffer, "map", "name" + std::to_string(i % 5), i, pose_of(i));
                   buffer.remove_frame("name" + std::to_string((i - 1) % 5), false);
               }
           }},
           {reader, reader});
    CHECK_EQ(wrong.load(), 0);
}

TFDB_TEST(threads_buffers_come_and_go) {
    std::vector<std::thread> threads;
    for (int t = 0; t < 4; ++t) {
        threads.emplace_back([t] {
            for (int i = 0; i < 100; ++i) {
                Buffer buffer(keeping(100));
                for (StampNs stamp = 0; stamp < 20; ++stamp)
                    set(buffer, "map", "base", stamp, pose_of(t * 1000 + i));
                CHECK_EQ(number_of(buffer.lookup_transform("map", "base").pose), t * 1000 + i);
            }
        });
    }
    for (std::thread& thread : threads)
        thread.join();
}

TFDB_TEST(threads_clear_beside_readers_shows_all_or_nothing) {
    constexpr int kRounds = 4'000;
    Buffer buffer(keeping(std::nullopt));
    set_static(buffer, "b", "eye", pose_of(5));
    set_static(buffer, "map", "wall", pose_of(5));
    std::atomic<long> wrong{0};
    const auto reader = [&] {
        const Snapshot held = buffer.snapshot();
        const auto tree = held.tree();
        std::uint64_t moving = 0;
        for (const FrameInfo& info : tree)
            moving += info.is_static ? 0 : info.samples;
        // Each round writes a and b ten times as one batch, and clears both.
        wrong += moving % 2 != 0;
        wrong += held.lookup_transform("b", "eye").pose.translation.x != 5.0;
        try {
            const Answer answer = held.lookup_transform("map", "eye");
            wrong += moving == 0 || answer.edges.size() != 3;
        } catch (const Disconnected&) {
            wrong += moving != 0;
        }
    };
    beside({[&] {
               for (int i = 0; i < kRounds; ++i) {
                   for (StampNs stamp = 0; stamp < 10; ++stamp) {
                       const TransformView batch[] = {{"map", "a", stamp, pose_of(1)},
                                                      {"a", "b", stamp, pose_of(2)}};
                       buffer.set_transforms(batch, false, "");
                   }
                   buffer.clear();
                   if (i % 8 == 0)
                       (void)buffer.compact();
               }
           }},
           {reader});
    CHECK_EQ(wrong.load(), 0);
}

TFDB_TEST(threads_compactions_without_a_pause_overtake_no_snapshot_of_the_newest_state) {
    constexpr int kCompactions = 20'000;
    constexpr StampNs kSamples = 1'000;
    Buffer buffer(defaults());
    for (StampNs stamp = 0; stamp < kSamples; ++stamp)
        set(buffer, "map", "base", stamp, pose_of(static_cast<double>(stamp)));
    std::atomic<long> wrong{0};
    beside({[&] {
               for (int i = 0; i < kCompactions; ++i)
                   (void)buffer.compact();
           }},
           {[&] {
               const Snapshot held = buffer.snapshot();
               wrong += held.samples("base").stamps.size() != static_cast<std::size_t>(kSamples);
           }});
    CHECK_EQ(wrong.load(), 0);
}

TFDB_TEST(threads_names_are_found_while_their_table_grows) {
    constexpr int kFrames = 10'000;
    Buffer buffer(defaults());
    set_static(buffer, "map", "frame0", pose_of(0));
    std::atomic<int> made{0};
    std::atomic<long> wrong{0};
    const auto reader = [&] {
        const int newest = made.load();
        for (int i = newest; i >= 0; i -= 1 + newest / 16) {
            FrameHandle handle;
            const std::string name = "frame" + std::to_string(i);
            wrong += !buffer.find_frame(name, handle) ||
                     buffer.frame_name(handle.id, handle.generation) != name;
        }
    };
    beside({[&] {
               for (int i = 1; i <= kFrames; ++i) {
                   set_static(buffer, "map", "frame" + std::to_string(i), pose_of(i));
                   made.store(i);
               }
           }},
           {reader, reader});
    CHECK_EQ(wrong.load(), 0);
}

TFDB_TEST(threads_batches_see_one_commit_beside_an_evicting_writer) {
    if (skipped_in({Concurrency::kFine}, "it sees batches in parts"))
        return;
    constexpr int kCommits = 10'000;
    constexpr StampNs kHistory = 400;
    Buffer buffer(keeping(kHistory));
    const auto write = [&](int i) {
        const TransformView batch[] = {{"map", "left", i, shifted(i)},
                                       {"left", "right", i, shifted(-i)}};
        buffer.set_transforms(batch, false, "");
    };
    for (int i = 0; i < 1000; ++i)
        write(i);
    std::atomic<long> wrong{0};
    const auto reader = [&] {
        const StampNs newest = buffer.lookup_transform("map", "right").stamp;
        std::vector<StampNs> stamps;
        for (StampNs stamp = newest; stamp > newest - kHistory / 2; stamp -= 3)
            stamps.push_back(stamp);
        std::vector<double> rows(7 * stamps.size());
        buffer.lookup_many("map", "right", stamps, {}, Layout::kPose, Missing::kNan, rows);
        for (std::size_t i = 0; i < stamps.size(); ++i) {
            const double x = rows[7 * i];
            wrong += !(std::abs(x) < 1e-9) && !std::isnan(x);
        }
        const std::vector<StampNs> path = buffer.path_stamps("map", "right", {}, {});
        wrong += path.size() != static_cast<std::size_t>(kHistory) + 1;
        wrong += path.empty() || path.back() - path.front() != kHistory;
    };
    beside({[&] {
               for (int i = 1000; i < 1000 + kCommits; ++i)
                   write(i);
           }},
           {reader, reader});
    CHECK_EQ(wrong.load(), 0);
}

TFDB_TEST(threads_latest_common_time_is_of_one_commit) {
    if (skipped_in({Concurrency::kFine}, "it sees batches in parts"))
        return;
    // One batch writes the parent's edge at 10 i and the child's at 10 i - 5. Late samples and
    // corrections come between, which never change the newest sample.
    constexpr int kCommits = 10'000;
    Buffer buffer(keeping(2000));
    const auto write = [&](StampNs i) {
        const TransformView batch[] = {{"map", "a", 10 * i, shifted(static_cast<double>(i))},
                                       {"a", "b", 10 * i - 5, shifted(static_cast<double>(-i))}};
        buffer.set_transforms(batch, false, "");
    };
    write(1);
    write(2);
    std::atomic<long> wrong{0};
    const auto reader = [&] {
        const Answer answer = buffer.lookup_transform("a", "b");
        wrong += answer.stamp % 10 != 5 ||
                 number_of(answer.pose) != static_cast<double>(answer.stamp + 5) / -10.0;
        const Answer both = buffer.lookup_transform("map", "b");
        wrong += both.stamp % 10 != 5 || both.stamp < answer.stamp;
        const Answer latest = buffer.lookup_latest_transform("map", "b");
        wrong += number_of(latest.pose) != 0.0 || latest.stamp % 10 != 5;
    };
    beside({[&] {
               for (StampNs i = 3; i <= kCommits; ++i) {
                   write(i);
                   if (i % 9 == 0)
                       set(buffer, "map", "a", 10 * i - 33, shifted(0));
               }
           }},
           {reader, reader});
    CHECK_EQ(wrong.load(), 0);
}

/// Outside the samples a path also depends on the frames above the meeting frame.
TFDB_TEST(transaction_depends_on_the_chain_above_the_meeting_point) {
    if (skipped_in({Concurrency::kFine}, "nothing is validated"))
        return;
    for (const auto kind : kFarPolicies) {
        Buffer buffer(keeping(std::nullopt));
        far_from_samples(buffer);
        const Policy policy{kind};
        Transaction tx(buffer);
        const Pose seen = tx.lookup_transform("t", "s", 2, policy).pose;
        std::thread other([&] { bend(buffer); });
        if (engine() == Concurrency::kSnapshot)
            other.join();  // in other engines it waits for the transaction
        put_static(tx, "elsewhere", "new", 9);
        bool committed = true;
        try {
            tx.commit();
        } catch (const Conflict&) {
            committed = false;
        }
        if (other.joinable())
            other.join();
        CHECK(apart(seen, buffer.lookup_transform("t", "s", 2, policy).pose) > 1e-3);
        CHECK(engine() != Concurrency::kSnapshot || !committed);
    }
}
}  // namespace tfdb
