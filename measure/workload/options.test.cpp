#include "options.hpp"

#include <cmath>
#include <string>
#include <vector>

#include "forest.hpp"
#include "motion.hpp"
#include "tfdb/testing/check.hpp"

namespace {

using tfdb::driver::BadOption;
using tfdb::driver::Forest;
using tfdb::driver::Options;
using tfdb::driver::parse;
using tfdb::driver::Path;

std::string refusal(const std::vector<std::string>& arguments) {
    try {
        static_cast<void>(parse(arguments));
    } catch (const BadOption& error) {
        return error.what();
    }
    return "";
}

bool holds(const std::string& text, const std::string& part) {
    return text.find(part) != std::string::npos;
}

TFDB_TEST(options_take_what_they_are_given) {
    const Options options = parse({"--engine", "silo", "--threads", "8", "--read-ratio", "0.95",
                                   "--skew", "0.99", "--no-batch", "--no-pin", "--direction",
                                   "same", "--tree", "star", "--frequency", "120"});
    CHECK_EQ(options.engine, "silo");
    CHECK_EQ(options.threads, 8U);
    CHECK_EQ(options.skew, 0.99);
    CHECK(options.writes == tfdb::driver::WriteKind::kSingle);
    CHECK(!options.pin);
    CHECK(!options.opposite);
    CHECK(options.tree == tfdb::driver::Tree::kStar);
    CHECK_EQ(options.read_frequency, 120.0);
    CHECK_EQ(options.write_frequency, 120.0);
}

TFDB_TEST(options_name_what_would_be_valid) {
    CHECK(holds(refusal({"--threads", "0"}), "from 1 to 1024"));
    CHECK(holds(refusal({"--threads", "two"}), "'two'"));
    CHECK(holds(refusal({"--threads", "2x"}), "--threads"));
    CHECK(holds(refusal({"--threads", "-1"}), "--threads"));
    CHECK(holds(refusal({"--read-ratio", "1.5"}),
                "--read-ratio '1.5' is not valid: a number from 0 to 1"));
    CHECK(holds(refusal({"--read-ratio", "nan"}), "nan"));
    CHECK(holds(refusal({"--tree", "bush"}), "chain, star, humanoid, random"));
    CHECK(holds(refusal({"--bogus"}), "--bogus"));
    CHECK(holds(refusal({"--seed"}), "needs a value"));
    CHECK(holds(refusal({"--joints", "20", "--read-length", "21"}), "--joints 21"));
}

TFDB_TEST(options_share_threads_out) {
    const auto roles = [](std::uint32_t threads, double ratio) {
        Options options;
        options.threads = threads;
        options.read_ratio = ratio;
        return std::vector<std::uint32_t>{options.readers(), options.mixed(), options.writers()};
    };
    using Roles = std::vector<std::uint32_t>;
    CHECK(roles(2, 0.5) == (Roles{1, 0, 1}));
    CHECK(roles(1, 0.5) == (Roles{0, 1, 0}));
    CHECK(roles(3, 0.5) == (Roles{1, 1, 1}));
    CHECK(roles(5, 0.2) == (Roles{1, 0, 4}));
    CHECK(roles(10, 0.7) == (Roles{7, 0, 3}));  // 10 * 0.7 is not 7 in doubles
    CHECK(roles(4, 0.0) == (Roles{0, 0, 4}));
    CHECK(roles(4, 1.0) == (Roles{4, 0, 0}));
    Options mixed;
    mixed.threads = 3;
    mixed.read_ratio = 0.95;
    CHECK_EQ(mixed.readers(), 2U);
    CHECK_NEAR(mixed.mixed_share(), 0.85, 1e-12);
    mixed.share = tfdb::driver::Share::kOperations;
    CHECK_EQ(mixed.mixed(), 3U);
    CHECK_EQ(mixed.mixed_share(), 0.95);
}

Forest grown(const std::string& tree, const std::string& joints, const std::string& length) {
    return Forest(parse(
        {"--tree", tree, "--joints", joints, "--read-length", length, "--write-length", "2"}));
}

TFDB_TEST(forests_have_paths_of_the_length_that_they_say) {
    for (const std::string tree : {"chain", "star", "humanoid", "random"}) {
        const Forest forest = grown(tree, "100", "16");
        CHECK(forest.paths() > 0);
        std::vector<std::uint32_t> low;
        std::vector<std::uint32_t> high;
        for (std::uint32_t i = 0; i < forest.paths(); ++i) {
            const Path path = forest.path(i);
            forest.edges_between(path, low, high);
            CHECK_EQ(low.size() + high.size(), path.edges);
            CHECK(path.edges > 0);
            CHECK(path.edges == 16 || tree == "humanoid" || tree == "random");
        }
        for (std::uint32_t frame = 1; frame <= forest.edges(); ++frame) {
            CHECK(forest.parent(frame) < frame);
        }
    }
}

TFDB_TEST(forests_that_do_not_fit_are_refused) {
    CHECK_THROWS_AS(grown("humanoid", "31", "2"), BadOption);
    CHECK_EQ(grown("star", "16", "16").paths(), 2U);
    CHECK_EQ(grown("star", "2", "1").paths(), 2U);
    CHECK_EQ(grown("chain", "16", "16").paths(), 1U);
}

TFDB_TEST(judge_notices_a_swapped_order_an_inverse_and_a_nan) {
    using tfdb::driver::Motion;
    using tfdb::driver::Rigid;
    const Motion motion;
    const Rigid one = Rigid::of(motion.at(1, 0));
    const Rigid other = Rigid::of(motion.at(9, 50'000'000));
    CHECK(one.after(other).apart(other.after(one)) > 1e-3);
    CHECK(one.apart(one.inverse()) > 1e-3);
    CHECK_NEAR(one.after(one.inverse()).apart(Rigid{}), 0.0, 1e-15);
    Rigid broken = one;
    broken.move[1] = std::nan("");
    CHECK(!(one.apart(broken) <= 1e9));
    CHECK(!(broken.apart(one) <= 1e9));
}

}  // namespace
