// One edge through its writer and its views: growth, eviction, late samples, taking back.
#include <algorithm>
#include <cstdio>
#include <map>

#include "tfdb/history/edge_fixture.hpp"
#include "tfdb/testing/sanitized.hpp"

namespace tfdb::history {
namespace {

using fixture::Edge;
using fixture::kClearMarker;
using fixture::View;

/// Asks some old snapshots and the newest one. Gives how many could still be read.
int check_snapshots(Edge& edge, std::mt19937& random, StampNs least, StampNs most) {
    std::uniform_int_distribution<StampNs> stamp(least, most);
    int readable = 0;
    for (int i = 0; i < 8; ++i) {
        edge.check_newest(stamp(random));
        const CommitNumber snapshot = random() % (edge.committed() + 1);
        readable += edge.check(snapshot, stamp(random)) ? 1 : 0;
    }
    return readable;
}

struct Mix {
    const char* name;
    StampNs history;
    StampNs step;       // stamps rise by this much
    StampNs late;       // and may be late by as much as this
    unsigned repeats;   // per cent that repeat an earlier stamp
    unsigned clears;    // per mille
    unsigned parents;   // per cent that name another parent
    unsigned aborts;    // per cent
    std::size_t batch;  // most samples of a commit
    bool together = false;
};

void drive(const Mix& mix, unsigned seed) {
    std::printf("  %s: seed %u\n", mix.name, seed);
    std::mt19937 random(seed);
    Edge edge(mix.history);
    if (mix.together)
        edge.hand_in_together();
    std::vector<StampNs> past{90'000};
    StampNs now = 100'000;
    for (int i = 0; i < testing::rounds(400); ++i) {
        now += mix.step;
        std::vector<StampNs> stamps(1 + random() % mix.batch);
        for (StampNs& stamp : stamps) {
            stamp = now - static_cast<StampNs>(random() % static_cast<std::uint64_t>(mix.late + 1));
            if (random() % 100 < mix.repeats)
                stamp = past[past.size() - 1 - random() % std::min<std::size_t>(past.size(), 40)];
            stamp = std::max(stamp, now - mix.history / 2);
        }
        std::sort(stamps.begin(), stamps.end());  // as the store hands them in
        if (random() % 1000 < mix.clears)
            stamps.assign(1, kClearMarker);
        const FrameId parent = random() % 100 < mix.parents ? 2 : 1;
        if (random() % 100 < mix.aborts) {
            edge.abort(stamps, parent);
        } else {
            edge.commit(stamps, parent);
            past.insert(past.end(), stamps.begin(), stamps.end());
            std::erase(past, kClearMarker);
        }
        if (i % 5 == 0)
            check_snapshots(edge, random, now - 2 * mix.late - 40 * mix.step, now + 3);
    }
}

}  // namespace

TFDB_TEST(edge_grows_and_every_snapshot_sees_its_own) {
    Edge edge;
    for (StampNs stamp = 10; stamp <= 30'000; stamp += 10)
        edge.commit({stamp});
    for (CommitNumber snapshot = 0; snapshot <= 3000; snapshot += 149) {
        for (const StampNs stamp : {0, 5, 10, 11, 14'995, 15'000, 29'999, 30'000, 40'000})
            CHECK(edge.check(snapshot, stamp));
    }
    // 64 bytes of slot and 8 of stamp, in segments of 256 of which one is not full.
    CHECK(edge.used_bytes() < 76 * (3000 + 256) + 40'000);
}

TFDB_TEST(edge_tells_its_figures_without_looking_at_all_samples) {
    std::mt19937 random(17);
    Edge edge;
    edge.hold(true);
    std::map<std::uint64_t, std::uint64_t> looks;  // by number of samples
    for (std::uint64_t samples = 0; samples <= 200'000;) {
        std::vector<StampNs> stamps(1000);
        for (StampNs& stamp : stamps)
            stamp = static_cast<StampNs>(++samples * 1000 + random() % 900);
        edge.commit(stamps);
        if (samples == 25'000 || samples == 200'000)
            looks[samples] = edge.looks_for_extent(edge.committed());
    }
    std::printf("  %llu words of 25,000 samples, %llu of 200,000; seed 17\n",
                static_cast<unsigned long long>(looks[25'000]),
                static_cast<unsigned long long>(looks[200'000]));
    // Two segments of 256 samples at most, a word for the stamp and one for the commit each, twice
    // seven nodes of each level.
    for (const auto& [samples, words] : looks)
        CHECK(words < 2 * 2 * 256 + 2 * 7 * 8 * 4 + 100);
    // A held snapshot: what came later concerns the segments that it came into.
    const CommitNumber held = edge.committed() / 2;
    const std::uint64_t before = edge.looks_for_extent(held);
    CHECK(before < 3 * 2 * 256 + 2 * 7 * 16 * 4 + 2 * 400 + 100);
    for (int i = 0; i < 4; ++i)
        edge.commit({static_cast<StampNs>(random() % 50'000) * 1000 + 999});
    CHECK(edge.looks_for_extent(held) < before + 4 * (2 * 256 + 7 * 16 * 4));
    CHECK(edge.looks_for_extent(edge.committed()) < looks[200'000] + 2 * 256);
}

TFDB_TEST(edge_old_snapshot_passes_over_what_is_newer) {
    constexpr StampNs kFlood = 60'000;
    // Where what is newer goes: ahead of what the snapshot sees, into its midst, before all of it.
    for (const StampNs from : {StampNs{300'000}, StampNs{1'000}, StampNs{0}}) {
        Edge edge;
        edge.hold(true);
        std::vector<StampNs> seen(1000);
        for (std::size_t i = 0; i < seen.size(); ++i)
            seen[i] = static_cast<StampNs>(i < 500 ? 100'001 + i : 200'001 + i);
        edge.commit(seen);
        const CommitNumber held = edge.committed();
        for (StampNs at = from; at < from + kFlood; at += 200) {
            std::vector<StampNs> stamps(200);
            for (std::size_t i = 0; i < stamps.size(); ++i)
                stamps[i] = at + static_cast<StampNs>(i) + (from == 1'000 ? 110'000 : 0);
            edge.commit(stamps);
        }
        for (const StampNs stamp : {50'000, 100'400, 130'000, 200'800, 320'000}) {
            const std::uint64_t looks = edge.looks_for(held, stamp);
            std::printf("  %llu words at %lld\n", static_cast<unsigned long long>(looks),
                        static_cast<long long>(stamp));
            // Of 240 segments and more: those that were skipped one by one took two words each.
            CHECK(looks < 400);
        }
    }
}

TFDB_TEST(edge_figures_are_right_whatever_comes_late) {
    for (const unsigned seed : {1U, 2U, 3U}) {
        std::printf("  seed %u\n", seed);
        std::mt19937 random(seed);
        Edge edge(seed == 3 ? 15'000'000 : kForever);
        edge.hold(seed != 1);
        std::vector<StampNs> stamps(20'000);
        for (std::size_t i = 0; i < stamps.size(); ++i)
            stamps[i] = static_cast<StampNs>(1000 * i + random() % 900);
        edge.commit(stamps);
        for (int i = 0; i < testing::rounds(150); ++i) {
            std::vector<StampNs> more(1 + random() % (i % 10 == 0 ? 400 : 3));
            for (StampNs& stamp : more) {
                stamp = static_cast<StampNs>(6'000'000 + random() % 14'500'000);
                if (random() % 3 == 0)  // corrects one that is there, or adds one beside it
                    stamp = stamps[7000 + random() % 12'000] + static_cast<StampNs>(random() % 2);
            }
            std::sort(more.begin(), more.end());
            if (random() % 4 == 0) {
                edge.abort(more);
            } else {
                edge.commit(more);
            }
            edge.check_newest(more.front());
            if (seed != 1)
                CHECK(edge.check(random() % edge.committed() + 1, more.back()));
        }
    }
}

TFDB_TEST(edge_evicts_what_is_no_longer_retained) {
    std::mt19937 random(11);
    Edge edge(1000);
    std::size_t settled = 0;
    for (StampNs stamp = 10; stamp <= 60'000; stamp += 10) {
        edge.commit({stamp});
        if (stamp == 20'000)
            settled = edge.used_bytes();
        if (stamp % 1000 == 0)
            check_snapshots(edge, random, stamp - 1200, stamp + 5);
    }
    CHECK_EQ(edge.used_bytes(), settled);
    CHECK(settled < 2 * 76 * 256 + 2048);
    CHECK(!edge.check(10, 50));  // said so, instead of a wrong answer
    View recent;
    Bracket around;
    CHECK(edge.open(edge.committed() - 20, recent) && recent.bracket(59'505, around));
    CHECK_EQ(around.before.stamp, 59'500);
}

TFDB_TEST(edge_keeps_what_held_snapshots_see) {
    Edge edge(100);
    for (StampNs stamp = 1; stamp <= 1000; ++stamp)
        edge.commit({stamp});
    edge.hold(true);
    const CommitNumber held = edge.committed();
    for (StampNs stamp = 1001; stamp <= 20'000; ++stamp)
        edge.commit({stamp});
    for (StampNs stamp = 880; stamp <= 1010; ++stamp)
        CHECK(edge.check(held, stamp));
    edge.hold(false);
    for (StampNs stamp = 20'001; stamp <= 60'000; ++stamp)
        edge.commit({stamp});
    edge.check_newest(59'950);
    CHECK(!edge.check(held, 950));
}

TFDB_TEST(edge_takes_late_samples) {
    Edge edge;
    edge.hold(true);
    for (StampNs stamp = 0; stamp < 4000; stamp += 4) {
        edge.commit({stamp + 16});
        edge.commit({stamp + 1});
    }
    CHECK_EQ(edge.word_value(kLate), 999U + 1U);
    for (int attempt = 0; attempt < 2; ++attempt) {
        edge.abort({6, 7, 2002});  // what a death leaves is taken back in the same way
        CHECK_EQ(edge.word_value(kLate), 1000U);
    }
    edge.commit({6, 7});
    CHECK_EQ(edge.word_value(kLate), 1002U);
    edge.abort({5000});
    edge.commit({5000});
    CHECK_EQ(edge.word_value(kLate), 1002U);
    for (StampNs stamp = 0; stamp < 4020; ++stamp)
        edge.check_newest(stamp);
    CHECK(edge.check(777, 1500));
}

TFDB_TEST(edge_takes_samples_in_any_order) {
    std::mt19937 random(5);
    Edge edge;
    edge.hold(true);
    for (StampNs run = 0; run < 40; ++run) {
        for (StampNs stamp = 0; stamp < 100; ++stamp) {
            const StampNs at = run % 3 == 0 ? 99 - stamp : stamp;  // every third one backwards
            edge.commit({100'000 + (run % 2 == 0 ? 1 : -1) * (1000 * at + 7 * run + 1)});
        }
        check_snapshots(edge, random, 0, 200'000);
    }
    for (CommitNumber snapshot = 0; snapshot < edge.committed(); snapshot += 331)
        CHECK(edge.check(snapshot, 1 + static_cast<StampNs>(random() % 200'000)));
}

TFDB_TEST(edge_takes_ever_older_samples) {
    Edge edge;
    edge.hold(true);
    for (StampNs stamp = 3000; stamp > 0; --stamp)
        edge.commit({10 * stamp});
    for (CommitNumber snapshot = 0; snapshot <= 3000; snapshot += 149) {
        for (const StampNs stamp : {0, 5, 10, 11, 14'995, 15'000, 29'999, 30'000, 40'000})
            CHECK(edge.check(snapshot, stamp));
    }
    CHECK(edge.used_bytes() < 80 * 3000 + 40'000);
}

TFDB_TEST(edge_same_stamp_again_is_a_correction_for_newer_snapshots_only) {
    Edge edge;
    edge.hold(true);
    for (StampNs stamp = 10; stamp <= 100; stamp += 10)
        edge.commit({stamp});
    for (int again = 0; again < 50; ++again)
        edge.commit({50}, again % 2 == 0 ? 1 : 2);
    for (CommitNumber snapshot = 0; snapshot <= edge.committed(); ++snapshot) {
        for (const StampNs stamp : {49, 50, 51, 100})
            CHECK(edge.check(snapshot, stamp));
    }
    edge.commit({50, 50, 50});
    edge.check_newest(50);
}

TFDB_TEST(edge_cleared_is_empty_and_starts_anew) {
    Edge edge;
    edge.hold(true);
    for (int round = 0; round < 5; ++round) {
        for (StampNs stamp = 10; stamp <= 300; stamp += 10)
            edge.commit({stamp + 5000 * (round % 2)});
        edge.commit({kClearMarker});
        edge.check_newest(100);
    }
    edge.commit({40});
    for (CommitNumber snapshot = 0; snapshot <= edge.committed(); ++snapshot) {
        for (const StampNs stamp : {9, 40, 105, 5100, 6000})
            CHECK(edge.check(snapshot, stamp));
    }
}

TFDB_TEST(edge_static_pose_may_be_revised_and_taken_back) {
    Edge edge;
    edge.check_static(0);
    for (int i = 0; i < 100; ++i) {
        edge.commit({kStaticStamp}, 1 + static_cast<FrameId>(i % 3));
        edge.abort({kStaticStamp}, 9);
        edge.check_static(edge.committed());
    }
    CHECK(edge.used_bytes() < 4096);  // revisions replace each other unless one is held
    edge.hold(true);
    const CommitNumber held = edge.committed();
    for (int i = 0; i < 100; ++i)
        edge.commit({kStaticStamp}, 5);
    edge.check_static(held);
}

TFDB_TEST(edge_undo_after_growth_eviction_lateness_runs_and_clear) {
    Edge edge(5000);
    edge.abort({10});  // of an edge without samples
    edge.check_newest(10);
    for (StampNs stamp = 10; stamp <= 80; stamp += 10)
        edge.commit({stamp});
    edge.abort({90, 100, 110});  // grows the segment of eight
    edge.check_newest(100);
    edge.abort({30, 40}, 2);  // late, same stamps, another parent
    edge.check_newest(40);
    edge.abort({kClearMarker});
    edge.check_newest(40);
    for (StampNs stamp = 100; stamp <= 20'000; stamp += 10)
        edge.commit({stamp});
    edge.abort({20'500, 20'600, 27'000});  // evicts
    for (StampNs stamp = 14'900; stamp <= 20'010; stamp += 7)
        edge.check_newest(stamp);
    for (StampNs late = 0; late < 30; ++late) {  // copies and splits segments
        edge.abort({16'000 + late, 18'000, 19'000 + late});
        edge.commit({15'500 + 13 * late, 17'000, 18'000 + late, 19'990 + late});
        for (StampNs stamp = 15'000; stamp <= 20'100; stamp += 31)
            edge.check_newest(stamp);
    }
}

TFDB_TEST(edge_of_which_a_clear_was_taken_back_is_visited_as_it_was) {
    for (StampNs n = 40; n < 900; n += 37) {
        Edge edge;
        edge.hold(true);
        for (StampNs stamp = 1; stamp <= n; ++stamp)
            edge.commit({stamp});
        const CommitNumber held = edge.committed();
        edge.abort({kClearMarker});
        for (StampNs stamp = n + 1; stamp <= n + 1500; ++stamp)
            edge.commit({stamp});
        View view;
        StampNs last = 0;
        CHECK(edge.open(held, view));
        CHECK(view.visit(0, kForever, 0, [&](const SampleAt& sample) {
            CHECK_EQ(sample.stamp, last + 1);
            return ++last < 2 * n;
        }));
        CHECK_EQ(last, n);
    }
}

TFDB_TEST(edge_random_commits_and_aborts_agree_with_a_plain_list) {
    const Mix mixes[] = {
        {"in order, grows", kForever, 10, 0, 0, 0, 0, 10, 3},
        {"in order, evicts", 300, 10, 0, 0, 0, 5, 10, 3},
        {"a little late", 900, 10, 60, 5, 2, 5, 10, 3},
        {"very late", kForever, 10, 6000, 5, 2, 5, 10, 4},
        {"very late, evicts", 3000, 10, 1500, 5, 2, 5, 10, 4},
        {"corrections", 600, 5, 0, 60, 0, 20, 20, 2},
        {"cleared often", 600, 5, 50, 5, 60, 10, 30, 3},
        {"aborted mostly", 400, 5, 300, 10, 20, 10, 70, 6},
        {"in order, together", kForever, 900, 700, 5, 5, 10, 20, 300, true},
        {"evicts, together", 30'000, 900, 700, 5, 5, 10, 20, 300, true},
        {"very late, together", 90'000, 900, 40'000, 5, 5, 10, 20, 60, true},
    };
    for (const Mix& mix : mixes) {
        for (unsigned seed = 1; seed <= 2; ++seed)
            drive(mix, seed);
    }
}

TFDB_TEST(edge_views_of_old_snapshots_end_where_they_should) {
    Edge edge;
    edge.hold(true);
    std::mt19937 random(3);
    for (StampNs stamp = 1; stamp <= 40'000; ++stamp)
        edge.commit({stamp});
    for (int i = 0; i < 2000; ++i) {
        const CommitNumber snapshot = random() % 40'001;
        View view;
        CHECK(edge.open(snapshot, view));
        CHECK_EQ(view.empty(), snapshot == 0);
        if (snapshot > 0)
            CHECK_EQ(view.newest().stamp, static_cast<StampNs>(snapshot));
    }
    edge.commit({50'000, 50'001, 50'002});
    edge.commit({50'003, 50'004});
    for (const auto& [snapshot, newest] : {std::pair{40'000, 40'000}, {40'001, 50'002}}) {
        View view;
        CHECK(edge.open(static_cast<CommitNumber>(snapshot), view));
        CHECK_EQ(view.newest().stamp, newest);
    }
}

namespace {

void check_search(const char* name, const std::vector<StampNs>& stamps, unsigned seed) {
    std::printf("  search %s: seed %u\n", name, seed);
    std::mt19937_64 random(seed);
    Edge edge;
    for (std::size_t i = 0; i < stamps.size(); i += 50) {
        const auto from = stamps.begin() + static_cast<long>(i);
        edge.commit({from, from + std::min<long>(50, stamps.end() - from)});
    }
    View view;
    CHECK(edge.open(edge.committed(), view));
    const auto compare = [&](StampNs stamp) {
        const auto plain = std::upper_bound(stamps.begin(), stamps.end(), stamp);
        Bracket around;
        CHECK(view.bracket(stamp, around));
        CHECK_EQ(around.after.stamp, plain == stamps.end() ? kNoStamp : *plain);
        CHECK_EQ(around.before.stamp, plain == stamps.begin() ? kNoStamp : *(plain - 1));
    };
    std::uniform_int_distribution<StampNs> any(stamps.front() - 100, stamps.back() + 100);
    for (int i = 0; i < 4000; ++i) {
        compare(any(random));
        const StampNs stored = stamps[random() % stamps.size()];
        compare(stored - 1);
        compare(stored);
    }
    compare(0);
    compare(kForever);
}

}  // namespace

TFDB_TEST(edge_search_agrees_with_a_plain_one_whatever_the_rate_does) {
    constexpr std::size_t kCount = 20'000;
    std::mt19937_64 random(21);
    std::vector<StampNs> jittered;
    std::vector<StampNs> poisson;
    std::vector<StampNs> gap;
    std::vector<StampNs> faster;
    std::exponential_distribution<double> wait(1e-6);
    StampNs at = 1'000'000;
    for (std::size_t i = 0; i < kCount; ++i) {
        const auto number = static_cast<StampNs>(i + 1);
        jittered.push_back(number * 1'000'000 + static_cast<StampNs>(random() % 900'000));
        at += 1 + static_cast<StampNs>(wait(random));
        poisson.push_back(at);
        gap.push_back(number * 1000 + (i > kCount / 3 ? 1'000'000'000'000 : 0));
        faster.push_back(number * number);
    }
    check_search("jittered", jittered, 22);
    check_search("poisson", poisson, 23);
    check_search("one long gap", gap, 24);
    check_search("ever slower", faster, 25);
    check_search("one sample", {500}, 26);
    check_search("five samples", {500, 501, 502, 503, 504}, 27);
}

}  // namespace tfdb::history
