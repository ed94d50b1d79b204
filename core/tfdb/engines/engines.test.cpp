// Every engine, in one program: correct answers, complete batches, no starved thread, no leaked
// lock.
#include <atomic>
#include <cmath>
#include <functional>
#include <thread>

#include "tfdb/store/fixture.hpp"
#include "tfdb/store/isolation.test.hpp"

namespace tfdb {
namespace {

using namespace fixture;
using isolation::side_by_side;

constexpr Concurrency kEngines[] = {
    Concurrency::kSnapshot, Concurrency::kGiant,     Concurrency::kFine, Concurrency::kNoWait,
    Concurrency::kWaitDie,  Concurrency::kWoundWait, Concurrency::kSilo};

BufferOptions of(Concurrency engine, std::optional<StampNs> history = 10 * kSecond) {
    BufferOptions options;
    options.history_ns = history;
    options.concurrency = engine;
    return options;
}

std::string name_of(Concurrency engine) {
    return std::string(concurrency_name(engine));
}

const std::string& joint(std::size_t i) {
    static const std::vector<std::string> names = [] {
        std::vector<std::string> made;
        for (std::size_t n = 0; n < 1100; ++n)
            made.push_back("j" + std::to_string(n));
        return made;
    }();
    return names[i];
}

/// A rotation by `angle` about z and a step of one along x: a joint of an arm.
Pose turned(double angle) {
    return {{1, 0, 0}, {0, 0, std::sin(angle / 2), std::cos(angle / 2)}};
}

/// Decrements the writer count, even if the writer throws.
class Leaving {
public:
    explicit Leaving(std::atomic<int>& writing) : writing_(writing) {}
    ~Leaving() { writing_.fetch_sub(1); }

private:
    std::atomic<int>& writing_;
};

/// A pure translation: those of a path add up.
Pose shifted(double x) {
    return {{x, 1, 2}, {0, 0, 0, 1}};
}

/// One chain j0 <- j1 <- ... at one stamp.
void set_chain(Buffer& buffer, std::size_t edges, StampNs stamp, bool is_static = false) {
    std::vector<TransformView> batch;
    for (std::size_t i = 0; i < edges; ++i)
        batch.push_back({joint(i), joint(i + 1), stamp, shifted(1)});
    buffer.set_transforms(batch, is_static, "");
}

}  // namespace

TFDB_TEST(engines_answer_like_arithmetic_in_both_directions) {
    for (const Concurrency engine : kEngines) {
        Buffer buffer(of(engine));
        for (StampNs stamp = 0; stamp <= 100; stamp += 10) {
            const double t = static_cast<double>(stamp);
            const TransformView batch[] = {{"map", "arm", stamp, turned(0.01 * t)},
                                           {"arm", "hand", stamp, turned(0.02 * t)}};
            buffer.set_transforms(batch, false, "");
        }
        buffer.set_transform({"map", "table", 0, turned(0.5)}, true, "");
        const Pose hand = geometry::compose(turned(0.35), turned(0.7));
        CHECK(apart(buffer.lookup_transform("map", "hand", 35).pose, hand) < 1e-12);
        CHECK(apart(buffer.lookup_transform("hand", "map", 35).pose, geometry::inverse(hand)) <
              1e-12);
        const Pose newest = geometry::compose(turned(1.0), turned(2.0));
        CHECK(apart(buffer.lookup_latest_transform("table", "hand").pose,
                    geometry::compose(geometry::inverse(turned(0.5)), newest)) < 1e-12);
        CHECK(apart(buffer.lookup_transform("hand", "table").pose,
                    geometry::compose(geometry::inverse(newest), turned(0.5))) < 1e-12);
        const Answer answer = buffer.lookup_transform("map", "hand", 40);
        CHECK_EQ(answer.commit, buffer.commit());
        CHECK_EQ(buffer.concurrency(), engine);
    }
}

TFDB_TEST(engines_take_late_moved_removed_and_cleared_samples) {
    for (const Concurrency engine : kEngines) {
        Buffer buffer(of(engine, 100));
        for (StampNs stamp : {100, 150, 110, 150, 60})
            set(buffer, "map", "base", stamp, pose_of(static_cast<double>(stamp)));
        CHECK_EQ(number_of(buffer.lookup_transform("map", "base", 110).pose), 110);
        CHECK_EQ(number_of(buffer.lookup_transform("map", "base", 60).pose), 60);
        CHECK(THROWN(TooOld, set(buffer, "map", "base", 49, pose_of(1))));
        CHECK(THROWN(StaticConflict, set_static(buffer, "map", "base", pose_of(1))));
        CHECK(THROWN(CycleError, set(buffer, "base", "map", 150, pose_of(1))));
        set(buffer, "odom", "base", 160, pose_of(160));
        CHECK_EQ(number_of(buffer.lookup_transform("odom", "base", 160).pose), 160);
        CHECK_EQ(number_of(buffer.lookup_transform("map", "base", 150).pose), 150);
        set(buffer, "odom", "base", 170, pose_of(170));
        set(buffer, "odom", "base", 155, pose_of(155));  // before the first sample of this parent
        CHECK_EQ(number_of(buffer.lookup_transform("odom", "base", 155).pose), 155);
        CHECK(buffer.clear() == buffer.commit());
        CHECK(THROWN(Disconnected, buffer.lookup_transform("odom", "base", 160)));
        set(buffer, "map", "base", 10, pose_of(10));
        CHECK_EQ(number_of(buffer.lookup_transform("map", "base", 10).pose), 10);
        buffer.remove_frame("base", false);
        const auto error = THROWN(UnknownFrame, buffer.lookup_transform("map", "base", 10));
        CHECK(error && says(*error, "base"));
    }
}

TFDB_TEST(engines_name_unknown_frames_and_stale_handles) {
    for (const Concurrency engine : kEngines) {
        Buffer buffer(of(engine));
        CHECK(THROWN(UnknownFrame, buffer.lookup_transform("map", "base")));
        set(buffer, "map", "base", kSecond, pose_of(1));
        CHECK(THROWN(UnknownFrame, buffer.lookup_latest_transform("map", "tool")));
        CHECK(THROWN(Extrapolation, buffer.lookup_transform("map", "base", 2 * kSecond)));
        FrameHandle map;
        FrameHandle base;
        CHECK(buffer.find_frame("map", map) && buffer.find_frame("base", base));
        Answer answer;
        Failure failure;
        CHECK_EQ(buffer.latest_common_time("map", "base"), kSecond);
        CHECK(identical(buffer.lookup_transform_full("map", kSecond, "base", {}, "map").pose,
                        pose_of(1)));
        // Another frame of the same name gets the slot, so the handle is stale.
        buffer.remove_frame("base", false);
        set(buffer, "map", "base", kSecond, pose_of(2));
        base.generation += 100;
        CHECK(!buffer.ask(store::at_stamp(map, base, {}, {}), answer, failure));
        CHECK_EQ(failure.code, ErrorCode::kUnknownFrame);
        CHECK_EQ(failure.argument, 1);
    }
}

TFDB_TEST(engines_store_batches_whole_beside_readers) {
    // Translations along a path of four edges that one batch changes: they add up to zero. Two
    // writers in opposite orders; two readers in opposite directions.
    constexpr int kWrites = 4'000;
    for (const Concurrency engine : kEngines) {
        Buffer buffer(of(engine, std::nullopt));
        std::atomic<StampNs> clock{0};
        const auto write = [&](double x, bool backward) {
            const StampNs stamp = clock.fetch_add(1);
            std::vector<TransformView> batch;
            for (std::size_t i = 0; i < 4; ++i)
                batch.push_back({joint(i), joint(i + 1), stamp, shifted(i % 2 == 0 ? x : -x)});
            if (backward)
                std::reverse(batch.begin(), batch.end());
            buffer.set_transforms(batch, false, backward ? "backward" : "forward");
        };
        write(0, false);
        std::atomic<int> writing{2};
        std::atomic<long> torn{0};
        const auto writer = [&](bool backward) {
            const Leaving leaving(writing);
            for (int i = 1; i <= kWrites; ++i)
                write(i, backward);
        };
        const auto reader = [&](const std::string& target, const std::string& source) {
            while (writing.load() != 0) {
                torn += buffer.lookup_latest_transform(target, source).pose.translation.x != 0;
                torn += buffer.lookup_transform(target, source).pose.translation.x != 0;
            }
        };
        side_by_side({[&] { writer(false); }, [&] { writer(true); },
                      [&] { reader(joint(0), joint(4)); }, [&] { reader(joint(4), joint(0)); }});
        if (engine != Concurrency::kFine)
            CHECK_EQ(std::to_string(torn.load()) + " torn in " + name_of(engine),
                     "0 torn in " + name_of(engine));
        CHECK_EQ(buffer.samples(joint(1)).stamps.size(), std::size_t{2 * kWrites + 1});
        CHECK_EQ(buffer.samples(joint(4)).stamps.size(), std::size_t{2 * kWrites + 1});
        const Counters counters = buffer.counters();
        CHECK_EQ(counters.commits, buffer.commit());
        std::printf("  %-14s %llu retries, %llu lock waits, torn %ld\n", name_of(engine).c_str(),
                    static_cast<unsigned long long>(counters.retries),
                    static_cast<unsigned long long>(counters.lock_waits), torn.load());
    }
}

TFDB_TEST(engines_grow_rings_and_make_frames_under_contention) {
    constexpr StampNs kWrites = 3'000;
    for (const Concurrency engine : kEngines) {
        Buffer buffer(of(engine, std::nullopt));
        set_chain(buffer, 8, 0);
        std::atomic<long> wrong{0};
        std::atomic<int> writing{3};
        const auto own = [&](std::size_t first) {
            return [&, first] {
                const Leaving leaving(writing);
                for (StampNs stamp = 1; stamp <= kWrites; ++stamp) {
                    const TransformView batch[] = {
                        {joint(first), joint(first + 1), stamp, shifted(1)},
                        {joint(first + 1), joint(first + 2), stamp, shifted(1)}};
                    buffer.set_transforms(batch, false, "a writer whose name is long");
                }
            };
        };
        side_by_side(
            {own(0), own(4),
             [&] {
                 const Leaving leaving(writing);
                 for (int i = 0; i < 300; ++i) {
                     const std::string name = "visitor" + std::to_string(i % 7);
                     set(buffer, joint(3), name, i, pose_of(i));
                     wrong += number_of(buffer.lookup_transform(joint(3), name).pose) != i;
                     buffer.remove_frame(name, false);
                 }
             },
             [&] {
                 while (writing.load() != 0) {
                     wrong +=
                         number_of(buffer.lookup_latest_transform(joint(0), joint(8)).pose) != 8;
                     const Snapshot held = buffer.snapshot();
                     const Samples samples = held.samples(joint(1));
                     wrong += samples.stamps != held.samples(joint(2)).stamps &&
                              engine != Concurrency::kFine;
                     wrong +=
                         samples.stamps.back() + 1 != static_cast<StampNs>(samples.stamps.size());
                 }
             }});
        CHECK_EQ(wrong.load(), 0);
        CHECK_EQ(buffer.samples(joint(2)).stamps.size(), std::size_t{kWrites + 1});
        CHECK_EQ(buffer.frame_info(joint(5)).authority, "a writer whose name is long");
    }
}

TFDB_TEST(engines_leave_memory_flat) {
    for (const Concurrency engine : kEngines) {
        Buffer buffer(of(engine, 500));
        const auto write = [&](StampNs from, StampNs to) {
            for (StampNs stamp = from; stamp < to; ++stamp)
                set_chain(buffer, 4, stamp);
        };
        write(0, 3'000);
        const std::size_t used = buffer.memory().used_bytes;
        write(3'000, 9'000);
        CHECK_EQ(buffer.memory().used_bytes, used);
        {
            const Snapshot held = buffer.snapshot();
            write(9'000, 11'000);
            CHECK_EQ(held.lookup_transform(joint(0), joint(4)).stamp, 8'999);
            CHECK_EQ(held.samples(joint(1)).stamps.size(), 501U);
        }
        write(11'000, 12'000);
        CHECK_EQ(buffer.lookup_transform(joint(0), joint(4)).stamp, 11'999);
    }
}

TFDB_TEST(engines_refuse_what_does_not_fit_and_stay_as_they_were) {
    for (const Concurrency engine : kEngines) {
        BufferOptions options = of(engine, std::nullopt);
        options.memory_limit = 64 * 1024;
        Buffer buffer(options);
        set_chain(buffer, 3, 0);
        StampNs stamp = 1;
        const auto fill = [&] {
            for (;; ++stamp)
                set_chain(buffer, 3, stamp);
        };
        CHECK(THROWN(CapacityExceeded, fill()));
        const std::size_t kept = buffer.samples(joint(1)).stamps.size();
        if (engine != Concurrency::kFine) {
            CHECK_EQ(kept, static_cast<std::size_t>(stamp));
            CHECK_EQ(buffer.samples(joint(2)).stamps.size(), kept);
            CHECK_EQ(buffer.samples(joint(3)).stamps.size(), kept);
        }
        CHECK_EQ(number_of(buffer.lookup_transform(joint(0), joint(3), stamp - 1).pose), 3);
        CHECK(THROWN(CapacityExceeded, set_chain(buffer, 3, stamp)));
    }
}

TFDB_TEST(engines_starve_neither_a_long_reader_nor_wide_writers) {
    // A reader of 1000 edges beside four writers of whole rows of them, all at full speed until it
    // has its answers. It ends because it runs alone after a bounded number of attempts.
    constexpr std::size_t kEdges = 1000;
    constexpr int kReads = 20;
    for (const Concurrency engine : kEngines) {
        Buffer buffer(of(engine));
        set_chain(buffer, kEdges, 0);
        std::atomic<bool> reading{true};
        std::atomic<StampNs> clock{1};
        std::atomic<long> wrong{0};
        std::vector<std::function<void()>> bodies;
        for (std::size_t w = 0; w < 4; ++w) {
            bodies.emplace_back([&, w] {
                std::size_t at = 250 * w;
                do {
                    const StampNs stamp = clock.fetch_add(1);
                    std::vector<TransformView> batch;
                    for (std::size_t i = 0; i < 10; ++i)
                        batch.push_back({joint(at + i), joint(at + i + 1), stamp, shifted(1)});
                    buffer.set_transforms(batch, false, "");
                    at = (at + 70) % (kEdges - 10);
                } while (reading.load());
            });
        }
        bodies.emplace_back([&] {
            for (int i = 0; i < kReads; ++i) {
                wrong += number_of(buffer.lookup_latest_transform(joint(0), joint(kEdges)).pose) !=
                         static_cast<double>(kEdges);
            }
            reading.store(false);
        });
        side_by_side(bodies);
        CHECK_EQ(wrong.load(), 0);
    }
}

TFDB_TEST(engines_let_more_threads_in_than_there_are_slots) {
    constexpr int kThreads = 80;
    for (const Concurrency engine : kEngines) {
        Buffer buffer(of(engine));
        set_chain(buffer, 2, 0);
        std::atomic<long> wrong{0};
        std::vector<std::function<void()>> bodies;
        for (int t = 0; t < kThreads; ++t) {
            bodies.emplace_back([&, t] {
                for (StampNs i = 1; i <= 20; ++i) {
                    set(buffer, joint(0), joint(t % 2 == 0 ? 1 : 3), i, shifted(1));
                    wrong +=
                        number_of(buffer.lookup_latest_transform(joint(0), joint(2)).pose) != 2;
                }
            });
        }
        side_by_side(bodies);
        CHECK_EQ(wrong.load(), 0);
    }
}

}  // namespace tfdb
