// The edges that recorded transforms would create, without a store for their samples.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <unordered_map>

#include "tfdb/clock/stamp.hpp"
#include "tfdb/wire/tf_message.hpp"

namespace tfdb {

/// The edges of a store with unlimited history after the same writes. Refused transforms change
/// nothing.
/// Threads: one. Guarantee: if `add` throws, a part of the message may count.
class EdgeSurvey {
public:
    struct Edge {
        std::string parent;
        bool is_static;
        clock::StampNs first;  // of a moving edge
        clock::StampNs last;
    };
    struct Hash {
        using is_transparent = void;
        std::size_t operator()(std::string_view name) const {
            return std::hash<std::string_view>{}(name);
        }
    };
    /// By child.
    using Edges = std::unordered_map<std::string, Edge, Hash, std::equal_to<>>;

    /// A store's treatment of a transform.
    enum class Verdict : std::uint8_t {
        kStored,
        kRefused,
        kStaticConflict,  // refused: the edge has transforms of the other kind
    };

    /// Adds the transforms of one message that a store keeps.
    void add(std::span<const wire::TransformView> members, bool is_static);
    /// Adds one transform if a store keeps it.
    Verdict add(const wire::TransformView& member, bool is_static);

    [[nodiscard]] const Edges& edges() const { return edges_; }
    /// False: an edge had several parents, or edges form a cycle. Only a store can then decide what
    /// it keeps.
    [[nodiscard]] bool is_tree() const;

private:
    Edges edges_;
    bool one_parent_ = true;
};

}  // namespace tfdb
