// What the isolation tests share: every engine, both directions of a path, two actors in step.
#pragma once

#include <atomic>
#include <functional>
#include <thread>

#include "tfdb/store/fixture.hpp"
#include "tfdb/store/transaction.hpp"

namespace tfdb::isolation {

using namespace fixture;

inline constexpr Concurrency kAtomic[] = {Concurrency::kSnapshot,  Concurrency::kGiant,
                                          Concurrency::kNoWait,    Concurrency::kWaitDie,
                                          Concurrency::kWoundWait, Concurrency::kSilo};

/// Whether a lookup asks for T[a<-b] or for T[b<-a].
enum class Direction : std::uint8_t { kDown, kUp };

struct Case {
    Concurrency engine;
    Direction direction;
};

/// Runs `body(case)` for each atomic engine in both directions; says where it failed.
template <class Body>
void in_every_case(const Body& body) {
    for (const Concurrency engine : kAtomic) {
        for (const Direction direction : {Direction::kDown, Direction::kUp}) {
            std::printf("  %s %s", std::string(concurrency_name(engine)).c_str(),
                        direction == Direction::kDown ? "down" : "up");
            body(Case{engine, direction});
        }
    }
    std::printf("\n");
}

inline BufferOptions options_of(Concurrency engine, std::optional<StampNs> history = std::nullopt) {
    BufferOptions options;
    options.concurrency = engine;
    options.history_ns = history;
    return options;
}

/// T[a<-b] as newest, asked for in the one direction or the other.
template <class Source>
Pose newest(Source& from, Direction direction, std::string_view a, std::string_view b) {
    if (direction == Direction::kDown)
        return from.lookup_latest_transform(a, b).pose;
    return geometry::inverse(from.lookup_latest_transform(b, a).pose);
}
template <class Source>
Pose at_stamp(Source& from, Direction direction, std::string_view a, std::string_view b,
              std::optional<StampNs> stamp) {
    if (direction == Direction::kDown)
        return from.lookup_transform(a, b, stamp).pose;
    return geometry::inverse(from.lookup_transform(b, a, stamp).pose);
}
/// The number of a pose that may have been inverted twice.
inline int whole(const Pose& pose) {
    return static_cast<int>(std::lround(number_of(pose)));
}

inline void put(Transaction& tx, std::string_view parent, std::string_view child, StampNs stamp,
                double number) {
    const TransformView transform{parent, child, stamp, pose_of(number)};
    tx.set_transforms({&transform, 1}, false, "tx");
}

/// Actors who wait for each other where they can: one that is blocked by the other's locks is
/// waited for only so long. What is right may not depend on it; in `snapshot`, where no actor is
/// ever blocked, the order is certain. Threads: two. Guarantee: blocking.
class Meeting {
public:
    explicit Meeting(Concurrency engine)
        : patience_(engine == Concurrency::kSnapshot ? -1
                    : engine == Concurrency::kFine   ? 20'000
                                                     : 200) {}

    void arrive() { arrived_.fetch_add(1); }
    void wait_for(int arrivals) const {
        for (int i = 0; arrived_.load() < arrivals && i != patience_; ++i)
            std::this_thread::yield();
    }
    /// Both are here, or the other one cannot come.
    void meet(int arrivals) {
        arrive();
        wait_for(arrivals);
    }

private:
    const int patience_;
    std::atomic<int> arrived_{0};
};

/// `body(tx, first)` until it commits; `first` is true in the first attempt only.
template <class Body>
int until_committed(Buffer& buffer, const Body& body) {
    TransactionOptions options;
    for (int attempt = 0;; ++attempt) {
        options.alone = attempt >= 20;
        Transaction tx(buffer, options);
        options.age = tx.age();
        try {
            body(tx, attempt == 0);
            tx.commit();
            return attempt;
        } catch (const Conflict&) {
            CHECK(!tx.is_open());
        }
    }
}

/// All at once; what one throws fails the test.
inline void side_by_side(const std::vector<std::function<void()>>& bodies) {
    std::vector<std::thread> threads;
    for (const auto& body : bodies) {
        threads.emplace_back([&body] {
            try {
                body();
            } catch (const std::exception& error) {
                testing::report_failure(__FILE__, __LINE__, error.what());
            }
        });
    }
    for (std::thread& thread : threads)
        thread.join();
}

}  // namespace tfdb::isolation
