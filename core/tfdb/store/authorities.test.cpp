// Names of authorities: their number is limited, and each frame has that of its last writer.
#include "tfdb/store/fixture.hpp"
#include "tfdb/store/transaction.hpp"

namespace tfdb {
namespace {

using namespace fixture;

/// A name of typical length.
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

TFDB_TEST(a_store_has_a_limited_number_of_authorities) {
    constexpr int kMost = 65'535;
    for (std::size_t engine = 0; engine < kConcurrencies; ++engine) {
        Buffer buffer(engine_of(engine));
        for (int i = 0; i < kMost; ++i)
            set(buffer, "map", i % 2 == 0 ? "left" : "right", i, pose_of(1), author_of(i));
        CHECK_THROWS_AS(set(buffer, "map", "left", kMost, pose_of(1), author_of(kMost)),
                        CapacityExceeded);
        Transaction tx(buffer);
        const TransformView batch[] = {{"map", "late", kMost, pose_of(2)}};
        tx.set_transforms(batch, false, author_of(kMost));
        CHECK_THROWS_AS(tx.commit(), CapacityExceeded);
        CHECK_EQ(buffer.frames().size(), std::size_t{3});
        set(buffer, "map", "left", kMost, pose_of(1), author_of(7));
        set(buffer, "map", "right", kMost, pose_of(1), "");
        CHECK_EQ(buffer.frame_info("left").authority, author_of(7));
        CHECK_EQ(buffer.frame_info("right").authority, "");
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
