// The paper's arm: two joints whose angles sum to a constant, written together at several rates.
#include <chrono>

#include "tfdb/store/isolation.test.hpp"

namespace tfdb {
namespace {

using namespace isolation;

constexpr double kSum = 1.1;
constexpr StampNs kPeriod = 10;

/// A joint rotated by `angle` about z, and a link of one metre along x.
Pose joint(double angle) {
    return {{1.0, 0.5, -0.25}, {0, 0, std::sin(angle / 2), std::cos(angle / 2)}};
}
TransformView shoulder(int i) {
    return {"base", "upper", i * kPeriod, joint(0.7 + 0.001 * (i % 500))};
}
TransformView elbow(int i) {
    return {"upper", "fore", i * kPeriod, joint(kSum - 0.7 - 0.001 * (i % 500))};
}
void write_both(Buffer& buffer, int i) {
    const TransformView batch[] = {elbow(i), shoulder(i)};
    buffer.set_transforms(batch, false, "arm");
}

/// True if the angles of T[base<-fore], or of its inverse, do not sum to the constant.
bool violates(const Answer& answer, Direction direction) {
    const geometry::Quat q = answer.pose.rotation;
    const double half = direction == Direction::kDown ? kSum / 2 : -kSum / 2;
    const double along = q.z * std::sin(half) + q.w * std::cos(half);
    return answer.edges.size() != 2 || std::fabs(std::fabs(along) - 1.0) > 1e-9;
}

/// One reader that uses both kinds of reads in both directions, and counts violations. In `fine`
/// one edge may be ahead of the other by more than its history, so that no common time exists.
struct Reader {
    Buffer& buffer;
    bool only_latest = false;
    std::atomic<long> reads{0};
    std::atomic<long> violations{0};

    void look() {
        for (const Direction direction : {Direction::kDown, Direction::kUp}) {
            const bool down = direction == Direction::kDown;
            const char* const target = down ? "base" : "fore";
            const char* const source = down ? "fore" : "base";
            const Answer latest = buffer.lookup_latest_transform(target, source);
            violations += violates(latest, direction);
            reads += 1;
            if (only_latest)
                continue;
            const Answer common = buffer.lookup_transform(target, source);
            violations += violates(common, direction);
            // Between two samples both angles are interpolated with the same weight.
            const Answer between =
                buffer.lookup_transform(target, source, common.stamp - kPeriod / 3);
            violations += violates(between, direction);
            reads += 2;
        }
    }
};

/// `writes` batches, one per `period`; zero: without pauses.
void at_rate(Concurrency engine, std::chrono::nanoseconds period, int writes, long reads) {
    Buffer buffer(options_of(engine));
    for (int i = 0; i < 3; ++i)
        write_both(buffer, i);
    Reader one{buffer, false};
    Reader two{buffer, false};
    std::atomic<bool> written{false};
    const auto read = [&](Reader& reader) {
        while (!written.load() || reader.reads.load() < reads)
            reader.look();
    };
    side_by_side({[&] {
                      auto due = std::chrono::steady_clock::now();
                      for (int i = 3; i < 3 + writes; ++i) {
                          due += period;
                          while (std::chrono::steady_clock::now() < due)
                              std::this_thread::yield();
                          write_both(buffer, i);
                      }
                      written.store(true);
                  },
                  [&] { read(one); }, [&] { read(two); }});
    CHECK_EQ(one.violations.load() + two.violations.load(), 0);
    CHECK(one.reads.load() >= reads && two.reads.load() >= reads);
}

void at_rate_in_every_engine(std::chrono::nanoseconds period, int writes, long reads) {
    for (const Concurrency engine : kAtomic)
        at_rate(engine, period, writes, reads);
}

}  // namespace

TFDB_TEST(arm_at_10_hertz) {
    at_rate_in_every_engine(std::chrono::milliseconds(100), 4, 3000);
}

TFDB_TEST(arm_at_100_hertz) {
    at_rate_in_every_engine(std::chrono::milliseconds(10), 30, 3000);
}

TFDB_TEST(arm_at_1000_hertz) {
    at_rate_in_every_engine(std::chrono::milliseconds(1), 200, 3000);
}

TFDB_TEST(arm_flat_out) {
    at_rate_in_every_engine(std::chrono::nanoseconds(0), 10'000, 3000);
}

TFDB_TEST(arm_of_one_mutex_without_batches_violates_the_sum) {
    // The reader always reads between the two writes. This is tf2's best case.
    Buffer buffer(options_of(Concurrency::kGiant, 5000));
    for (int i = 0; i < 3; ++i)
        write_both(buffer, i);
    Reader reader{buffer, false};
    std::atomic<bool> written{false};
    side_by_side({[&] {
                      for (int i = 3; i < 20; ++i) {
                          buffer.set_transform(shoulder(i), false, "arm");
                          const long before = reader.reads.load();
                          while (reader.reads.load() < before + 12)
                              std::this_thread::yield();
                          buffer.set_transform(elbow(i), false, "arm");
                      }
                      written.store(true);
                  },
                  [&] {
                      while (!written.load())
                          reader.look();
                  }});
    CHECK(reader.violations.load() >= 17);
}

TFDB_TEST(arm_of_a_lock_per_frame_violates_the_sum) {
    constexpr int kMost = 5'000'000;
    Buffer buffer(options_of(Concurrency::kFine, 5000));
    for (int i = 0; i < 3; ++i)
        write_both(buffer, i);
    Reader reader{buffer, true};
    std::atomic<bool> over{false};
    side_by_side({[&] {
                      for (int i = 3; i < kMost && reader.violations.load() == 0; ++i)
                          write_both(buffer, i);
                      over.store(true);
                  },
                  [&] {
                      while (!over.load())
                          reader.look();
                  }});
    CHECK(reader.violations.load() > 0);
}

}  // namespace tfdb
