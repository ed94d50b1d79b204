#include "histogram.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "random.hpp"
#include "tfdb/testing/check.hpp"

namespace {

using tfdb::driver::Histogram;
using tfdb::driver::Random;

TFDB_TEST(histogram_buckets_follow_each_other_without_a_gap) {
    for (std::uint64_t value = 1; value < 100'000; ++value) {
        const std::size_t step = Histogram::bucket_of(value) - Histogram::bucket_of(value - 1);
        CHECK(step <= 1);
    }
    for (unsigned bit = 6; bit <= Histogram::kTopBit; ++bit) {
        const std::uint64_t power = std::uint64_t{1} << bit;
        CHECK_EQ(Histogram::bucket_of(power), Histogram::bucket_of(power - 1) + 1);
    }
    CHECK_EQ(Histogram::bucket_of(Histogram::kLongest), Histogram::kBuckets - 1);
}

TFDB_TEST(histogram_middle_lies_in_its_bucket) {
    for (std::size_t bucket = 0; bucket < Histogram::kBuckets; ++bucket) {
        const auto middle = static_cast<std::uint64_t>(Histogram::middle_of(bucket));
        CHECK_EQ(Histogram::bucket_of(middle), bucket);
    }
}

TFDB_TEST(histogram_percentiles_are_within_two_percent_of_sorted_values) {
    constexpr std::uint64_t kSeed = 11;
    Random random(kSeed);
    Histogram histogram;
    std::vector<double> values;
    for (int i = 0; i < 100'000; ++i) {
        const double value = std::floor(std::exp(20.0 * random.unit()));
        values.push_back(value);
        histogram.record(static_cast<std::int64_t>(value));
    }
    std::sort(values.begin(), values.end());
    for (const double part : {0.001, 0.1, 0.5, 0.9, 0.99, 0.999}) {
        const double exact = values[static_cast<std::size_t>(part * 100'000) - 1];
        CHECK_NEAR(histogram.percentile(part) / exact, 1.0, 0.02);
    }
    CHECK_NEAR(histogram.percentile(1.0) / values.back(), 1.0, 0.02);
    CHECK_EQ(histogram.longest(), static_cast<std::uint64_t>(values.back()));
}

TFDB_TEST(histogram_of_nothing_of_one_and_of_the_impossible) {
    Histogram histogram;
    CHECK_EQ(histogram.percentile(0.5), 0.0);
    histogram.record(1'000'000);
    CHECK_NEAR(histogram.percentile(0.5), 1e6, 1.6e4);
    CHECK_EQ(histogram.percentile(0.0), histogram.percentile(1.0));
    histogram.record(-5);
    CHECK_EQ(histogram.percentile(0.25), 0.0);
    histogram.record(std::int64_t{1} << 60);
    CHECK_EQ(histogram.longest(), Histogram::kLongest);
}

TFDB_TEST(histogram_sum_has_the_records_of_both) {
    Histogram one;
    Histogram other;
    for (int i = 0; i < 100; ++i) {
        one.record(10);
        other.record(50);
    }
    one.add(other);
    CHECK_EQ(one.total(), 200U);
    CHECK_EQ(one.percentile(0.4), 10.0);
    CHECK_EQ(one.percentile(0.6), 50.0);
    CHECK_EQ(one.longest(), 50U);
}

}  // namespace
