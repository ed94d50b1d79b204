// Which transforms of recorded messages are kept, and the names of their frames. One question about
// each edge decides; for each transform there remains a look at its stamp.
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

/// The first and the last stamp of the moving transforms that are kept.
struct StampRange {
    clock::StampNs first = std::numeric_limits<clock::StampNs>::min();
    clock::StampNs last = std::numeric_limits<clock::StampNs>::max();

    [[nodiscard]] bool has(clock::StampNs stamp) const { return first <= stamp && stamp <= last; }
    void include(clock::StampNs stamp);
};

/// Leaves transforms out of messages, gives the frames of the others their names, and counts both.
/// Threads: one. Guarantee: what the choice throws leaves the message as it was, or in part done.
class Selection {
public:
    /// Returns the new names of an edge; nothing leaves its transforms out. `rule` distinguishes
    /// sources to which different choices apply. Called once for each rule and edge.
    using Choose = std::function<std::optional<EdgeNames>(
        std::uint32_t rule, std::string_view parent, std::string_view child)>;
    /// An edge under the names that its messages have.
    struct KeptEdge {
        std::uint32_t rule;
        std::string_view parent;
        std::string_view child;
    };

    explicit Selection(Choose choose, StampRange window = {});

    /// Leaves in `members` what is kept of one message. The names are views that are valid while
    /// this lives. The window keeps members without a valid stamp: the store refuses them. Returns
    /// whether any member was left out, renamed or shifted.
    bool apply(std::uint32_t rule, bool is_static, std::vector<TransformView>& members);

    /// Adds this to the stamps of moving transforms that are kept from now on, behind the window.
    void set_shift(clock::StampNs shift) { shift_ = shift; }
    [[nodiscard]] clock::StampNs shift() const { return shift_; }

    [[nodiscard]] std::uint64_t left_out() const { return left_out_; }
    /// Moving transforms that were kept.
    [[nodiscard]] std::uint64_t moving() const { return moving_; }
    /// The stamps of moving transforms that only the window left out; nothing: there were none.
    [[nodiscard]] const std::optional<StampRange>& outside() const { return outside_; }
    /// The edges of which transforms were kept. Valid until the next `apply`.
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
