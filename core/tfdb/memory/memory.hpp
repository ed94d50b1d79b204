// The engine's requirements on the memory that holds it.
#pragma once

#include <concepts>
#include <cstddef>
#include <cstdint>

#include "tfdb/base/types.hpp"

namespace tfdb::memory {

/// The condition under which a retired block is freed.
enum class Line : unsigned {
    kReplaced,  // no state shows it: freed once reads that began before an epoch have ended
    kEnded,     // states before a commit show it, and snapshots may hold them
};
inline constexpr unsigned kLines = 2;

/// A region of shared words addressed by byte offsets. In production it is mapped memory. Under the
/// interleaving walker and under Relacy its words are the checker's, so the checkers run the very
/// same protocol code. `kPayloadWords` is 7 for poses and smaller in walks.
///
/// A block that readers may still access is retired instead of released. It waits in one of two
/// lines until `reclaim`, with the number of the epoch or commit from which it is unused.
/// `reclaimed` is the greatest number that has been freed: a reader of such a block learns from it
/// that it may have read other content.
template <class M>
concept Memory = requires(M m, const M cm, Offset offset, std::size_t bytes) {
    typename M::Word;
    { M::kPayloadWords } -> std::convertible_to<unsigned>;
    { m.word(offset) } -> std::same_as<typename M::Word&>;
    { m.allocate(bytes) } -> std::same_as<Offset>;
    m.release(offset, bytes);
    m.retire(Line{}, offset, bytes, std::uint64_t{});
    { m.reclaim(Line{}, std::uint64_t{}, std::size_t{}) } -> std::same_as<bool>;
    { cm.retired_bytes(Line{}) } -> std::same_as<std::size_t>;
    { cm.reclaimed(Line{}) } -> std::same_as<typename M::Word&>;
    M::fence_acquire();
    M::fence_release();
    M::fence_full();
};

/// Memory that can prefetch cache lines. A checker's memory cannot: it has no cache, and each
/// prefetch would be one more step.
template <class M>
concept Fetchable = Memory<M> && requires(const M cm, Offset offset) {
    cm.fetch(offset);
};

inline constexpr std::size_t kLineBytes = 64;

/// The block that a word of the memory points to, without the flags in its low bits. If the memory
/// may be damaged, the offset is forced inside.
template <class M>
[[nodiscard]] constexpr Offset inside(const M& memory, Offset offset) {
    if constexpr (requires { memory.inside(offset); })
        return memory.inside(offset);
    return offset & ~Offset{kLineBytes - 1};
}
/// The upper bound on a list's entries, even if a damaged word claims more: no more fit.
template <class M>
[[nodiscard]] constexpr std::uint64_t most_entries(const M& memory, std::uint64_t entries) {
    if constexpr (requires { memory.capacity(); })
        return entries < memory.capacity() / (2 * kLineBytes)
                   ? entries
                   : memory.capacity() / (2 * kLineBytes);
    return entries;
}

constexpr std::size_t round_up(std::size_t bytes, std::size_t multiple) {
    return (bytes + multiple - 1) / multiple * multiple;
}

}  // namespace tfdb::memory
