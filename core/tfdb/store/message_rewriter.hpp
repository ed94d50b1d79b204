// Rewrites recorded messages for another recording: selects, renames, re-encodes.
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

/// Rewrites TFMessages and counts the results. An unchanged message keeps its bytes. A member with
/// a stamp or name that no message can have affects only itself.
/// Threads: one. Guarantee: if `rewrite` throws, the message may be partly counted.
class MessageRewriter {
public:
    /// The source of a message.
    struct Origin {
        wire::Encoding encoding;
        bool is_static;
        std::string_view authority;
        /// For `Selection::apply`.
        std::uint32_t rule;
    };
    /// Members of one edge refused with one error, or messages refused as a whole.
    struct Refusal {
        std::string edge;
        ErrorCode code;
        bool is_message;
        std::uint64_t count;
        std::string first;
    };
    struct Counts {
        std::uint64_t messages = 0;    // written
        std::uint64_t transforms = 0;  // in written messages
        std::uint64_t refused = 0;     // refused members of messages that were written
        std::uint64_t broken = 0;      // messages that could not be written
        std::uint64_t left_out = 0;    // messages emptied by the selection
    };

    explicit MessageRewriter(wire::Encoding to) : to_(to) {}

    /// Returns the message to write: its own bytes, or bytes valid until the next call. Empty if no
    /// message is to be written. Without a selection all members are kept.
    std::span<const std::byte> rewrite(std::span<const std::byte> message, const Origin& from,
                                       wire::Selection* selection);

    [[nodiscard]] const Counts& counts() const { return counts_; }
    /// In order of first occurrence.
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
    std::vector<Fault> faults_;  // of the current message
    std::vector<std::byte> out_;
    std::vector<Refusal> refusals_;
    std::map<std::tuple<std::string, ErrorCode, bool>, std::size_t> places_;
};

}  // namespace tfdb
