// Enforced lifespans: every kind of read over an expired edge.
#include "tfdb/store/lifespans.hpp"

#include <array>
#include <cmath>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "tfdb/base/error.hpp"
#include "tfdb/store/buffer.hpp"
#include "tfdb/store/clock.hpp"
#include "tfdb/store/fixture.hpp"
#include "tfdb/store/question.hpp"
#include "tfdb/store/transaction.hpp"
#include "tfdb/testing/check.hpp"

namespace tfdb {
namespace {

using fixture::kSecond;
using fixture::pose_of;
using fixture::set;
using store::matches;

constexpr StampNs kStart = 1'000 * kSecond;
constexpr StampNs kPast = kStart - 2 * kSecond;

/// map <- odom <- base <- camera, and base <- arm; camera is static. `odom` is fresh, `base` not.
struct Robot {
    Robot() {
        buffer.clock().pause();
        buffer.clock().seek(kStart);
        for (const StampNs back : {3 * kSecond, kSecond}) {
            set(buffer, "map", "odom", kStart - back + kSecond, pose_of(1.0));
            set(buffer, "odom", "base", kStart - back, pose_of(2.0));
            set(buffer, "base", "arm", kStart - back, pose_of(3.0));
        }
        buffer.set_transform({"base", "camera", 0, pose_of(4.0)}, true, "test");
    }
    void enforce(std::vector<Lifespan> all) { buffer.enforce(all); }

    Buffer buffer{fixture::keeping(std::nullopt)};
};

/// The error of all kinds of lookups of T[map<-camera], or a part of it. Empty if they succeed.
template <class Asked>
std::optional<ErrorDetail> refusal(Asked& asked, const std::function<void(Asked&)>& lookup) {
    try {
        lookup(asked);
        return std::nullopt;
    } catch (const Stale& error) {
        return error.detail();
    }
}

template <class Asked>
std::vector<std::function<void(Asked&)>> ways() {
    return {
        [](Asked& a) { (void)a.lookup_transform("map", "camera"); },
        [](Asked& a) { (void)a.lookup_transform("camera", "map"); },
        [](Asked& a) { (void)a.lookup_transform("map", "camera", kPast); },
        [](Asked& a) { (void)a.lookup_transform("arm", "odom", kPast); },
        [](Asked& a) { (void)a.lookup_latest_transform("map", "camera"); },
        [](Asked& a) { (void)a.lookup_transform_full("map", kPast, "camera", kPast, "odom"); },
        [](Asked& a) { (void)a.lookup_transform_full("odom", kPast, "camera", kPast, "base"); },
        [](Asked& a) {
            (void)a.lookup_velocity("map", "camera", kPast, kSecond, {}, {0, 0, 0}, {});
        },
        [](Asked& a) {
            std::array<double, 14> rows{};
            const std::array<StampNs, 2> stamps{kPast, kPast};
            a.lookup_many("map", "camera", stamps, {}, Layout::kPose, Missing::kThrow, rows);
        },
        [](Asked& a) {
            std::array<double, 3> point{1, 2, 3};
            const std::array<StampNs, 1> stamp{kPast};
            a.transform_points("map", "camera", point.data(), 3, 1, stamp, {}, Missing::kThrow,
                               point.data(), 3);
        },
        [](Asked& a) {
            std::array<double, 14> rows{};
            std::array<FrameRef, 2> frames{FrameRef{.name = "odom"}, FrameRef{.name = "base"}};
            a.lookup_edges(frames, kPast, {}, Missing::kThrow, std::span<double>(rows));
        },
    };
}

template <class Asked>
void check_all(Asked& asked, bool refused) {
    for (const auto& way : ways<Asked>()) {
        const std::optional<ErrorDetail> found = refusal<Asked>(asked, way);
        CHECK_EQ(found.has_value(), refused);
        if (!found)
            continue;
        CHECK_EQ(found->edge, std::string("base"));
        CHECK_EQ(found->parent, std::string("odom"));
        CHECK_EQ(found->expectation, std::string("odom -> *"));
        CHECK_EQ(found->stamp.value_or(0), kStart);
        CHECK_EQ(found->newest.value_or(0), kStart - kSecond);
        CHECK_EQ(found->limit.value_or(0), kSecond / 2);
    }
    CHECK_EQ(store::can_answer(asked,
                               [] {
                                   Question question =
                                       store::by_name(Question::kCan, "camera", "map");
                                   question.stamp = kStart - 2 * kSecond;
                                   return question;
                               }()),
             !refused);
}

const Lifespan kShort{"odom", "*", kSecond / 2, "odom -> *"};

}  // namespace

TFDB_TEST(lifespans_match_names_with_stars) {
    CHECK(matches("base", "base"));
    CHECK(!matches("base", "bas"));
    CHECK(!matches("bas", "base"));
    CHECK(matches("*", ""));
    CHECK(matches("*", "anything"));
    CHECK(matches("wheel_*", "wheel_"));
    CHECK(matches("*_link", "left_link"));
    CHECK(!matches("*_link", "left_links"));
    CHECK(matches("a*b*c", "a_b_b_c"));
    CHECK(!matches("a*b*c", "a_c_b"));
    CHECK(matches("**a", "aaa"));
    CHECK(!matches("", "a"));
    CHECK(matches("", ""));
    CHECK(matches("a.c", "a.c"));
    CHECK(!matches("a.c", "abc"));
}

TFDB_TEST(lifespans_come_from_the_first_that_matches) {
    const std::vector<Lifespan> all{{"odom", "base", 1, "1"},
                                    {"*", "wheel*", 2, "2"},
                                    {"o*", "base", 3, "3"},
                                    {"*", "*", 4, "4"}};
    const store::Lifespans lifespans(all);
    const auto limit = [&](const char* parent, const char* child) {
        const Lifespan* const found = lifespans.of(parent, child);
        return found == nullptr ? 0 : found->limit;
    };
    CHECK_EQ(limit("odom", "base"), 1);
    CHECK_EQ(limit("odom2", "base"), 3);
    CHECK_EQ(limit("map", "base"), 4);
    CHECK_EQ(limit("odom", "wheel_left"), 2);
    CHECK_EQ(limit("a", "b"), 4);
    CHECK(store::Lifespans(std::span(all).first(1)).of("odom", "wheel") == nullptr);
}

TFDB_TEST(lifespans_refuse_every_lookup_over_an_old_edge) {
    Robot robot;
    const Snapshot before = robot.buffer.snapshot();
    check_all<const StoreReader>(robot.buffer, false);
    robot.enforce({kShort});
    check_all<const StoreReader>(robot.buffer, true);
    check_all<const StoreReader>(before, true);
    {
        Transaction transaction(robot.buffer);
        check_all(transaction, true);
    }
    robot.enforce({});
    check_all<const StoreReader>(robot.buffer, false);
}

TFDB_TEST(lifespans_leave_paths_without_old_edges_alone) {
    Robot robot;
    robot.enforce({kShort, {"base", "camera", 1, "static"}});
    (void)robot.buffer.lookup_transform("map", "odom", kStart - 2 * kSecond);
    (void)robot.buffer.lookup_transform("base", "camera");
    (void)robot.buffer.lookup_transform("base", "arm");
    (void)robot.buffer.lookup_transform("camera", "camera");
    CHECK_EQ(robot.buffer.latest_common_time("map", "camera"), kStart - kSecond);
}

TFDB_TEST(lifespans_end_at_the_very_nanosecond) {
    Robot robot;
    robot.enforce({{"odom", "base", kSecond, "odom -> base"}});
    (void)robot.buffer.lookup_transform("map", "base");
    robot.buffer.clock().seek(kStart + 1);
    CHECK_THROWS_AS(robot.buffer.lookup_transform("map", "base"), Stale);
    set(robot.buffer, "odom", "base", kStart, pose_of(5.0));
    (void)robot.buffer.lookup_transform("map", "base");
}

TFDB_TEST(lifespans_make_rows_nan_where_missing_ones_are) {
    Robot robot;
    robot.enforce({kShort});
    const std::vector<StampNs> stamps(100, kStart - 2 * kSecond);
    std::vector<double> rows(7 * stamps.size(), 0.0);
    robot.buffer.lookup_many("map", "base", stamps, {}, Layout::kPose, Missing::kNan, rows);
    for (const double number : rows)
        CHECK(std::isnan(number));
    std::array<FrameRef, 2> frames{FrameRef{.name = "odom"}, FrameRef{.name = "base"}};
    std::array<double, 14> edges{};
    robot.buffer.lookup_edges(frames, std::nullopt, {}, Missing::kNan, std::span<double>(edges));
    CHECK_EQ(edges[0], 1.0);
    CHECK(std::isnan(edges[7]));
}

TFDB_TEST(lifespans_hold_in_every_engine) {
    for (const Concurrency engine :
         {Concurrency::kSnapshot, Concurrency::kGiant, Concurrency::kFine, Concurrency::kSilo}) {
        BufferOptions options;
        options.concurrency = engine;
        Buffer buffer(options);
        buffer.clock().pause();
        buffer.clock().seek(kStart);
        set(buffer, "odom", "base", kStart - kSecond, pose_of(2.0));
        buffer.enforce(std::vector{kShort});
        CHECK_THROWS_AS(buffer.lookup_transform("odom", "base"), Stale);
        Transaction transaction(buffer);
        CHECK_THROWS_AS(transaction.lookup_transform("base", "odom"), Stale);
        const std::array<TransformView, 1> own{TransformView{"odom", "base", kStart, pose_of(3.0)}};
        transaction.set_transforms(own, false, "test");
        CHECK_EQ(fixture::number_of(transaction.lookup_transform("odom", "base").pose), 3.0);
        transaction.commit();
        (void)buffer.lookup_transform("odom", "base");
    }
}

TFDB_TEST(lifespans_keep_a_wait_waiting) {
    if (fixture::engine() != Concurrency::kSnapshot) {
        testing::count_check();
        return;
    }
    Robot robot;
    robot.enforce({kShort});
    const Question question = store::by_name(Question::kAt, "map", "camera");
    CHECK(!robot.buffer.wait_for(question, 0));
    const std::uint64_t number = robot.buffer.begin_wait(question);
    CHECK(number != 0);
    set(robot.buffer, "odom", "base", kStart, pose_of(5.0));
    const std::vector<EndedWait> ended = robot.buffer.ended_waits(std::nullopt);
    CHECK_EQ(ended.size(), std::size_t{1});
    CHECK_EQ(ended[0].number, number);
}

}  // namespace tfdb
