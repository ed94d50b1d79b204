// What the engine asks of the memory that it lives in.
#pragma once

#include <concepts>
#include <cstddef>
#include <cstdint>

#include "tfdb/base/types.hpp"

namespace tfdb::memory {

/// What a retired block waits for.
enum class Line : unsigned {
    kReplaced,  // no state shows it: for reads that began before an epoch
    kEnded,     // states before a commit show it, and may be held
};
inline constexpr unsigned kLines = 2;

/// A region of shared words addressed by byte offsets. In production it is mapped memory; under the
/// interleaving walker and under Relacy its words are the checker's, so the very same protocol code
/// is checked. `kPayloadWords` is 7 for poses and smaller in walks.
///
/// A block that readers may still look at is not released but retired, and waits in one of two
/// lines, with the number of the epoch or commit from which it is unused, until `reclaim`.
/// A reader of such a block finds by `reclaimed`, the greatest number that has gone, that it may
/// have read other content.
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

/// Memory whose lines may be asked for before they are needed. A checker's cannot: it has no cache,
/// and one step more for each line.
template <class M>
concept Fetchable = Memory<M> && requires(const M cm, Offset offset) {
    cm.fetch(offset);
};

inline constexpr std::size_t kLineBytes = 64;

/// The block that a word of the memory leads to, flags in its low bits aside; where the memory may
/// be damaged, it is brought inside.
template <class M>
[[nodiscard]] constexpr Offset inside(const M& memory, Offset offset) {
    if constexpr (requires { memory.inside(offset); })
        return memory.inside(offset);
    return offset & ~Offset{kLineBytes - 1};
}
/// The most entries that a list may have, whatever a damaged word says: so many find no room.
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
