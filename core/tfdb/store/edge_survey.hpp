// Which edges recorded transforms would make, without a store for their samples.
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

/// The edges that a store with unlimited history has after the same writes. Transforms that it
/// refuses change nothing.
/// Threads: one. Guarantee: none of a message that `add` throws for counts, or a part of it.
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

    /// What a store does with a transform.
    enum class Verdict : std::uint8_t {
        kStored,
        kRefused,
        kStaticConflict,  // refused: the edge has transforms of the other kind
    };

    /// Adds what a store keeps of one message.
    void add(std::span<const wire::TransformView> members, bool is_static);
    /// Adds one transform if a store keeps it.
    Verdict add(const wire::TransformView& member, bool is_static);

    [[nodiscard]] const Edges& edges() const { return edges_; }
    /// False: an edge had several parents, or edges form a circle. Only a store decides what it
    /// keeps then.
    [[nodiscard]] bool is_tree() const;

private:
    Edges edges_;
    bool one_parent_ = true;
};

}  // namespace tfdb
