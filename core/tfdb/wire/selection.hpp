// Selects transforms of recorded messages, and renames their frames. One call decides for each
// edge; each transform then only needs a check of its stamp.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "tfdb/clock/stamp.hpp"
#include "tfdb/wire/tf_message.hpp"

namespace tfdb::wire {

/// The names of an edge's frames.
struct EdgeNames {
    std::string parent;
    std::string child;
};

/// The first and last stamp of kept moving transforms.
struct StampRange {
    clock::StampNs first = std::numeric_limits<clock::StampNs>::min();
    clock::StampNs last = std::numeric_limits<clock::StampNs>::max();

    [[nodiscard]] bool has(clock::StampNs stamp) const { return first <= stamp && stamp <= last; }
    void include(clock::StampNs stamp);
};

/// Removes transforms from messages, renames the frames of the others, and counts both.
/// Threads: one. Guarantee: if the choice throws, the message is unchanged or partly changed.
class Selection {
public:
    /// Returns the new names of an edge; empty to remove its transforms. `rule` distinguishes
    /// sources with different choices. Called once for each rule and edge.
    using Choose = std::function<std::optional<EdgeNames>(
        std::uint32_t rule, std::string_view parent, std::string_view child)>;
    /// An edge under the names in its messages.
    struct KeptEdge {
        std::uint32_t rule;
        std::string_view parent;
        std::string_view child;
    };

    explicit Selection(Choose choose, StampRange window = {});

    /// Keeps the selected transforms of one message in `members`. The names are views that are
    /// valid during the lifetime of this. The window keeps members without a valid stamp: the store
    /// refuses them. Returns whether any member was removed, renamed or shifted.
    bool apply(std::uint32_t rule, bool is_static, std::vector<TransformView>& members);

    /// Shifts the stamps of moving transforms that are kept from now on, after the window check.
    void set_shift(clock::StampNs shift) { shift_ = shift; }
    [[nodiscard]] clock::StampNs shift() const { return shift_; }

    [[nodiscard]] std::uint64_t left_out() const { return left_out_; }
    /// Number of kept moving transforms.
    [[nodiscard]] std::uint64_t moving() const { return moving_; }
    /// The stamps of moving transforms that only the window removed; empty if there were none.
    [[nodiscard]] const std::optional<StampRange>& outside() const { return outside_; }
    /// The edges with kept transforms. Valid until the next `apply`.
    [[nodiscard]] std::vector<KeptEdge> kept() const;

private:
    struct Key {
        std::uint32_t rule;
        std::string parent;
        std::string child;
    };
    struct Hash {
        using is_transparent = void;
        std::size_t operator()(const KeptEdge& key) const;
        std::size_t operator()(const Key& key) const;
    };
    struct Same {
        using is_transparent = void;
        template <class A, class B>
        bool operator()(const A& a, const B& b) const {
            return a.rule == b.rule && a.child == b.child && a.parent == b.parent;
        }
    };
    struct Edge {
        std::optional<EdgeNames> names;
        bool is_renamed = false;
        bool is_kept = false;
    };

    [[nodiscard]] Edge& edge(const KeptEdge& key);
    [[nodiscard]] const Edge* kept_edge(std::uint32_t rule, bool is_static,
                                        const TransformView& member);

    Choose choose_;
    StampRange window_;
    clock::StampNs shift_ = 0;
    std::unordered_map<Key, Edge, Hash, Same> edges_;
    std::uint64_t left_out_ = 0;
    std::uint64_t moving_ = 0;
    std::optional<StampRange> outside_;
};

}  // namespace tfdb::wire
