// What a write must satisfy, and the errors that say what it does not.
#pragma once

#include <cstdint>
#include <span>
#include <string_view>

#include "tfdb/store/impl.hpp"

namespace tfdb::store {

/// Whether `check_batch` would find nothing.
[[nodiscard]] bool is_sound(std::span<const TransformView> batch, bool is_static) noexcept;

/// Checks what can be checked without the store: stamps and numbers.
/// Throws InvalidStamp, InvalidTransform with the index of the first bad member.
void check_batch(std::span<const TransformView> batch, bool is_static, std::string_view authority);

/// Checks the names of a member of which one is new to the store. Throws InvalidName.
void check_names(const TransformView& transform, std::size_t index, std::string_view authority);

/// Whether `check_edge` would find nothing. The newest committed sample is what counts.
[[nodiscard]] inline bool is_storable(const Reads::Impl& impl, FrameId child,
                                      const TransformView& transform, bool is_static) {
    const history::EdgeWriter<StoreMemory> edge(impl.frames.memory(), impl.frames.header(child));
    if (!edge.has_samples())
        return true;
    const bool was_static = (edge.topology() & history::Topology::kStatic) != 0;
    return was_static == is_static &&
           (is_static || transform.stamp >= edge.newest() - impl.history);
}

/// Checks a sample against its edge. Throws StaticConflict, TooOld.
void check_edge(const Reads::Impl& impl, FrameId child, const TransformView& transform,
                std::size_t index, bool is_static, std::string_view authority);

[[noreturn]] void throw_cycle(const TransformView& transform, std::size_t index,
                              std::string_view authority);

/// A frame name as it may stand in a message: quoted, cut when long, control characters escaped.
std::string quoted(std::string_view name);

}  // namespace tfdb::store
