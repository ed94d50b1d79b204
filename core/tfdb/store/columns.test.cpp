// Columns of one edge, compared with the same samples one by one: both have the same effect.
#include <cstdio>
#include <cstring>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "tfdb/store/fixture.hpp"

namespace tfdb {
namespace {

using namespace fixture;

/// A column for each field, and the other arguments of the write.
struct Given {
    std::string parent = "map";
    std::string child = "base";
    std::vector<StampNs> stamps;
    std::vector<Pose> poses;
    WriteRules rules;

    [[nodiscard]] EdgeColumns columns() const { return {parent, child, stamps, poses}; }
    [[nodiscard]] WriteRequest request(const EdgeColumns& columns) const {
        return {.columns = &columns, .authority = "columns", .rules = rules};
    }
    [[nodiscard]] std::vector<TransformView> members() const {
        std::vector<TransformView> members;
        for (std::size_t i = 0; i < stamps.size(); ++i)
            members.push_back({parent, child, stamps[i], poses[i]});
        return members;
    }
};

/// All frames of a store, with their poses bit for bit, and its counters.
std::string picture(const Buffer& buffer) {
    std::string text = std::to_string(buffer.commit()) + " " +
                       std::to_string(buffer.memory().samples) + " " +
                       std::to_string(buffer.counters().normalised);
    for (const FrameInfo& info : buffer.tree()) {
        text += "\n" + info.name + " " + info.parent.value_or("-") + " " + info.authority + " " +
                std::to_string(info.late);
        const Samples samples = buffer.samples(info.name);
        for (std::size_t i = 0; i < samples.poses.size(); ++i) {
            text += " " + std::to_string(samples.stamps[i]) + samples.parents[i];
            text.append(reinterpret_cast<const char*>(&samples.poses[i]), sizeof(Pose));
        }
    }
    return text;
}

std::string words_of(const std::vector<RefusedMember>& refused) {
    std::string text;
    for (const RefusedMember& member : refused) {
        text += std::to_string(member.index) + " " + std::to_string(static_cast<int>(member.code)) +
                " " + member.message + "\n";
    }
    return text;
}

/// Result of a write: its commit, or its error with all refused members.
template <class Write>
std::string outcome(Write&& write) {
    try {
        return std::to_string(write());
    } catch (const Error& error) {
        return std::string(error.what()) + "\n" + words_of(error.detail().refused);
    }
}

/// map <- base moves from 40 s to 47 s, arm had two parents, map <- mark is static.
Buffer robot(std::optional<std::size_t> memory_limit = std::nullopt) {
    BufferOptions options = keeping(10 * kSecond);
    options.memory_limit = memory_limit;
    Buffer buffer(options);
    for (StampNs stamp = 40; stamp < 48; ++stamp) {
        set(buffer, "map", "base", stamp * kSecond, pose_of(1), "driver");
        set(buffer, stamp % 2 == 0 ? "map" : "base", "arm", stamp * kSecond, pose_of(2));
    }
    set_static(buffer, "map", "mark", pose_of(3));
    return buffer;
}

void same_both_ways(const Given& given, std::optional<std::size_t> memory_limit = std::nullopt) {
    Buffer whole = robot(memory_limit);
    Buffer single = robot(memory_limit);
    const EdgeColumns columns = given.columns();
    const std::string said = outcome([&] { return whole.write(given.request(columns)).commit; });
    CHECK(said == outcome([&] {
              return single.set_transforms(given.members(), false, "columns", given.rules);
          }));
    CHECK(picture(whole) == picture(single));
    Buffer tried = robot(memory_limit);
    CHECK(said == outcome([&] {
              WriteRequest request = given.request(columns);
              request.wait = false;
              const WriteResult result = tried.write(request);
              CHECK(!result.busy);
              return result.commit;
          }));
    CHECK(picture(tried) == picture(single));

    Buffer some = robot(memory_limit);
    Buffer some_single = robot(memory_limit);
    const auto partial = [&](Buffer& buffer, WriteRequest request) {
        request.partial = true;
        std::string refused;
        const std::string stored = outcome([&] {
            const WriteResult result = buffer.write(request);
            refused = words_of(result.refused);
            return result.commit;
        });
        return stored + refused;
    };
    const std::vector<TransformView> members = given.members();
    WriteRequest one_by_one = given.request(columns);
    one_by_one.columns = nullptr;
    one_by_one.transforms = members;
    CHECK(partial(some, given.request(columns)) == partial(some_single, one_by_one));
    CHECK(picture(some) == picture(some_single));
}

/// Valid columns that begin at a stamp.
Given plain(std::size_t rows, StampNs first = 48 * kSecond, StampNs step = 1'000'000) {
    Given given;
    for (std::size_t i = 0; i < rows; ++i) {
        given.stamps.push_back(first + static_cast<StampNs>(i) * step);
        given.poses.push_back(pose_of(static_cast<double>(i % 977)));
    }
    return given;
}

}  // namespace

TFDB_TEST(columns_store_what_one_by_one_stores) {
    for (const std::size_t rows : {1, 2, 8, 63, 64, 65, 255, 256, 257, 3000})
        same_both_ways(plain(rows));
    same_both_ways(plain(600, 48 * kSecond, 100'000'000));  // longer than the history
    same_both_ways(plain(0));
    for (const char* const child : {"arm", "mark", "new"}) {
        Given given = plain(300);
        given.child = child;
        same_both_ways(given);
        given.parent = "base";
        same_both_ways(given);
        given.parent = "other";
        given.rules.change_kind = true;
        same_both_ways(given);
    }
}

TFDB_TEST(columns_are_refused_as_one_by_one) {
    constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
    for (const std::size_t at : {0, 1, 63, 64, 299}) {
        Given given = plain(300);
        given.poses[at].translation.y = kNan;
        same_both_ways(given);
        given = plain(300);
        given.poses[at].rotation.w = kNan;
        same_both_ways(given);
        given.poses[at].rotation = {0.0, 0.0, 0.0, 0.0};
        same_both_ways(given);
        given.poses[at].rotation = {0.0, 0.0, 0.6, 0.8000001};  // normalised, and counted
        same_both_ways(given);
        for (const StampNs stamp :
             {StampNs{-1}, clock::kMaxStamp + 1, StampNs{40} * kSecond, StampNs{30} * kSecond,
              StampNs{47} * kSecond, given.stamps[5]}) {
            given = plain(300);
            given.stamps[at] = stamp;
            same_both_ways(given);
            given.rules.only_new = true;
            same_both_ways(given);
        }
    }
    for (const char* const name : {"", "a\tb", "base", "\xFF"}) {
        Given given = plain(70);
        given.parent = name;
        same_both_ways(given);
    }
    Given circle = plain(70);
    circle.parent = "base";
    circle.child = "map";
    same_both_ways(circle);
    Given uneven = plain(7);
    uneven.poses.pop_back();
    Buffer buffer = robot();
    const EdgeColumns columns = uneven.columns();
    CHECK_THROWS_AS(buffer.write(uneven.request(columns)), InvalidArgument);
    CHECK_EQ(buffer.commit(), robot().commit());
}

TFDB_TEST(columns_that_find_no_memory_store_nothing) {
    Given given = plain(20'000, 48 * kSecond, 10);
    same_both_ways(given, std::size_t{1} << 20);
    given.poses[19'000].rotation.x = 3.0;  // what is wrong with a member is said first
    same_both_ways(given, std::size_t{1} << 20);
}

TFDB_TEST(columns_of_any_kind_do_as_one_by_one) {
    constexpr unsigned kSeed = 20;
    std::printf("  seed %u\n", kSeed);
    std::mt19937 random(kSeed);
    const char* const names[] = {"map", "base", "arm", "mark", "new"};
    for (int round = 0; round < 200; ++round) {
        Given given = plain(random() % 400, (44 + random() % 6) * kSecond);
        given.parent = names[random() % std::size(names)];
        given.child = names[random() % std::size(names)];
        given.rules = {random() % 4 == 0, random() % 4 == 0};
        for (auto flaws = random() % 3; flaws > 0 && !given.stamps.empty(); --flaws) {
            const std::size_t at = random() % given.stamps.size();
            given.stamps[at] += static_cast<StampNs>(random() % 20) * 500'000 - 5'000'000;
            given.poses[random() % given.poses.size()].rotation.z += random() % 2 == 0 ? 0.0 : 1.0;
        }
        same_both_ways(given);
    }
}

}  // namespace tfdb
