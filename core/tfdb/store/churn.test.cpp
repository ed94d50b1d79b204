// A hundred thousand frames are made and removed together, and ten thousand change their parent,
// beside readers. Memory does not grow, and results stay right.
#include <atomic>
#include <functional>
#include <random>
#include <thread>

#include "tfdb/store/fixture.hpp"
#include "tfdb/testing/sanitized.hpp"

namespace tfdb {
namespace {

using namespace fixture;

constexpr std::size_t kVisitors = testing::kSanitized ? 5000 : 100'000;
constexpr std::size_t kCarts = testing::kSanitized ? 1000 : 10'000;
constexpr int kRounds = 4;
constexpr unsigned kSeed = 11;

/// Calls each reader repeatedly, with its own random generator, until `body` returns.
void beside(const std::function<void()>& body,
            const std::vector<std::function<void(std::mt19937&)>>& readers) {
    std::atomic<bool> done{false};
    std::vector<std::thread> threads;
    for (std::size_t i = 0; i < readers.size(); ++i) {
        threads.emplace_back([&, i] {
            std::mt19937 random(kSeed + static_cast<unsigned>(i));
            try {
                do {
                    readers[i](random);
                } while (!done.load());
            } catch (const std::exception& error) {
                testing::report_failure(__FILE__, __LINE__, error.what());
            }
        });
    }
    body();
    done = true;
    for (std::thread& thread : threads)
        thread.join();
}

/// Visitors of a hall, all made by one batch and removed by one call.
struct Crowd {
    std::vector<std::string> names;
    std::vector<TransformView> arrivals;
    std::vector<std::string_view> departures;

    explicit Crowd(std::size_t size) {
        for (std::size_t i = 0; i < size; ++i)
            names.push_back("visitor_" + std::to_string(i));
        for (std::size_t i = 0; i < size; ++i)
            arrivals.push_back({"hall", names[i], kSecond, pose_of(static_cast<double>(i))});
        departures.assign(names.begin(), names.end());
        std::mt19937 random(kSeed);
        std::shuffle(departures.begin(), departures.end(), random);
    }

    /// Looks one of them up: it has its pose or is missing.
    void look(const StoreReader& reads, std::mt19937& random) const {
        const std::size_t i = random() % names.size();
        try {
            const Answer there = reads.lookup_transform("hall", names[i], kSecond);
            const Answer back = reads.lookup_transform(names[i], "hall");
            CHECK_EQ(number_of(there.pose), static_cast<double>(i));
            CHECK(apart(geometry::inverse(back.pose), there.pose) <
                  1e-12 * (1000.0 + there.pose.translation.x));
        } catch (const UnknownFrame&) {
        }
        CHECK_EQ(number_of(reads.lookup_transform("map", "hall").pose), 7.0);
    }
};

constexpr int kMoves = 6;

/// Carts that move between the hall (map <- hall is pose 1) and the yard (pose 2).
void check_moves(const Buffer& buffer, const std::vector<std::string>& carts) {
    for (std::size_t i = 0; i < kCarts; i += kCarts / 100) {
        for (int move = 0; move <= kMoves; ++move) {
            const std::string_view parent = move % 2 == 1 ? "yard" : "hall";
            const double number = static_cast<double>(i) + 0.5 * move;
            const StampNs at = 1000 + 1000 * move;
            for (const StampNs stamp : {at, at + 999}) {  // it holds until the next one
                if (move == kMoves && stamp != at)
                    continue;
                CHECK_EQ(number_of(buffer.lookup_transform(parent, carts[i], stamp).pose), number);
                const Pose expected =
                    geometry::compose(pose_of(move % 2 == 1 ? 2 : 1), pose_of(number));
                CHECK(apart(buffer.lookup_transform("map", carts[i], stamp).pose, expected) <
                      1e-9 * (1 + number));
                CHECK(apart(geometry::inverse(buffer.lookup_transform(carts[i], "map", stamp).pose),
                            expected) < 1e-9 * (1 + number));
            }
        }
    }
}

}  // namespace

TFDB_TEST(churn_of_frames_leaves_memory_flat_and_answers_right) {
    std::printf("  %zu frames, %d rounds, seed %u\n", kVisitors, kRounds, kSeed);
    Buffer buffer(defaults());
    const Crowd crowd(kVisitors);
    set_static(buffer, "map", "hall", pose_of(7));
    std::size_t settled = 0;
    const auto look = [&](std::mt19937& random) { crowd.look(buffer, random); };
    beside(
        [&] {
            for (int round = 0; round < kRounds; ++round) {
                buffer.set_transforms(crowd.arrivals, false, "gate");
                CHECK_EQ(buffer.frames().size(), kVisitors + 2);
                const std::size_t i = static_cast<std::size_t>(round) * 997 % kVisitors;
                CHECK_EQ(number_of(buffer.lookup_transform("hall", crowd.names[i]).pose),
                         static_cast<double>(i));
                buffer.remove_frames(crowd.departures, false);
                CHECK_EQ(buffer.frames().size(), 2U);
                const MemoryUse use = buffer.memory();
                if (round == 0)
                    settled = use.used_bytes;
                CHECK_EQ(use.used_bytes, settled);
                CHECK_EQ(use.frames, kVisitors + 2);
            }
        },
        {look, look});
}

TFDB_TEST(churn_under_a_held_snapshot_grows_once_and_falls_back) {
    Buffer buffer(defaults());
    const Crowd crowd(kVisitors / 4);
    set_static(buffer, "map", "hall", pose_of(7));
    const auto round = [&] {
        buffer.set_transforms(crowd.arrivals, false, "gate");
        buffer.remove_frames(crowd.departures, false);
        return buffer.memory().used_bytes;
    };
    const auto look = [&](std::mt19937& random) { crowd.look(buffer, random); };
    beside(
        [&] {
            const std::size_t settled = round();
            buffer.set_transforms(crowd.arrivals, false, "gate");
            {
                const Snapshot held = buffer.snapshot();
                buffer.remove_frames(crowd.departures, false);
                // Memory of removed frames: samples, a name, and entries in the name table.
                const std::size_t most = settled + crowd.names.size() * 1024;
                CHECK(round() <= 2 * most);
                std::mt19937 random(kSeed);
                for (int i = 0; i < 1000; ++i)
                    crowd.look(held, random);
                CHECK_EQ(held.frames().size(), crowd.names.size() + 2);
            }
            // Except the name table, which keeps its greatest size.
            const std::size_t table = crowd.names.size() * 2 * 8 * 8;
            CHECK(round() <= settled + table);
            const std::size_t again = round();
            CHECK_EQ(round(), again);
        },
        {look});
}

TFDB_TEST(churn_of_parents_is_seen_whole_at_and_around_its_stamp) {
    if (skipped_in({Concurrency::kFine}, "it sees batches in parts"))
        return;
    Buffer buffer(keeping(std::nullopt));
    std::vector<std::string> carts;
    std::vector<std::string> loads;
    for (std::size_t i = 0; i < kCarts; ++i) {
        carts.push_back("cart_" + std::to_string(i));
        loads.push_back("load_" + std::to_string(i));
    }
    const auto all_at = [&](std::string_view parent, StampNs stamp, double offset) {
        std::vector<TransformView> batch;
        for (std::size_t i = 0; i < kCarts; ++i)
            batch.push_back({parent, carts[i], stamp, pose_of(offset + static_cast<double>(i))});
        return batch;
    };
    set_static(buffer, "map", "hall", pose_of(1));
    set_static(buffer, "map", "yard", pose_of(2));
    auto batch = all_at("hall", 1000, 0.0);
    for (std::size_t i = 0; i < kCarts; ++i)
        batch.push_back({carts[i], loads[i], 1000, pose_of(3)});
    buffer.set_transforms(batch, false, "");

    const auto together = [&](std::mt19937& random) {
        const Snapshot now = buffer.snapshot();
        const auto one = now.frame_info(carts[random() % kCarts]).parent;
        const auto other = now.frame_info(carts[random() % kCarts]).parent;
        CHECK(one && one == other);
    };
    beside(
        [&] {
            for (int move = 1; move <= kMoves; ++move) {
                const std::string_view to = move % 2 == 1 ? "yard" : "hall";
                buffer.set_transforms(all_at(to, 1000 + 1000 * move, 0.5 * move), false, "");
            }
        },
        {together, together});

    check_moves(buffer, carts);
    // No cart may become a descendant of its own load.
    auto wrong = all_at("yard", 9000, 0.0);
    wrong[kCarts / 2].parent = loads[kCarts / 2];
    const auto error = THROWN(CycleError, buffer.set_transforms(wrong, false, ""));
    CHECK(error && error->detail().refused.size() == 1 && error->detail().index == kCarts / 2);
    CHECK_EQ(buffer.frame_info(carts[0]).newest, 1000 + 1000 * kMoves);
}

}  // namespace tfdb
