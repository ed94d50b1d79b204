// Recorded messages into another recording: chosen, renamed, in another encoding.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <tuple>
#include <vector>

#include "tfdb/base/error.hpp"
#include "tfdb/wire/selection.hpp"
#include "tfdb/wire/tf_message.hpp"

namespace tfdb {

/// Writes TFMessages again, and counts what becomes of them. A message that stays as it is keeps
/// its bytes. A member without a stamp or name that a message can have costs only itself. Threads:
/// one. Guarantee: a message for which `rewrite` throws counts in part.
class MessageRewriter {
public:
    /// Where a message comes from.
    struct Origin {
        wire::Encoding encoding;
        bool is_static;
        std::string_view authority;
        /// For `Selection::apply`.
        std::uint32_t rule;
    };
    /// What was refused of one edge with one error, or of messages as a whole.
    struct Refusal {
        std::string edge;
        ErrorCode code;
        bool is_message;
        std::uint64_t count;
        std::string first;
    };
    struct Counts {
        std::uint64_t messages = 0;    // written
        std::uint64_t transforms = 0;  // in these
        std::uint64_t refused = 0;     // members of messages of which others were not refused
        std::uint64_t broken = 0;      // messages of which nothing can be written
        std::uint64_t left_out = 0;    // messages of which the selection left nothing
    };

    explicit MessageRewriter(wire::Encoding to) : to_(to) {}

    /// Returns the message to be written: its own bytes, or some that are valid until the next
    /// call. Without data where none is to be written. Without a selection everything is kept.
    std::span<const std::byte> rewrite(std::span<const std::byte> message, const Origin& from,
                                       wire::Selection* selection);

    [[nodiscard]] const Counts& counts() const { return counts_; }
    /// In the order of the first of each.
    [[nodiscard]] const std::vector<Refusal>& refusals() const { return refusals_; }

private:
    using Bytes = std::span<const std::byte>;

    [[nodiscard]] bool take_readable(const Origin& from);
    [[nodiscard]] bool keeps_layout(Bytes message, wire::Encoding from) const;
    Bytes encode();
    Bytes break_with(const Error& error);
    void refuse_members();
    void refuse(std::string_view edge, const Error& error, bool is_message);

    struct Fault {
        std::string edge;
        Error error;
    };

    wire::Encoding to_;
    Counts counts_;
    std::vector<wire::TransformView> members_;
    std::vector<Fault> faults_;  // of the message that is rewritten
    std::vector<std::byte> out_;
    std::vector<Refusal> refusals_;
    std::map<std::tuple<std::string, ErrorCode, bool>, std::size_t> places_;
};

}  // namespace tfdb
