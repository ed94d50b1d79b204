// Rewritten messages: copied, encoded, refused and left-out members.
#include "tfdb/store/message_rewriter.hpp"

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "tfdb/store/fixture.hpp"

namespace tfdb {
namespace {

using namespace fixture;
using wire::EdgeNames;
using wire::Encoding;
using wire::TransformView;
using Bytes = std::vector<std::byte>;

TransformView view(std::string_view parent, std::string_view child, StampNs stamp) {
    return {parent, child, stamp, pose_of(7)};
}

Bytes encoded(const std::vector<TransformView>& members, Encoding encoding) {
    Bytes out;
    wire::encode_tf_message(members, encoding, out);
    return out;
}

std::vector<std::string> names_of(std::span<const std::byte> message, Encoding encoding) {
    std::vector<TransformView> members;
    wire::decode_tf_message(message, encoding, members);
    std::vector<std::string> names;
    for (const TransformView& member : members)
        names.push_back(std::string(member.parent) + ">" + std::string(member.child));
    return names;
}

MessageRewriter::Origin from(Encoding encoding) {
    return {encoding, false, "node", 0};
}

/// Changes a byte of the name `from`, which occurs once in the message.
Bytes with_byte(Bytes message, char from, unsigned char to) {
    for (std::byte& each : message) {
        if (each == static_cast<std::byte>(from))
            each = static_cast<std::byte>(to);
    }
    return message;
}

wire::Selection renaming(std::string_view left_out = {}) {
    return wire::Selection([left_out](std::uint32_t, std::string_view parent,
                                      std::string_view child) -> std::optional<EdgeNames> {
        if (child == left_out)
            return std::nullopt;
        const std::string prefix = child == "arm" ? "r/" : "";
        return EdgeNames{std::string(parent), prefix + std::string(child)};
    });
}

}  // namespace

TFDB_TEST(message_rewriter_copies_messages_that_stay_as_they_are) {
    for (const Encoding encoding : {Encoding::kRos1, Encoding::kCdr}) {
        const Bytes message = encoded({view("map", "base", 5), view("base", "cam", 6)}, encoding);
        MessageRewriter rewriter(encoding);
        wire::Selection selection = renaming("other");
        for (wire::Selection* chosen : {static_cast<wire::Selection*>(nullptr), &selection})
            CHECK(rewriter.rewrite(message, from(encoding), chosen).data() == message.data());
        CHECK_EQ(rewriter.counts().messages, 2U);
        CHECK_EQ(rewriter.counts().transforms, 4U);
    }
}

TFDB_TEST(message_rewriter_encodes_what_changes) {
    const Bytes message = encoded(
        {view("map", "base", 5), view("base", "arm", 6), view("arm", "tool", 6)}, Encoding::kCdr);
    MessageRewriter rewriter(Encoding::kCdr);
    wire::Selection selection = renaming("tool");
    const auto made = rewriter.rewrite(message, from(Encoding::kCdr), &selection);
    CHECK((names_of(made, Encoding::kCdr) == std::vector<std::string>{"map>base", "base>r/arm"}));
    CHECK_EQ(rewriter.counts().transforms, 2U);
    const Bytes alone = encoded({view("arm", "tool", 6)}, Encoding::kCdr);
    CHECK(rewriter.rewrite(alone, from(Encoding::kCdr), &selection).data() == nullptr);
    CHECK_EQ(rewriter.counts().left_out, 1U);
    CHECK(rewriter.refusals().empty());
}

TFDB_TEST(message_rewriter_writes_one_layout) {
    const std::vector<TransformView> members{view("map", "base", 5)};
    for (const Encoding encoding : {Encoding::kRos1, Encoding::kCdrBig, Encoding::kCdr2Little}) {
        const Bytes message = encoded(members, encoding);
        MessageRewriter rewriter(Encoding::kCdr);
        const Encoding said = encoding == Encoding::kRos1 ? encoding : Encoding::kCdr;
        const auto made = rewriter.rewrite(message, from(said), nullptr);
        CHECK((Bytes(made.begin(), made.end()) == encoded(members, Encoding::kCdr)));
    }
    MessageRewriter rewriter(Encoding::kRos1);
    const auto made =
        rewriter.rewrite(encoded(members, Encoding::kCdr), from(Encoding::kCdr), nullptr);
    CHECK((Bytes(made.begin(), made.end()) == encoded(members, Encoding::kRos1)));
}

TFDB_TEST(message_rewriter_refuses_members_alone) {
    const Bytes good = encoded({view("map", "base", 5), view("map", "c#m", 6)}, Encoding::kCdr);
    for (const unsigned bad : {0x00U, 0xFFU}) {
        const Bytes message = with_byte(good, '#', static_cast<unsigned char>(bad));
        MessageRewriter rewriter(Encoding::kCdr);
        const auto made = rewriter.rewrite(message, from(Encoding::kCdr), nullptr);
        CHECK((names_of(made, Encoding::kCdr) == std::vector<std::string>{"map>base"}));
        CHECK_EQ(rewriter.counts().refused, 1U);
        CHECK_EQ(rewriter.refusals().size(), 1U);
        CHECK(rewriter.refusals()[0].code == ErrorCode::kInvalidName);
        CHECK(!rewriter.refusals()[0].is_message);
    }
    // A control character in a name does not prevent copying.
    const Bytes odd = with_byte(good, '#', '\n');
    MessageRewriter rewriter(Encoding::kCdr);
    CHECK(rewriter.rewrite(odd, from(Encoding::kCdr), nullptr).data() == odd.data());
}

TFDB_TEST(message_rewriter_refuses_messages_of_which_nothing_can_be_read) {
    MessageRewriter rewriter(Encoding::kCdr);
    Bytes cut = encoded({view("map", "base", 5)}, Encoding::kCdr);
    cut.pop_back();
    CHECK(rewriter.rewrite(cut, from(Encoding::kCdr), nullptr).data() == nullptr);
    const Bytes bad = with_byte(encoded({view("map", "c#m", 5)}, Encoding::kCdr), '#', 0xFF);
    CHECK(rewriter.rewrite(bad, from(Encoding::kCdr), nullptr).data() == nullptr);
    CHECK(rewriter.rewrite(bad, from(Encoding::kCdr), nullptr).data() == nullptr);
    CHECK_EQ(rewriter.counts().broken, 3U);
    CHECK_EQ(rewriter.counts().refused, 0U);
    CHECK_EQ(rewriter.refusals().size(), 2U);
    CHECK(rewriter.refusals()[0].code == ErrorCode::kCorruptMessage);
    CHECK(rewriter.refusals()[1].code == ErrorCode::kInvalidName);
    CHECK_EQ(rewriter.refusals()[1].count, 2U);
    CHECK(rewriter.refusals()[1].is_message);
    const Bytes empty = encoded({}, Encoding::kCdr);
    CHECK(rewriter.rewrite(empty, from(Encoding::kCdr), nullptr).data() == empty.data());
}

TFDB_TEST(message_rewriter_refuses_stamps_that_the_other_encoding_cannot_hold) {
    constexpr StampNs kLate = 2'200'000'000 * kSecond;  // later than 2^31 seconds, and a stamp
    MessageRewriter rewriter(Encoding::kCdr);
    const Bytes message =
        encoded({view("map", "base", 5), view("map", "cam", kLate)}, Encoding::kRos1);
    const auto made = rewriter.rewrite(message, from(Encoding::kRos1), nullptr);
    CHECK((names_of(made, Encoding::kCdr) == std::vector<std::string>{"map>base"}));
    CHECK_EQ(rewriter.counts().refused, 1U);
    CHECK(rewriter.refusals()[0].code == ErrorCode::kInvalidStamp);
    CHECK_EQ(rewriter.refusals()[0].edge, "cam");
}

TFDB_TEST(message_rewriter_keeps_the_slash_before_each_name_that_stays) {
    TransformView first = view("map", "odom", 5);
    TransformView second = view("odom", "arm", 6);
    first.slash_before_parent = first.slash_before_child = true;
    second.slash_before_parent = second.slash_before_child = true;
    for (const Encoding to : {Encoding::kRos1, Encoding::kCdr}) {
        for (const Encoding had : {Encoding::kRos1, Encoding::kCdr}) {
            MessageRewriter rewriter(to);
            wire::Selection selection = renaming();
            const Bytes stays = encoded({first}, had);
            const auto same = rewriter.rewrite(stays, from(had), &selection);
            CHECK((Bytes(same.begin(), same.end()) == encoded({first}, to)));
            // One member of the message is renamed.
            const Bytes changes = encoded({first, second}, had);
            const auto made = rewriter.rewrite(changes, from(had), &selection);
            TransformView renamed = second;
            renamed.child = "r/arm";
            renamed.slash_before_child = false;
            CHECK((Bytes(made.begin(), made.end()) == encoded({first, renamed}, to)));
        }
    }
}

TFDB_TEST(message_rewriter_keeps_empty_names) {
    const Bytes message = encoded({view("map", "arm", 5), view("map", "", 6)}, Encoding::kCdr);
    MessageRewriter rewriter(Encoding::kCdr);
    wire::Selection selection = renaming("other");
    const auto made = rewriter.rewrite(message, from(Encoding::kCdr), &selection);
    CHECK((names_of(made, Encoding::kCdr) == std::vector<std::string>{"map>r/arm", "map>"}));
    CHECK(rewriter.refusals().empty());
}

}  // namespace tfdb
