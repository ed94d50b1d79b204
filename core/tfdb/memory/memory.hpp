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
template <class M>
concept Memory = requires(M m, const M cm, Offset offset, std::size_t bytes) {
    typename M::Word;
    { M::kPayloadWords } -> std::convertible_to<unsigned>;
    { m.word(offset) } -> std::same_as<typename M::Word&>;
    { m.allocate(bytes) } -> std::same_as<Offset>;
    m.release(offset, bytes);
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
