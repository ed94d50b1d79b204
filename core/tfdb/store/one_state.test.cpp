// Names and results come from one state: a frame that every state has is never unknown.
#include "tfdb/store/isolation.test.hpp"

namespace tfdb {
namespace {

using namespace isolation;

constexpr Concurrency kEngines[] = {
    Concurrency::kSnapshot, Concurrency::kGiant,     Concurrency::kFine, Concurrency::kNoWait,
    Concurrency::kWaitDie,  Concurrency::kWoundWait, Concurrency::kSilo};

constexpr StampNs kLast = 20;

/// map <- base <- tool, with samples from 1 to kLast; every state has them.
void build(Transaction& tx, double number) {
    const TransformView hand{"base", "tool", 0, pose_of(5)};
    for (const StampNs stamp : {StampNs{1}, kLast})
        put(tx, "map", "base", stamp, number);
    tx.set_transforms({&hand, 1}, true, "tx");
}

/// Removes base with its subtree and makes it again, in one commit.
void renew(Buffer& buffer, double number) {
    (void)until_committed(buffer, [&](Transaction& tx, bool) {
        tx.remove_frame("base", true);
        build(tx, number);
    });
}

/// Calls each read that names a frame. `handles`: those of an earlier state, or none.
void read_all(const StoreReader& reads, const FrameHandle (&handles)[2]) {
    Answer answer;
    Failure failure;
    for (const Question::Kind kind :
         {Question::kAt, Question::kCan, Question::kFull, Question::kLatest, Question::kCommonTime,
          Question::kCovered}) {
        Question question = store::by_way_of("base", "map", 7, "tool", 9, {});
        question.kind = kind;
        question.fixed.handle = handles[0];
        question.source.handle = handles[1];
        if (!reads.ask(question, answer, failure))
            reads.raise(failure, question);
    }
    CHECK_EQ(reads.lookup_transform("tool", "map").stamp, kLast);
    CHECK_EQ(reads.latest_common_time("map", "tool"), kLast);
    const CommonTimes times = reads.common_times("base", "map");
    CHECK(times.oldest == 1 && times.newest == kLast);
    CHECK(reads.parent_of("tool", 3) == "base" && reads.parent_of("base") == "map");
    CHECK_EQ(reads.frame_info("base").samples, 2U);
    CHECK_EQ(reads.samples("tool").poses.size(), 1U);
    CHECK_EQ(reads.tree().size(), 3U);
    CHECK_EQ(reads.path_stamps("map", "tool", {}, {}).size(), 2U);
    FrameHandle unused;
    CHECK(reads.find_frame("tool", unused));
    const std::vector<StampNs> stamps{3, 4, 5};
    std::vector<double> rows(7 * stamps.size());
    reads.lookup_many("map", "tool", stamps, {}, Layout::kPose, Missing::kThrow, rows);
    const Twist twist = reads.lookup_velocity("map", "tool", 4, 4, "base", {1, 2, 3}, "tool");
    CHECK(std::isfinite(twist.linear.x));
}

}  // namespace

TFDB_TEST(one_state_for_names_and_answers_while_frames_are_made_again) {
    constexpr int kRenewals = 300;
    for (const Concurrency engine : kEngines) {
        Buffer buffer(options_of(engine));
        (void)until_committed(buffer, [](Transaction& tx, bool) { build(tx, 1); });
        std::atomic<bool> done{false};
        const auto reader = [&] {
            FrameHandle handles[2];
            do {
                read_all(buffer, handles);
                if (engine != Concurrency::kFine)
                    read_all(buffer.snapshot(), handles);
                (void)buffer.find_frame("base", handles[0]);
                (void)buffer.find_frame("tool", handles[1]);
            } while (!done);
        };
        side_by_side({[&] {
                          for (int i = 0; i < kRenewals; ++i)
                              renew(buffer, i);
                          done = true;
                      },
                      reader, reader});
    }
}

TFDB_TEST(one_state_although_a_handle_was_found_in_an_earlier_one) {
    // A read whose names were resolved before a commit that makes the frames again.
    for (const Concurrency engine : kEngines) {
        Buffer buffer(options_of(engine));
        (void)until_committed(buffer, [](Transaction& tx, bool) { build(tx, 1); });
        FrameHandle before[2];
        CHECK(buffer.find_frame("base", before[0]) && buffer.find_frame("tool", before[1]));
        const Snapshot held = buffer.snapshot();
        renew(buffer, 2);
        FrameHandle after[2];
        CHECK(buffer.find_frame("base", after[0]) && buffer.find_frame("tool", after[1]));
        CHECK(!(after[0] == before[0]) && !(after[1] == before[1]));
        read_all(buffer, before);
        read_all(held, after);
        Answer answer;
        Failure failure;
        Question question = store::at_stamp("map", "base", 1, {});
        question.source.handle = before[0];
        CHECK(buffer.ask(question, answer, failure));
        CHECK(identical(answer.pose, pose_of(2)));
        // The next read may start with the handle that was found.
        CHECK(question.source.handle == after[0]);
        CHECK(held.ask(question, answer, failure));
        CHECK(identical(answer.pose, pose_of(1)));
        CHECK(question.source.handle == before[0]);
        // Without a name the handle alone counts, and its frame was removed.
        CHECK(!buffer.ask(store::at_stamp(before[0], before[0], 1, {}), answer, failure));
        CHECK(failure.code == ErrorCode::kUnknownFrame);
    }
}

TFDB_TEST(one_state_of_many_renewals_in_which_slots_change_hands) {
    BufferOptions options = options_of(Concurrency::kSnapshot);
    options.max_frames = 8;
    Buffer buffer(options);
    (void)until_committed(buffer, [](Transaction& tx, bool) { build(tx, 1); });
    FrameHandle handles[2];
    for (int i = 0; i < 50; ++i) {
        CHECK(buffer.find_frame("base", handles[0]) && buffer.find_frame("tool", handles[1]));
        for (int again = 0; again <= i % 5; ++again)
            renew(buffer, i);
        read_all(buffer, handles);
    }
}

}  // namespace tfdb
