// The change feed: the complete effect of each commit, in order, at any age.
#include <atomic>
#include <random>
#include <thread>

#include "tfdb/store/transaction_fixture.test.hpp"
#include "tfdb/testing/sanitized.hpp"

namespace tfdb {
namespace {

using namespace fixture;
using Names = std::vector<std::string>;

/// True, for the test to end there, in engines that keep no feed.
bool skipped() {
    return skipped_in({Concurrency::kFine, Concurrency::kNoWait, Concurrency::kWaitDie,
                       Concurrency::kWoundWait, Concurrency::kSilo},
                      "it keeps no feed");
}

/// The one commit after `since`.
Changes only(const Buffer& buffer, CommitNumber since) {
    const std::vector<Changes> all = buffer.changes(since);
    CHECK_EQ(all.size(), std::size_t{1});
    return all.empty() ? Changes{} : all.front();
}

/// Applies a record like a follower; stores the members of one commit together.
void follow(Buffer& replica, const Changes& changes) {
    if (!changes.cleared.empty() && changes.stored.empty())
        replica.clear();
    for (const bool is_static : {false, true}) {
        std::vector<TransformView> batch;
        for (const auto& edge : changes.stored) {
            for (std::size_t i = 0; i < edge.poses.size() && edge.is_static == is_static; ++i)
                batch.push_back({edge.parents[i], edge.child, std::max<StampNs>(edge.stamps[i], 0),
                                 edge.poses[i]});
        }
        replica.set_transforms(batch, is_static, "", {.change_kind = true});
    }
    const std::vector<std::string_view> removed(changes.removed.begin(), changes.removed.end());
    replica.remove_frames(removed, false);
}

/// Frames, parents and samples are the same, bit for bit.
void check_same(const Buffer& left, const Buffer& right) {
    CHECK(left.frames() == right.frames());
    for (const std::string& name : left.frames()) {
        const Samples a = left.samples(name);
        const Samples b = right.samples(name);
        CHECK(a.stamps == b.stamps);
        CHECK(a.parents == b.parents);
        CHECK_EQ(a.poses.size(), b.poses.size());
        for (std::size_t i = 0; i < std::min(a.poses.size(), b.poses.size()); ++i)
            CHECK(identical(a.poses[i], b.poses[i]));
        CHECK(left.parent_of(name) == right.parent_of(name));
    }
}

// Random writes, removals and clears over a few names.
// One thread; the same seed does the same.
class Writer {
public:
    explicit Writer(std::uint64_t seed) : random_(seed) {}

    void act(Buffer& buffer) {
        clock_ += static_cast<StampNs>(below(5));
        try {
            const std::uint64_t chance = below(20);
            if (chance == 0) {
                buffer.clear();
            } else if (chance < 4) {
                buffer.remove_frame(name(), below(2) == 0);
            } else {
                write(buffer, chance < 6);
            }
        } catch (const Error&) {
            ++refused_;  // it leaves no trace in the feed either
        }
    }
    [[nodiscard]] std::uint64_t refused() const { return refused_; }
    std::uint64_t below(std::uint64_t limit) { return random_() % limit; }

private:
    std::string name() { return "frame" + std::to_string(below(7)); }
    void write(Buffer& buffer, bool is_static) {
        std::vector<std::pair<std::string, std::string>> names(1 + below(4));
        std::vector<TransformView> batch;
        const std::uint64_t first = below(7);
        for (auto& [parent, child] : names) {
            parent = name();
            // Each frame once: a frame that only a replaced member names has no sample.
            child = "frame" + std::to_string((first + batch.size()) % 7);
            const StampNs late = below(4) == 0 ? static_cast<StampNs>(below(30)) : 0;
            batch.push_back({parent, child, std::max<StampNs>(0, clock_ - late),
                             pose_of(static_cast<double>(++number_))});
        }
        buffer.set_transforms(batch, is_static, "", {.change_kind = below(3) == 0});
    }

    std::mt19937_64 random_;
    StampNs clock_ = 100;
    std::uint64_t number_ = 0;
    std::uint64_t refused_ = 0;
};

}  // namespace

TFDB_TEST(changes_tell_what_a_commit_did) {
    if (skipped())
        return;
    Buffer buffer(defaults());
    CHECK(buffer.changes(0).empty());
    const TransformView batch[] = {{"map", "odom", 20, pose_of(2)},
                                   {"map", "odom", 10, pose_of(1)},
                                   {"odom", "base", 20, pose_of(3)}};
    buffer.set_transforms(batch, false, "");
    const Changes first = only(buffer, 0);
    CHECK_EQ(first.commit, CommitNumber{1});
    CHECK(first.made == Names({"map", "odom", "base"}));
    CHECK(first.moved.empty() && first.cleared.empty() && first.removed.empty());
    CHECK_EQ(first.stored.size(), std::size_t{2});
    CHECK_EQ(first.stored[0].child, "odom");
    CHECK(first.stored[0].stamps == std::vector<StampNs>({10, 20}));
    CHECK(first.stored[0].parents == Names({"map", "map"}));
    CHECK(identical(first.stored[0].poses[1], buffer.samples("odom").poses[1]));

    set(buffer, "map", "base", 30, pose_of(4));
    CHECK(only(buffer, 1).moved == Names({"base"}));
    buffer.set_transform({"map", "base", 0, pose_of(5)}, true, "", {.change_kind = true});
    const Changes fixed = only(buffer, 2);
    CHECK(fixed.cleared == Names({"base"}) && fixed.moved.empty());
    CHECK(fixed.stored.at(0).is_static);
    CHECK(fixed.stored[0].stamps == std::vector<StampNs>({-1}));
    buffer.clear();
    const Changes cleared = only(buffer, 3);
    CHECK(cleared.cleared == Names({"odom"}) && cleared.moved == Names({"odom"}));
    CHECK(cleared.stored.empty());
    buffer.remove_frame("base", false);
    CHECK(only(buffer, 4).removed == Names({"base"}));
    CHECK_EQ(buffer.changes(0).size(), std::size_t{5});
    const auto two = buffer.changes(1, 2);
    CHECK(two.size() == 2 && two[0].commit == 2 && two[1].commit == 3);
}

TFDB_TEST(changes_count_what_is_gone_and_keep_names) {
    if (skipped())
        return;
    Buffer buffer(keeping(100));
    set_static(buffer, "arm", "tool", pose_of(1));
    set_static(buffer, "arm", "tool", pose_of(2));
    set(buffer, "map", "odom", 10, pose_of(3));
    buffer.remove_frame("odom", false);
    set(buffer, "map", "other", 10, pose_of(4));  // in the slot of the one that is gone
    const auto all = buffer.changes(0);
    CHECK(all[0].stored.at(0).gone + all[0].stored[0].poses.size() == 1);
    CHECK(all[1].stored.at(0).gone == 0);
    CHECK(identical(all[1].stored[0].poses.at(0), buffer.samples("tool").poses[0]));
    CHECK(all[2].made == Names({"map", "odom"}));
    CHECK_EQ(all[2].stored.at(0).child, "odom");
    CHECK(all[2].stored[0].gone == 1 && all[2].stored[0].poses.empty());
    CHECK(all[3].removed == Names({"odom"}));
    CHECK(all[4].made == Names({"other"}));
}

TFDB_TEST(changes_count_the_samples_of_any_batch) {
    if (skipped())
        return;
    for (const std::size_t count : {1, 2, 63, 64, 65, 66, 129, 300}) {
        for (const StampNs late : {0, 1, 40, 1000}) {
            for (const std::size_t twice : {1, 2}) {  // how often each stamp comes
                Buffer buffer(defaults());
                for (const StampNs stamp : {500, 600, 700})
                    set(buffer, "map", "odom", stamp, pose_of(1));
                std::vector<TransformView> batch;
                for (std::size_t i = 0; i < count * twice; ++i)
                    batch.push_back(
                        {"map", "odom", 701 - late + static_cast<StampNs>(i / twice), pose_of(2)});
                for (TransformView& member : batch)
                    member.stamp = std::max<StampNs>(0, member.stamp + (late > 700 ? 300 : 0));
                buffer.set_transforms(batch, false, "");
                const Changes changes = only(buffer, 3);
                CHECK_EQ(changes.stored.at(0).gone, std::uint64_t{0});
                CHECK_EQ(changes.stored[0].poses.size(), count);
                buffer.set_transforms(batch, true, "", {.change_kind = true});
                const Changes fixed = only(buffer, 4);
                CHECK(fixed.cleared == Names({"odom"}));
                CHECK(fixed.stored.at(0).gone == 0 && fixed.stored[0].poses.size() == 1);
            }
        }
    }
}

TFDB_TEST(changes_are_whole_while_a_snapshot_is_held) {
    if (skipped())
        return;
    Buffer buffer(keeping(100));
    set(buffer, "map", "odom", 0, pose_of(1));
    const Snapshot held = buffer.snapshot();
    for (int i = 1; i <= 40; ++i) {
        set(buffer, "map", "odom", 1000 * i, pose_of(i));
        set(buffer, "map", "odom", 1000 * i, pose_of(i + 0.5));
        set_static(buffer, "arm", "tool", pose_of(i));
        if (i % 8 == 0)
            buffer.clear();
        if (i % 16 == 0)
            buffer.remove_frame("odom", false);
    }
    std::uint64_t told = 0;
    for (const Changes& changes : buffer.changes(held.commit())) {
        for (const auto& edge : changes.stored) {
            CHECK_EQ(edge.gone, std::uint64_t{0});
            told += edge.poses.size();
        }
    }
    CHECK_EQ(told, std::uint64_t{120});
}

TFDB_TEST(changes_are_whole_while_writers_overtake_who_asks) {
    if (skipped())
        return;
    Buffer buffer(keeping(std::nullopt));
    std::atomic<bool> stop = false;
    std::thread writer([&] {
        std::mt19937 random(1);
        for (int i = 1; !stop; ++i) {
            const std::string name = "f" + std::to_string(random() % 3);
            for (int k = 0; k < 20; ++k)
                set(buffer, "map", name, static_cast<StampNs>(random() % 500), pose_of(i));
            if (i % 4 == 0)
                buffer.remove_frame(name, false);
        }
    });
    for (int whole = 0; whole < 10;) {
        const Snapshot held = buffer.snapshot();
        while (buffer.commit() < held.commit() + 1'000)
            std::this_thread::yield();
        try {
            for (const Changes& changes : buffer.changes(held.commit())) {
                for (const auto& edge : changes.stored)
                    CHECK_EQ(edge.gone, std::uint64_t{0});
            }
            ++whole;
        } catch (const FeedLapped&) {
            continue;  // the machine gave this thread its turn too late
        }
    }
    stop = true;
    writer.join();
}

TFDB_TEST(changes_tell_of_frames_that_a_transaction_made_and_removed) {
    if (skipped())
        return;
    Buffer buffer(defaults());
    set(buffer, "map", "base", 50, pose_of(1));
    Transaction tx(buffer);
    put(tx, "ghost", "base", 10, 2);
    tx.remove_frame("ghost", false);
    tx.commit();
    const Changes changes = only(buffer, 1);
    CHECK(changes.passing == Names({"ghost"}));
    CHECK(changes.made.empty() && changes.removed.empty() && changes.moved.empty());
    CHECK(changes.stored.at(0).parents == Names({"ghost"}));
}

TFDB_TEST(changes_replayed_are_the_same_store) {
    if (skipped())
        return;
    constexpr std::uint64_t kSeeds = 12;
    std::uint64_t commits = 0;
    std::uint64_t refused = 0;
    for (std::uint64_t seed = 1; seed <= kSeeds; ++seed) {
        Writer writer(seed);
        const auto history = seed % 2 == 0 ? std::optional<StampNs>(60) : std::nullopt;
        Buffer buffer(keeping(history));
        Buffer replica(keeping(history));
        CommitNumber since = 0;
        for (int round = 0; round < 60; ++round) {
            const Snapshot held = buffer.snapshot();
            for (std::uint64_t left = writer.below(12); left > 0; --left)
                writer.act(buffer);
            for (const Changes& changes : buffer.changes(since)) {
                CHECK_EQ(changes.commit, ++since);
                follow(replica, changes);
            }
            CHECK_EQ(since, buffer.commit());
            check_same(buffer, replica);
        }
        commits += since;
        refused += writer.refused();
    }
    std::printf("  seeds 1..%llu, %llu commits, %llu refused\n",
                static_cast<unsigned long long>(kSeeds), static_cast<unsigned long long>(commits),
                static_cast<unsigned long long>(refused));
    CHECK(commits > 1000 && refused > 100);
}

TFDB_TEST(changes_that_were_overwritten_are_refused) {
    if (skipped())
        return;
    Buffer buffer(defaults());
    std::vector<std::string> names;
    for (int i = 0; i < 2000; ++i)
        names.push_back("frame" + std::to_string(i));
    std::vector<TransformView> batch;
    for (const auto& name : names)
        batch.push_back({"map", name, 1, pose_of(1)});
    // About 30 of them fill the ring.
    for (StampNs stamp = 1; stamp <= 80; ++stamp) {
        for (auto& member : batch)
            member.stamp = stamp;
        buffer.set_transforms(batch, false, "");
    }
    const auto lapped = THROWN(FeedLapped, buffer.changes(3));
    CHECK(lapped && lapped->detail().since == 3U && lapped->detail().newest == 80);
    CHECK(says(*lapped, "take a snapshot"));
    CHECK(lapped && says(*lapped, "go on from " + std::to_string(*lapped->detail().commit)));
    CHECK(lapped && lapped->detail().commit == 80 - (80 - lapped->detail().oldest.value()) / 2);
    const auto oldest = static_cast<CommitNumber>(lapped->detail().oldest.value());
    CHECK(oldest > 40 && oldest < 60);
    const auto rest = buffer.changes(oldest);
    CHECK_EQ(rest.size(), 80 - oldest);
    for (const Changes& changes : rest)
        CHECK(changes.stored.size() == 2000 && changes.stored[7].gone == 0);
    THROWN(FeedLapped, buffer.changes(oldest - 1));
    // Commits without samples also fill the feed.
    for (StampNs stamp = 100; stamp < 16'600; ++stamp)
        set(buffer, "map", "frame0", stamp, pose_of(2));
    CHECK_EQ(buffer.changes(buffer.commit() - 16'000).size(), std::size_t{16'000});
    THROWN(FeedLapped, buffer.changes(buffer.commit() - 16'400));
}

TFDB_TEST(changes_go_on_from_the_commit_that_the_error_names) {
    if (skipped())
        return;
    Buffer buffer(defaults());
    set(buffer, "map", "base", 1, pose_of(1));
    std::atomic<bool> ended{false};
    std::thread writer([&] {
        for (StampNs stamp = 2; !ended.load(); ++stamp)
            set(buffer, "map", "base", stamp, pose_of(2));
    });
    // If it resumes at the oldest commit, the feed overruns it again, thousands of times.
    constexpr CommitNumber kEnough = testing::rounds(300'000);
    constexpr int kMostLaps = testing::rounds(3'000);
    CommitNumber seen = 0;
    CommitNumber followed = 0;
    int laps = 0;
    while (followed < kEnough && laps < kMostLaps) {
        try {
            for (const Changes& changes : buffer.changes(seen)) {
                CHECK_EQ(changes.commit, seen + 1);
                seen = changes.commit;
                ++followed;
            }
        } catch (const FeedLapped& lapped) {
            const ErrorDetail& detail = lapped.detail();
            const CommitNumber resume = detail.commit.value();
            CHECK(resume > seen && detail.oldest < resume && resume <= detail.newest);
            seen = resume;
            ++laps;
        }
    }
    ended.store(true);
    writer.join();
    CHECK(followed >= kEnough);
}

TFDB_TEST(changes_of_a_commit_larger_than_the_feed_are_lapped) {
    if (skipped())
        return;
    Buffer buffer(defaults());
    std::vector<std::string> names;
    for (int i = 0; i < 66'000; ++i)
        names.push_back(std::to_string(i));
    std::vector<TransformView> batch;
    for (const auto& name : names)
        batch.push_back({"map", name, 1, pose_of(1)});
    set(buffer, "map", "odom", 1, pose_of(1));
    buffer.set_transforms(batch, true, "");
    THROWN(FeedLapped, buffer.changes(0));
    THROWN(FeedLapped, buffer.changes(1));
    CHECK(buffer.changes(2).empty());
    set(buffer, "map", "odom", 2, pose_of(2));
    CHECK_EQ(only(buffer, 2).stored.at(0).child, "odom");
}

TFDB_TEST(changes_are_asked_for_with_sense) {
    Buffer buffer(defaults());
    set(buffer, "map", "odom", 1, pose_of(1));
    if (engine() != Concurrency::kSnapshot && engine() != Concurrency::kGiant) {
        const auto error = THROWN(NotSupported, buffer.changes(0));
        CHECK(error && says(*error, concurrency_name(engine())));
        return;
    }
    const auto error = THROWN(InvalidArgument, buffer.changes(2));
    CHECK(error && says(*error, "no commit 2 yet"));
    Transaction tx(buffer);
    put(tx, "map", "odom", 2, 2);
    THROWN(TransactionActive, buffer.changes(0));
}

TFDB_TEST(changes_name_the_writer_of_each_edge_also_of_older_commits) {
    if (skipped())
        return;
    Buffer buffer(defaults());
    set(buffer, "map", "base", 10, pose_of(1), "odometry");
    set(buffer, "map", "base", 20, pose_of(2), "");
    Transaction tx(buffer);
    const TransformView base[] = {{"map", "base", 30, pose_of(3)}};
    const TransformView arm[] = {{"base", "arm", 30, pose_of(4)}, {"base", "arm", 40, pose_of(5)}};
    tx.set_transforms(base, false, "filter");
    tx.set_transforms(arm, false, "joints");
    tx.commit();
    std::vector<std::string> writers;
    for (const Changes& changes : buffer.changes(0)) {
        for (const auto& edge : changes.stored)
            writers.push_back(std::to_string(changes.commit) + edge.child + ":" + edge.authority);
    }
    CHECK(writers == Names({"1base:odometry", "2base:", "3arm:joints", "3base:filter"}));
}

TFDB_TEST(changes_of_some_frames_leave_out_all_others) {
    if (skipped())
        return;
    constexpr int kCommits = 400;
    for (std::uint64_t seed = 1; seed <= 4; ++seed) {
        Buffer buffer(defaults());
        Writer writer(seed);
        for (int i = 0; i < kCommits; ++i)
            writer.act(buffer);
        const std::string_view wanted[] = {"frame1", "frame4", "none"};
        const auto is_wanted = [&](const std::string& name) {
            return std::find(std::begin(wanted), std::end(wanted), name) != std::end(wanted);
        };
        const auto keep = [&](Names& names) {
            std::erase_if(names, [&](const std::string& name) { return !is_wanted(name); });
            return !names.empty();
        };
        std::vector<Changes> expected;
        for (Changes changes : buffer.changes(0)) {
            std::erase_if(changes.stored, [&](const auto& edge) { return !is_wanted(edge.child); });
            bool any = !changes.stored.empty();
            for (Names* names : {&changes.made, &changes.moved, &changes.cleared, &changes.removed,
                                 &changes.passing})
                any = keep(*names) || any;
            if (any)
                expected.push_back(std::move(changes));
        }
        const auto check_expected = [&](const std::vector<Changes>& found) {
            CHECK_EQ(found.size(), expected.size());
            for (std::size_t i = 0; i < std::min(found.size(), expected.size()); ++i) {
                CHECK_EQ(found[i].commit, expected[i].commit);
                CHECK_EQ(found[i].stored.size(), expected[i].stored.size());
                for (std::size_t k = 0; k < found[i].stored.size(); ++k) {
                    CHECK_EQ(found[i].stored[k].child, expected[i].stored[k].child);
                    CHECK(found[i].stored[k].stamps == expected[i].stored[k].stamps);
                }
                CHECK(found[i].made == expected[i].made);
                CHECK(found[i].moved == expected[i].moved);
                CHECK(found[i].cleared == expected[i].cleared);
                CHECK(found[i].removed == expected[i].removed);
            }
        };
        CHECK(expected.size() > 50);
        check_expected(buffer.changes(0, Buffer::kNoLimit, wanted));
        for (const std::size_t limit : {1, 3, 20}) {
            std::vector<Changes> pages;
            for (bool more = true; more;) {
                const CommitNumber last = pages.empty() ? 0 : pages.back().commit;
                const std::vector<Changes> page = buffer.changes(last, limit, wanted);
                CHECK(page.size() <= limit);
                more = page.size() == limit;
                pages.insert(pages.end(), page.begin(), page.end());
            }
            check_expected(pages);
        }
    }
}

TFDB_TEST(changes_of_names_that_no_frame_can_have_are_refused) {
    if (skipped())
        return;
    Buffer buffer(defaults());
    set(buffer, "map", "base", 1, pose_of(1.0));
    const std::string_view empty[] = {"base", ""};
    const std::string_view missing[] = {"not there yet"};
    CHECK_THROWS_AS(buffer.changes(0, 1, empty), InvalidName);
    CHECK_THROWS_AS(buffer.commits_bytes(0, {}, empty), InvalidName);
    CHECK_THROWS_AS(buffer.snapshot().state_bytes(empty), InvalidName);
    CHECK(buffer.changes(0, 1, missing).empty());
}

}  // namespace tfdb
