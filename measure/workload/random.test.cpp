#include "random.hpp"

#include <cmath>
#include <vector>

#include "tfdb/testing/check.hpp"

namespace {

using tfdb::driver::Random;
using tfdb::driver::Zipf;

constexpr std::uint64_t kSeed = 42;

TFDB_TEST(zipf_draws_each_rank_as_often_as_its_law_says) {
    constexpr std::uint32_t kRanks = 50;
    constexpr int kDraws = 400'000;
    for (const double theta : {0.0, 0.5, 0.99, 1.0, 1.5, 3.0}) {
        Random random(kSeed);
        const Zipf zipf(kRanks, theta);
        std::vector<int> counts(kRanks, 0);
        for (int i = 0; i < kDraws; ++i) {
            ++counts.at(zipf.draw(random));
        }
        double sum = 0.0;
        for (std::uint32_t rank = 1; rank <= kRanks; ++rank) {
            sum += std::pow(rank, -theta);
        }
        for (std::uint32_t rank = 1; rank <= kRanks; ++rank) {
            const double expected = kDraws * std::pow(rank, -theta) / sum;
            // Five standard deviations: the seed is fixed, and the law is exact.
            CHECK_NEAR(counts[rank - 1], expected, 5.0 * std::sqrt(expected) + 1.0);
        }
    }
}

TFDB_TEST(zipf_of_one_rank_and_of_many) {
    Random random(kSeed);
    const Zipf one(1, 0.99);
    const Zipf many(1'000'000, 0.99);
    for (int i = 0; i < 10'000; ++i) {
        CHECK_EQ(one.draw(random), 0U);
        CHECK(many.draw(random) < 1'000'000U);
    }
}

TFDB_TEST(random_numbers_stay_below_their_limit_and_reach_it) {
    Random random(kSeed);
    std::vector<int> counts(7, 0);
    for (int i = 0; i < 70'000; ++i) {
        ++counts.at(random.below(7));
        const double unit = random.unit();
        CHECK(unit > 0.0 && unit <= 1.0);
    }
    for (const int count : counts) {
        CHECK_NEAR(count, 10'000.0, 500.0);
    }
}

}  // namespace
