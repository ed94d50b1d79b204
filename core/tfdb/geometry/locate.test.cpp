#include "tfdb/geometry/locate.hpp"

#include <algorithm>
#include <random>

#include "tfdb/testing/check.hpp"

namespace tfdb::geometry {
namespace {

using Method = Locator::Method;
using Sizes = std::initializer_list<std::size_t>;

std::uint32_t expected_index(const std::vector<StampNs>& stamps, StampNs query) {
    const auto above = std::upper_bound(stamps.begin(), stamps.end(), query) - stamps.begin();
    const auto last = static_cast<std::ptrdiff_t>(stamps.size()) - 2;
    return static_cast<std::uint32_t>(std::clamp<std::ptrdiff_t>(above - 1, 0, last));
}

/// Blocks of 100, as the batch functions call it; returns the method that was chosen.
Method judge(Locator& locator, const std::vector<StampNs>& stamps,
             const std::vector<StampNs>& queries) {
    locator.prepare(stamps.data(), stamps.size(), describe(queries));
    std::vector<std::uint32_t> index(queries.size());
    for (int pass = 0; pass < 2; ++pass) {
        for (std::size_t i = 0; i < queries.size(); i += 100) {
            locator.locate(queries.data() + i, std::min<std::size_t>(100, queries.size() - i),
                           index.data() + i);
        }
        locator.rewind();
    }
    for (std::size_t i = 0; i < queries.size(); ++i) {
        CHECK_EQ(index[i], expected_index(stamps, queries[i]));
        CHECK(stamps[locator.low()] <= queries[i] || locator.low() == 0);
        CHECK(stamps[locator.high()] >= queries[i] || locator.high() == stamps.size() - 1);
    }
    return locator.method();
}

std::vector<StampNs> random_stamps(std::mt19937_64& random, std::size_t count, StampNs low,
                                   StampNs high, bool unique) {
    std::uniform_int_distribution<StampNs> at(low, high);
    std::vector<StampNs> stamps(count);
    std::generate(stamps.begin(), stamps.end(), [&] { return at(random); });
    if (unique) {
        std::sort(stamps.begin(), stamps.end());
        stamps.erase(std::unique(stamps.begin(), stamps.end()), stamps.end());
    }
    return stamps;
}

TFDB_TEST(locate_agrees_with_upper_bound) {
    constexpr unsigned kSeed = 31;
    std::printf("locate_agrees_with_upper_bound: seed %u\n", kSeed);
    std::mt19937_64 random(kSeed);
    Locator locator;
    bool met[3] = {};
    for (const StampNs span : {StampNs{5}, StampNs{1'000}, StampNs{1'000'000'000'000}}) {
        for (const std::size_t size : Sizes{3, 10, 300, 5000}) {
            std::vector<StampNs> stamps = random_stamps(random, size, 1000, 1000 + span, true);
            if (stamps.size() < 2) {
                stamps = {1000, 1001};
            }
            for (const std::size_t count : Sizes{1, 7, 400, 30'000}) {
                // Wider than the track, and only a part of it.
                for (const StampNs margin : {StampNs{-1} * (span / 3), StampNs{900}}) {
                    auto queries =
                        random_stamps(random, count, 1000 - margin, 1000 + span + margin, false);
                    met[static_cast<int>(judge(locator, stamps, queries))] = true;
                    std::sort(queries.begin(), queries.end());
                    met[static_cast<int>(judge(locator, stamps, queries))] = true;
                }
            }
        }
    }
    CHECK(met[0] && met[1] && met[2]);
}

TFDB_TEST(locate_in_tracks_with_gaps_and_bursts) {
    constexpr unsigned kSeed = 32;
    std::printf("locate_in_tracks_with_gaps_and_bursts: seed %u\n", kSeed);
    std::mt19937_64 random(kSeed);
    Locator locator;
    // Bursts of a hundred samples a nanosecond apart: no table of sensible size tells them apart.
    std::vector<StampNs> bursts;
    for (StampNs start = 0; start < 100; ++start) {
        for (StampNs i = 0; i < 100; ++i) {
            bursts.push_back(start * 1'000'000'000 + i);
        }
    }
    auto queries = random_stamps(random, 20'000, 0, 100'000'000'000, false);
    for (std::size_t i = 0; i < 5'000; ++i) {
        queries[i] = bursts[random() % bursts.size()];
    }
    CHECK_EQ(judge(locator, bursts, queries), Method::kBinary);
    std::sort(queries.begin(), queries.end());
    judge(locator, bursts, queries);

    // One long gap in an even track.
    std::vector<StampNs> gap;
    for (StampNs i = 0; i < 1000; ++i) {
        gap.push_back(i * 1000 + (i >= 500 ? 40'000 : 0));
    }
    CHECK_EQ(judge(locator, gap, random_stamps(random, 5'000, 0, 1'040'000, false)),
             Method::kBuckets);
}

TFDB_TEST(locate_at_the_ends_of_int64) {
    constexpr StampNs kMost = std::numeric_limits<StampNs>::max();
    Locator locator;
    const std::vector<StampNs> stamps{0, 1, kMost / 2, kMost - 1, kMost};
    std::vector<StampNs> queries;
    for (int i = 0; i < 50; ++i) {
        queries.insert(queries.end(), {kMost, 0, kMost - 1, 1, 2, kMost / 2, kMost / 2 - 1});
    }
    judge(locator, stamps, queries);
    std::sort(queries.begin(), queries.end());
    judge(locator, stamps, queries);
}

}  // namespace
}  // namespace tfdb::geometry
