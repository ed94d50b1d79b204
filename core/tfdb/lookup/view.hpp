// The lookups' interface to the engine: one state of the forest, read frame by frame.
#pragma once

#include <concepts>
#include <cstdint>

#include "tfdb/base/types.hpp"
#include "tfdb/history/edge_view.hpp"

namespace tfdb::lookup {

/// The generation of a frame outside the view's state: no slot has it.
inline constexpr std::uint32_t kNoGeneration = ~std::uint32_t{0};

/// The interface between lookups and concurrency control. An engine returns a view of one state;
/// its `open` takes a lock, records a version, or just reads. It opens an `Edge`: a
/// history::EdgeView, or a type with the same functions.
template <class V>
concept View = requires(const V v, FrameId id, CommitNumber commit, typename V::Edge& edge) {
    typename V::Memory;
    { v.open(id, edge) } -> std::same_as<bool>;         // false: overtaken by a writer, start again
    { v.topology(id) } -> std::same_as<std::uint64_t>;  // a hint that may be newer than the view
    { v.alive(id) } -> std::same_as<bool>;              // whether the frame exists in this state
    // ... and existed when that commit was written
    { v.alive_since(id, commit) } -> std::same_as<bool>;
    { v.generation(id) } -> std::same_as<std::uint32_t>;
    { v.frame_count() } -> std::same_as<std::uint32_t>;
    { v.commit() } -> std::same_as<CommitNumber>;
};

/// The outcome of a lookup's step.
enum class Outcome : std::uint8_t {
    kOk,
    kFailed,    // the answer is an error, and final
    kLapped,    // a writer overtook the reader: load the state again
    kMismatch,  // the tree hints belong to another state: walk by the samples
};

}  // namespace tfdb::lookup
