// What a lookup asks of the engine under it: one state of the forest, read frame by frame.
#pragma once

#include <concepts>
#include <cstdint>

#include "tfdb/base/types.hpp"
#include "tfdb/history/edge_view.hpp"

namespace tfdb::lookup {

/// The generation of a frame that is not in the view's state: none that a slot can have.
inline constexpr std::uint32_t kNoGeneration = ~std::uint32_t{0};

/// The seam between lookups and concurrency controls. An engine hands out a view of one state;
/// `open` is where it takes a lock, notes a version, or simply looks. `Edge` is what it opens: a
/// history::EdgeView, or something that answers the same questions.
template <class V>
concept View = requires(const V v, FrameId id, CommitNumber commit, typename V::Edge& edge) {
    typename V::Memory;
    { v.open(id, edge) } -> std::same_as<bool>;           // false: overtaken, start again
    { v.topology(id) } -> std::same_as<std::uint64_t>;    // a hint that may be newer than the view
    { v.alive(id) } -> std::same_as<bool>;                // does the frame exist in this state?
    { v.alive_since(id, commit) } -> std::same_as<bool>;  // ... and did it when that was written?
    { v.generation(id) } -> std::same_as<std::uint32_t>;
    { v.frame_count() } -> std::same_as<std::uint32_t>;
    { v.commit() } -> std::same_as<CommitNumber>;
};

/// How a step of a lookup ended.
enum class Outcome : std::uint8_t {
    kOk,
    kFailed,    // the answer is an error, and final
    kLapped,    // a writer overtook the reader: take the state anew
    kMismatch,  // the hints about the tree were of another state: walk by the samples
};

}  // namespace tfdb::lookup
