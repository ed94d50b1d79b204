// Names of those who write: as many as frames have, and a bounded number more.
#include "tfdb/store/fixture.hpp"
#include "tfdb/store/transaction.hpp"

namespace tfdb {
namespace {

using namespace fixture;

/// As long as names are that people give.
std::string author_of(int i) {
    return "/robot_7/localisation/instance_that_was_started_anew/" + std::to_string(i);
}

BufferOptions engine_of(std::size_t engine) {
    BufferOptions options;
    options.history_ns = 1000;
    options.concurrency = static_cast<Concurrency>(engine);
    return options;
}

}  // namespace

TFDB_TEST(authorities_that_no_frame_has_are_forgotten) {
    constexpr int kWrites = 20'000;
    for (std::size_t engine = 0; engine < kConcurrencies; ++engine) {
        Buffer buffer(engine_of(engine));
        std::size_t most = 0;
        set(buffer, "map", "old", 0, pose_of(1), author_of(-1));
        for (int i = 0; i < kWrites; ++i) {
            set(buffer, "map", i % 2 == 0 ? "left" : "right", i, pose_of(1), author_of(i));
            if (i % 5 == 0) {
                Transaction tx(buffer);
                const TransformView batch[] = {{"map", "late", i, pose_of(2)}};
                tx.set_transforms(batch, false, author_of(-2 - i));
                tx.commit();
            }
            if (i % 100 == 0)
                most = std::max(most, buffer.memory().authority_bytes);
        }
        CHECK(most < 64 * 1024);
        CHECK(most > author_of(0).size());
        CHECK_EQ(buffer.frame_info("left").authority, author_of(kWrites - 2));
        CHECK_EQ(buffer.frame_info("right").authority, author_of(kWrites - 1));
        CHECK_EQ(buffer.frame_info("late").authority, author_of(-2 - (kWrites - 5)));
        CHECK_EQ(buffer.frame_info("old").authority, author_of(-1));
        CHECK_EQ(buffer.frame_info("map").authority, "");
    }
}

TFDB_TEST(authorities_that_frames_have_are_kept_however_many) {
    constexpr int kFrames = 3000;
    for (std::size_t engine = 0; engine < kConcurrencies; ++engine) {
        Buffer buffer(engine_of(engine));
        for (int round = 0; round < 2; ++round) {
            for (int i = 0; i < kFrames; ++i)
                set(buffer, "map", std::to_string(i), round, pose_of(1), author_of(i + round));
        }
        for (int i = 0; i < kFrames; ++i)
            CHECK_EQ(buffer.frame_info(std::to_string(i)).authority, author_of(i + 1));
    }
}

TFDB_TEST(authorities_of_two_stores_are_not_mixed_up) {
    Buffer one(defaults());
    Buffer other(defaults());
    for (int i = 0; i < 500; ++i) {
        set(one, "map", "base", i, pose_of(1), author_of(i));
        set(other, "map", "base", i, pose_of(1), author_of(i + 1));
        CHECK_EQ(one.frame_info("base").authority, author_of(i));
        CHECK_EQ(other.frame_info("base").authority, author_of(i + 1));
    }
}

}  // namespace tfdb
