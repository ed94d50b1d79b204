#include "tfdb/geometry/select.hpp"

#include <limits>
#include <vector>

#include "tfdb/testing/check.hpp"

namespace tfdb::geometry {
namespace {

constexpr double kRefused = -99.0;

const std::vector<StampNs> kStamps{100, 200, 240, 1000};
const std::vector<std::uint32_t> kParents{7, 7, 8, 8};

TrackView track(bool with_parents = false, std::size_t size = 4) {
    return {kStamps.data(), nullptr, with_parents ? kParents.data() : nullptr, size, false};
}

/// Place in the track in units of samples, or kRefused.
double place(const TrackView& view, const Rule& rule, StampNs stamp) {
    const Selected at = select_sample(view, rule, stamp);
    return at.refused ? kRefused : static_cast<double>(at.index) + at.u;
}

TFDB_TEST(select_interpolates_inside_only) {
    const Rule rule{Selection::kInterpolate, 100};
    CHECK_EQ(place(track(), rule, 99), kRefused);
    CHECK_EQ(place(track(), rule, 100), 0.0);
    CHECK_EQ(place(track(), rule, 150), 0.5);
    CHECK_EQ(place(track(), rule, 200), 1.0);
    CHECK_EQ(place(track(), rule, 230), 1.75);
    CHECK_EQ(place(track(), rule, 240), 2.0);
    // The gap is too large, but its ends are stored.
    CHECK_EQ(place(track(), rule, 241), kRefused);
    CHECK_EQ(place(track(), rule, 999), kRefused);
    CHECK_EQ(place(track(), rule, 1000), 3.0);
    CHECK_EQ(place(track(), rule, 1001), kRefused);
    CHECK_EQ(place(track(), {Selection::kInterpolate, 99}, 150), kRefused);
    CHECK_EQ(place(track(), Rule{}, 620), 2.5);
}

TFDB_TEST(select_holds_the_earlier_sample_where_the_parent_changes) {
    const Rule rule;
    CHECK_EQ(place(track(true), rule, 150), 0.5);
    CHECK_EQ(place(track(true), rule, 200), 1.0);
    CHECK_EQ(place(track(true), rule, 239), 1.0);
    CHECK_EQ(place(track(true), rule, 240), 2.0);
    CHECK_EQ(place(track(true), rule, 620), 2.5);
    // A gap that is too large is refused also when it would be held.
    CHECK_EQ(place(track(true), {Selection::kInterpolate, 39}, 239), kRefused);
}

TFDB_TEST(select_exact_takes_stored_stamps) {
    const Rule rule{Selection::kExact, kNoLimit};
    const double expected[] = {0.0, 1.0, 2.0, 3.0};
    for (std::size_t i = 0; i < kStamps.size(); ++i) {
        CHECK_EQ(place(track(), rule, kStamps[i]), expected[i]);
        CHECK_EQ(place(track(), rule, kStamps[i] - 1), kRefused);
        CHECK_EQ(place(track(), rule, kStamps[i] + 1), kRefused);
    }
}

TFDB_TEST(select_previous_goes_back_by_at_most_the_limit) {
    const Rule rule{Selection::kPrevious, 50};
    CHECK_EQ(place(track(), rule, 99), kRefused);
    CHECK_EQ(place(track(), rule, 100), 0.0);
    CHECK_EQ(place(track(), rule, 150), 0.0);
    CHECK_EQ(place(track(), rule, 151), kRefused);
    CHECK_EQ(place(track(), rule, 239), 1.0);
    CHECK_EQ(place(track(), rule, 240), 2.0);
    CHECK_EQ(place(track(), rule, 1000), 3.0);
    CHECK_EQ(place(track(), rule, 1050), 3.0);
    CHECK_EQ(place(track(), rule, 1051), kRefused);
    CHECK_EQ(place(track(), {Selection::kPrevious, kNoLimit}, 1'000'000), 3.0);
    CHECK_EQ(place(track(true), {Selection::kPrevious, kNoLimit}, 220), 1.0);
}

TFDB_TEST(select_nearest_prefers_the_earlier_of_two) {
    const Rule rule{Selection::kNearest, 50};
    CHECK_EQ(place(track(), rule, 49), kRefused);
    CHECK_EQ(place(track(), rule, 50), 0.0);
    CHECK_EQ(place(track(), rule, 150), 0.0);
    CHECK_EQ(place(track(), rule, 151), 1.0);
    CHECK_EQ(place(track(), rule, 220), 1.0);
    CHECK_EQ(place(track(), rule, 221), 2.0);
    CHECK_EQ(place(track(), rule, 290), 2.0);
    CHECK_EQ(place(track(), rule, 291), kRefused);
    CHECK_EQ(place(track(), rule, 949), kRefused);
    CHECK_EQ(place(track(), rule, 950), 3.0);
    CHECK_EQ(place(track(), rule, 1050), 3.0);
    CHECK_EQ(place(track(), rule, 1051), kRefused);
    CHECK_EQ(place(track(), {Selection::kNearest, kNoLimit}, 0), 0.0);
    CHECK_EQ(place(track(), {Selection::kNearest, kNoLimit}, 1'000'000), 3.0);
}

TFDB_TEST(select_extrapolates_by_at_most_the_limit) {
    const Rule rule{Selection::kExtrapolate, 50};
    CHECK_EQ(place(track(), rule, 49), kRefused);
    CHECK_EQ(place(track(), rule, 50), -0.5);
    CHECK_EQ(place(track(), rule, 150), 0.5);
    // The limit is for outside, not for gaps.
    CHECK_EQ(place(track(), rule, 620), 2.5);
    CHECK_EQ(place(track(), {Selection::kExtrapolate, 760}, 1760), 4.0);
    CHECK_EQ(place(track(), rule, 1051), kRefused);
    // Nothing moves on across a change of parent: samples 1 and 2 differ.
    const TrackView changing{kStamps.data() + 1, nullptr, kParents.data() + 1, 2, false};
    CHECK_EQ(place(changing, rule, 170), 0.0);
    CHECK_EQ(place(changing, rule, 220), 0.0);
    CHECK_EQ(place(changing, rule, 240), 1.0);
    CHECK_EQ(place(changing, rule, 280), 1.0);
}

TFDB_TEST(select_in_tracks_of_one_sample_or_none) {
    const TrackView lone = track(false, 1);
    CHECK_EQ(place(lone, Rule{}, 100), 0.0);
    CHECK_EQ(place(lone, Rule{}, 101), kRefused);
    CHECK_EQ(place(lone, Rule{}, 99), kRefused);
    CHECK_EQ(place(lone, {Selection::kExact, kNoLimit}, 100), 0.0);
    CHECK_EQ(place(lone, {Selection::kExact, kNoLimit}, 101), kRefused);
    CHECK_EQ(place(lone, {Selection::kPrevious, 5}, 105), 0.0);
    CHECK_EQ(place(lone, {Selection::kPrevious, 5}, 106), kRefused);
    CHECK_EQ(place(lone, {Selection::kPrevious, 5}, 99), kRefused);
    for (const Selection both : {Selection::kNearest, Selection::kExtrapolate}) {
        CHECK_EQ(place(lone, {both, 5}, 95), 0.0);
        CHECK_EQ(place(lone, {both, 5}, 105), 0.0);
        CHECK_EQ(place(lone, {both, 5}, 94), kRefused);
        CHECK_EQ(place(lone, {both, 5}, 106), kRefused);
    }
    CHECK_EQ(place(track(false, 0), Rule{}, 100), kRefused);
    TrackView fixed = track(false, 1);
    fixed.is_static = true;
    CHECK_EQ(place(fixed, {Selection::kExact, 0}, 5'000'000), 0.0);
}

TFDB_TEST(select_survives_the_ends_of_int64) {
    constexpr StampNs kMost = std::numeric_limits<StampNs>::max();
    const std::vector<StampNs> stamps{0, kMost};
    const TrackView view{stamps.data(), nullptr, nullptr, 2, false};
    CHECK_EQ(place(view, Rule{}, kMost), 1.0);
    CHECK_NEAR(place(view, Rule{}, kMost / 2), 0.5, 1e-15);
    CHECK_EQ(place(view, Rule{}, std::numeric_limits<StampNs>::min()), kRefused);
    CHECK_EQ(place(view, {Selection::kNearest, kNoLimit}, kMost / 4), 0.0);
    CHECK_EQ(place(view, {Selection::kPrevious, kNoLimit}, kMost - 1), 0.0);
}

}  // namespace
}  // namespace tfdb::geometry
