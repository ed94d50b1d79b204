// Concurrent transactions, in every engine with isolation.
#include <atomic>
#include <cstdio>

#include "tfdb/store/transaction_fixture.test.hpp"

namespace tfdb {
namespace {

using namespace fixture;

constexpr Concurrency kIsolating[] = {Concurrency::kSnapshot,  Concurrency::kGiant,
                                      Concurrency::kNoWait,    Concurrency::kWaitDie,
                                      Concurrency::kWoundWait, Concurrency::kSilo};

Pose at(double x) {
    return {{x, 1.0, 2.0}, {0.6, 0, 0, 0.8}};
}

BufferOptions options_of(Concurrency concurrency) {
    BufferOptions options = keeping(std::nullopt);
    options.concurrency = concurrency;
    return options;
}

/// Repeats until the commit; after eight conflicts it runs alone, like `run`.
template <class Body>
int insist(Buffer& buffer, Body body) {
    TransactionOptions options;
    for (int tries = 0;; ++tries) {
        options.alone = tries >= 8;
        Transaction tx(buffer, options);
        options.age = tx.age();
        try {
            body(tx);
            tx.commit();
            return tries;
        } catch (const Conflict&) {
            CHECK(tries < 8);
        }
    }
}

void in_threads(int count, const std::function<void(int)>& body) {
    std::vector<std::thread> threads;
    for (int i = 0; i < count; ++i) {
        threads.emplace_back([&, i] {
            try {
                body(i);
            } catch (const std::exception& error) {
                testing::report_failure(__FILE__, __LINE__, error.what());
            }
        });
    }
    for (std::thread& thread : threads)
        thread.join();
}

}  // namespace

TFDB_TEST(transaction_threads_lose_no_increment) {
    constexpr int kThreads = 4;
    constexpr int kEach = 300;
    for (const Concurrency concurrency : kIsolating) {
        Buffer buffer(options_of(concurrency));
        set(buffer, "map", "count", 0, at(0));
        std::atomic<int> lost{0};
        in_threads(kThreads, [&](int) {
            for (int i = 0; i < kEach; ++i) {
                lost += insist(buffer, [](Transaction& tx) {
                    const Answer seen = tx.lookup_latest_transform("map", "count");
                    std::this_thread::yield();
                    const TransformView next{"map", "count", seen.stamp + 1,
                                             at(seen.pose.translation.x + 1)};
                    tx.set_transforms({&next, 1}, false, "");
                });
            }
        });
        const Answer sum = buffer.lookup_latest_transform("map", "count");
        CHECK_EQ(sum.pose.translation.x, double{kThreads * kEach});
        CHECK_EQ(sum.stamp, kThreads * kEach);
        CHECK(buffer.counters().conflicts >= static_cast<std::uint64_t>(lost.load()));
        std::printf("  %s: %d lost on the way\n",
                    std::string(concurrency_name(concurrency)).c_str(), lost.load());
    }
}

TFDB_TEST(transaction_threads_keep_a_sum_that_each_moves_between_two_edges) {
    constexpr int kThreads = 3;
    constexpr int kEach = 200;
    const char* names[] = {"a", "b", "c"};
    for (const Concurrency concurrency : kIsolating) {
        Buffer buffer(options_of(concurrency));
        for (const char* name : names)
            set(buffer, "map", name, 0, at(100));
        std::atomic<int> wrong{0};
        in_threads(kThreads + 1, [&](int thread) {
            for (int i = 0; i < kEach; ++i) {
                insist(buffer, [&](Transaction& tx) {
                    double x[3];
                    StampNs newest = 0;
                    for (int k = 0; k < 3; ++k) {
                        const Answer seen = tx.lookup_latest_transform("map", names[k]);
                        x[k] = seen.pose.translation.x;
                        newest = std::max(newest, seen.stamp);
                    }
                    wrong += x[0] + x[1] + x[2] != 300.0;
                    std::this_thread::yield();
                    if (thread == kThreads)
                        return;
                    // Unsorted, and one of them inverted.
                    const int from = (thread + i) % 3;
                    const int to = (from + 2) % 3;
                    const TransformView moved[] = {
                        {"map", names[to], newest + 1, at(x[to] + 1)},
                        {"map", names[from], newest + 1, at(x[from] - 1)}};
                    tx.set_transforms(moved, false, "");
                });
            }
        });
        CHECK_EQ(wrong.load(), 0);
    }
}

TFDB_TEST(transaction_threads_make_and_remove_frames) {
    constexpr int kEach = 150;
    for (const Concurrency concurrency : kIsolating) {
        Buffer buffer(options_of(concurrency));
        set_static(buffer, "map", "left", at(1));
        set_static(buffer, "map", "right", at(2));
        std::atomic<int> made{0};
        // Every reader sees the tool as a child of one of two arms, or not at all.
        in_threads(3, [&](int thread) {
            for (int i = 0; i < kEach; ++i) {
                int change = 0;
                insist(buffer, [&](Transaction& tx) {
                    const bool there = tx.has_frame("tool");
                    std::this_thread::yield();
                    if (there) {
                        const bool left = latest(tx, "left", "tool") == 1.0;
                        CHECK_EQ(latest(tx, "right", "tool") == 1.0, !left);
                        tx.remove_frame("tool", true);
                        change = -1;
                    } else {
                        CHECK(THROWN(UnknownFrame, latest(tx, "map", "tool")));
                        put_static(tx, (thread + i) % 2 == 0 ? "left" : "right", "tool", 1);
                        put_static(tx, "tool", "tip", 2);
                        change = 1;
                    }
                });
                made += change;
            }
        });
        CHECK_EQ(has_frame(buffer, "tool"), made.load() == 1);
        CHECK(made.load() == 0 || made.load() == 1);
        CHECK_EQ(has_frame(buffer, "tip"), has_frame(buffer, "tool"));
    }
}

TFDB_TEST(transaction_threads_alone_never_loses) {
    constexpr int kEdges = 200;
    Buffer buffer(keeping(1000));
    for (int i = 0; i < kEdges; ++i)
        set(buffer, "map", "edge" + std::to_string(i), 0, at(1));
    std::atomic<bool> stop{false};
    std::vector<std::thread> writers;
    for (int w = 0; w < 2; ++w) {
        writers.emplace_back([&, w] {
            // Each edge has one writer, so only its own writes make stamps too old.
            for (StampNs stamp = 1; !stop; ++stamp) {
                const auto edge = 2 * (7 * stamp % (kEdges / 2)) + w;
                set(buffer, "map", "edge" + std::to_string(edge), stamp, at(1));
            }
        });
    }
    for (int i = 0; i < 20; ++i) {
        TransactionOptions options;
        options.alone = true;
        options.priority = static_cast<unsigned>(i % 8);
        Transaction tx(buffer, options);
        const CommitNumber begun = buffer.commit();
        for (int k = 0; k < kEdges; ++k)
            (void)tx.lookup_latest_transform("map", "edge" + std::to_string(k));
        put_static(tx, "map", "mark" + std::to_string(i), i);
        CHECK_EQ(tx.commit(), begun + 1);
    }
    stop = true;
    for (std::thread& writer : writers)
        writer.join();
    CHECK_EQ(buffer.counters().conflicts, 0U);
}

TFDB_TEST(transaction_threads_that_end_abort_what_they_have_open) {
    for (const Concurrency concurrency : kIsolating) {
        for (const bool alone : {false, true}) {
            Buffer buffer(options_of(concurrency));
            set(buffer, "map", "count", 0, at(0));
            const std::uint64_t aborts = buffer.counters().aborts;
            std::vector<std::unique_ptr<Transaction>> left(3);
            for (std::unique_ptr<Transaction>& tx : left) {
                in_threads(1, [&](int) {
                    TransactionOptions options;
                    options.alone = alone;
                    tx = std::make_unique<Transaction>(buffer, options);
                    const Answer seen = tx->lookup_latest_transform("map", "count");
                    const TransformView next{"map", "count", seen.stamp + 1, at(7)};
                    tx->set_transforms({&next, 1}, false, "");
                });
                // A later thread gets the slot and the ids of an earlier one.
                in_threads(1, [&](int) {
                    CHECK_THROWS_AS(tx->commit(), WrongThread);
                    CHECK_EQ(insist(buffer,
                                    [](Transaction& own) {
                                        const TransformView other{"map", "other", 5, at(2)};
                                        own.set_transforms({&other, 1}, false, "");
                                    }),
                             0);
                });
            }
            CHECK_EQ(buffer.counters().aborts - aborts, left.size());
            CHECK_EQ(buffer.lookup_latest_transform("map", "count").stamp, 0);
            in_threads(1, [&](int) { left.clear(); });
            CHECK_EQ(buffer.counters().aborts - aborts, 3U);
            set(buffer, "map", "count", 9, at(9));
        }
    }
}

TFDB_TEST(transaction_threads_end_while_others_free_their_transactions) {
    for (const Concurrency concurrency : kIsolating) {
        Buffer buffer(options_of(concurrency));
        set(buffer, "map", "count", 0, at(0));
        for (int i = 0; i < 200; ++i) {
            std::unique_ptr<Transaction> tx;
            std::atomic<bool> open{false};
            in_threads(2, [&](int which) {
                if (which == 0) {
                    tx = std::make_unique<Transaction>(buffer);
                    CHECK(tx->has_frame("count"));
                    open = true;
                    open.notify_all();
                } else {
                    open.wait(false);
                    tx.reset();
                }
            });
        }
        CHECK_EQ(buffer.counters().aborts, 200U);
        set(buffer, "map", "count", 9, at(9));
    }
}

}  // namespace tfdb
