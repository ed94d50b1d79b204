#include "tfdb/store/message_rewriter.hpp"

#include <algorithm>
#include <optional>
#include <utility>

#include "tfdb/store/buffer.hpp"
#include "tfdb/store/validate.hpp"

namespace tfdb {
namespace {

using wire::TransformView;

/// Why no message can hold the member; none if one can.
std::optional<Error> fault_in_message(const TransformView& member, std::size_t index,
                                      const MessageRewriter::Origin& from) {
    const bool is_readable = clock::is_stamp(member.stamp) && store::is_text(member.parent) &&
                             store::is_text(member.child);
    if (is_readable)
        return std::nullopt;
    return fault_of(member, index, from.is_static, from.authority);
}

}  // namespace

std::span<const std::byte> MessageRewriter::rewrite(Bytes message, const Origin& from,
                                                    wire::Selection* selection) {
    try {
        wire::decode_tf_message(message, from.encoding, members_);
    } catch (const CorruptMessage& error) {
        return break_with(error);
    }
    const std::size_t given = members_.size();
    bool is_same = take_readable(from);
    if (members_.empty() && given != 0)
        return break_with(faults_.front().error);
    refuse_members();
    if (selection != nullptr && selection->apply(from.rule, from.is_static, members_))
        is_same = false;
    if (members_.empty() && given != 0) {
        ++counts_.left_out;
        return {};
    }
    const Bytes made = is_same && keeps_layout(message, from.encoding) ? message : encode();
    if (made.data() != nullptr) {
        ++counts_.messages;
        counts_.transforms += members_.size();
    }
    return made;
}

/// Moves unreadable members into `faults_`. Returns whether all members are unchanged.
bool MessageRewriter::take_readable(const Origin& from) {
    faults_.clear();
    bool is_same = true;
    std::size_t index = 0;
    std::erase_if(members_, [&](TransformView& member) {
        // a store ignores the stamp of a static transform
        if (from.is_static && member.stamp > clock::kMaxStamp) {
            member.stamp = clock::kMaxStamp;
            is_same = false;
        }
        std::optional<Error> fault = fault_in_message(member, index++, from);
        if (!fault)
            return false;
        faults_.push_back({std::string(member.child.substr(0, kMaxNameBytes)), std::move(*fault)});
        return true;
    });
    return is_same && faults_.empty();
}

bool MessageRewriter::keeps_layout(Bytes message, wire::Encoding from) const {
    if (to_ == wire::Encoding::kRos1 || from == wire::Encoding::kRos1)
        return to_ == from;
    constexpr auto kLittle = std::byte{1};  // of plain CDR
    return to_ == wire::Encoding::kCdr && from == to_ && message[1] == kLittle;
}

std::span<const std::byte> MessageRewriter::encode() {
    try {
        wire::encode_tf_message(members_, to_, out_);
        return out_;
    } catch (const Error& whole) {
        faults_.clear();
        std::erase_if(members_, [&](const TransformView& member) {
            try {
                wire::encode_tf_message({&member, 1}, to_, out_);
                return false;
            } catch (const Error& error) {
                faults_.push_back({std::string(member.child), error});
                return true;
            }
        });
        if (members_.empty())
            return break_with(whole);
    }
    refuse_members();
    wire::encode_tf_message(members_, to_, out_);
    return out_;
}

std::span<const std::byte> MessageRewriter::break_with(const Error& error) {
    refuse({}, error, true);
    ++counts_.broken;
    return {};
}

void MessageRewriter::refuse_members() {
    for (const Fault& fault : faults_)
        refuse(fault.edge, fault.error, false);
    counts_.refused += faults_.size();
}

void MessageRewriter::refuse(std::string_view edge, const Error& error, bool is_message) {
    const auto [place, is_new] = places_.try_emplace(
        std::tuple(std::string(edge), error.code(), is_message), refusals_.size());
    if (is_new)
        refusals_.push_back({std::string(edge), error.code(), is_message, 0, error.what()});
    ++refusals_[place->second].count;
}

}  // namespace tfdb
