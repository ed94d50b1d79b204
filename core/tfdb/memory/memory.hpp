// What the engine asks of the memory that it lives in.
#pragma once

#include <concepts>
#include <cstddef>
#include <cstdint>

#include "tfdb/base/types.hpp"

namespace tfdb::memory {

/// A region of shared words addressed by byte offsets. In production it is mapped memory; under the
/// interleaving walker and under Relacy its words are the checker's, so the very same protocol code
/// is checked. `kPayloadWords` is 7 for poses and smaller in walks.
///
/// A block that readers may still look at is not released but retired, by a commit: readers of that
/// commit or a later one have no way to it. It waits in line until `reclaim`; whoever reads an
/// older state finds by `reclaimed`, the greatest commit whose blocks have gone, that it may have
/// read something else.
template <class M>
concept Memory = requires(M m, const M cm, Offset offset, std::size_t bytes) {
    typename M::Word;
    { M::kPayloadWords } -> std::convertible_to<unsigned>;
    { m.word(offset) } -> std::same_as<typename M::Word&>;
    { m.allocate(bytes) } -> std::same_as<Offset>;
    m.release(offset, bytes);
    m.retire(offset, bytes, CommitNumber{});
    m.reclaim(CommitNumber{}, std::size_t{});
    { cm.retired_bytes() } -> std::same_as<std::size_t>;
    { cm.reclaimed() } -> std::same_as<typename M::Word&>;
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

constexpr std::size_t round_up(std::size_t bytes, std::size_t multiple) {
    return (bytes + multiple - 1) / multiple * multiple;
}

}  // namespace tfdb::memory
