#include "tfdb/store/forgotten.hpp"

#include <map>
#include <random>
#include <set>
#include <string>

#include "tfdb/store/fixture.hpp"

namespace tfdb {
namespace {

using namespace fixture;

constexpr StampNs kHistory = 100;

/// Writes samples to a store, counts losses, and compares the count with the store's content.
class Compared {
public:
    void write(const std::string& child, StampNs stamp) {
        try {
            set(buffer_, "map", child, stamp, pose_of(static_cast<double>(stamp)));
            forgotten.stored(child, stamp);
            stamps_[child].insert(stamp);
        } catch (const TooOld&) {
            forgotten.refused();
            ++refused;
        }
    }
    /// Distinct stamps that were stored and are no longer there.
    [[nodiscard]] std::uint64_t missing() const {
        std::uint64_t count = 0;
        for (const auto& [child, stamps] : stamps_)
            count += stamps.size() - buffer_.samples(child).stamps.size();
        return count;
    }

    Forgotten forgotten{kHistory};
    std::uint64_t refused = 0;

private:
    Buffer buffer_{keeping(kHistory)};
    std::map<std::string, std::set<StampNs>> stamps_;
};

}  // namespace

TFDB_TEST(forgotten_counts_what_lies_before_the_history) {
    Compared both;
    for (StampNs stamp = 0; stamp < 1000; stamp += 10)
        both.write("base", stamp);
    CHECK_EQ(both.forgotten.count(), 89U);  // 890 to 990 are kept
    CHECK_EQ(both.missing(), 89U);
    both.write("base", 891);
    both.write("base", 889);
    CHECK_EQ(both.forgotten.count(), 90U);
    CHECK_EQ(both.refused, 1U);
    both.write("base", 992);
    CHECK_EQ(both.forgotten.count(), 92U);
}

TFDB_TEST(forgotten_counts_a_repeated_stamp_once) {
    Compared both;
    for (StampNs stamp = 0; stamp < 300; stamp += 10) {
        both.write("base", stamp);
        both.write("base", stamp);
        if (stamp >= 50)
            both.write("base", stamp - 50);
    }
    CHECK_EQ(both.forgotten.count(), both.missing());
    CHECK_EQ(both.missing(), 19U);
}

TFDB_TEST(forgotten_counts_a_sample_that_comes_behind_a_jump_of_its_message) {
    Forgotten forgotten(kHistory);
    forgotten.stored("base", 500);
    forgotten.stored("base", 3);
    CHECK_EQ(forgotten.count(), 1U);
}

TFDB_TEST(forgotten_agrees_with_a_store_on_random_samples) {
    std::mt19937 random(77);
    for (int round = 0; round < 40; ++round) {
        Compared both;
        StampNs now = 200;
        for (int i = 0; i < 400; ++i) {
            now += static_cast<StampNs>(random() % 12);
            const StampNs late = random() % 3 == 0 ? static_cast<StampNs>(random() % 160) : 0;
            both.write(std::string("frame") + std::to_string(random() % 3), now - late);
        }
        CHECK_EQ(both.forgotten.count(), both.missing() + both.refused);
    }
}

}  // namespace tfdb
