#include "tfdb/base/error.hpp"

#include "tfdb/base/types.hpp"
#include "tfdb/testing/check.hpp"

namespace tfdb {

TFDB_TEST(errors_are_caught_by_their_own_class_or_by_the_root) {
    ErrorDetail detail;
    detail.edge = "camera";
    detail.stamp = 5;
    const auto fail = [&] { throw Stale("too old", detail); };
    CHECK_THROWS_AS(fail(), Stale);
    CHECK_THROWS_AS(fail(), Error);
    CHECK_THROWS_AS(fail(), std::runtime_error);
    try {
        fail();
    } catch (const Error& error) {
        CHECK(error.code() == ErrorCode::kStale);
        CHECK_EQ(error.detail().edge, "camera");
        CHECK_EQ(error.detail().stamp.value_or(0), 5);
        CHECK(!error.detail().oldest.has_value());
    }
}

TFDB_TEST(corrupt_messages_say_where_and_why) {
    const CorruptMessage error(17, "a name without an end");
    CHECK(error.code() == ErrorCode::kCorruptMessage);
    CHECK_EQ(error.detail().offset.value_or(0), 17U);
    CHECK_EQ(error.detail().reason, "a name without an end");
    CHECK_EQ(std::string(error.what()), "corrupt message at byte 17: a name without an end");
}

TFDB_TEST(limits_fit_into_one_word) {
    CHECK_EQ(kMaxFrames, 1'048'575U);
    CHECK_EQ(kMaxCommit, (CommitNumber{1} << 44) - 1);
    CHECK_EQ((kMaxCommit << kFrameBits | kNoFrame), ~std::uint64_t{0});
}

}  // namespace tfdb
