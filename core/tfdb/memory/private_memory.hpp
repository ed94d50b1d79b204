// The region of a store that lives in one process: reserved address space, backed page by page.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>

#include "tfdb/base/types.hpp"
#include "tfdb/memory/block_sizes.hpp"
#include "tfdb/memory/memory.hpp"
#include "tfdb/sync/word.hpp"

namespace tfdb::memory {

/// One mapping of address space, a bump allocator and free lists, all state inside the region.
/// Threads: any.
/// Guarantee: `word`, `reclaimed` and the numbers of bytes are wait-free; the rest takes turns
/// under a lock of its own. A word stays readable for the life of the region, also in a released
/// block: a reader that was overtaken reads stale words, never unmapped memory.
class PrivateMemory {
public:
    using Word = sync::Word;
    static constexpr unsigned kPayloadWords = 7;
    static constexpr std::size_t kNoLimit = std::numeric_limits<std::size_t>::max();

    /// Reserves address space (no memory yet). Throws CapacityExceeded if none is to be had.
    explicit PrivateMemory(std::size_t limit_bytes = kNoLimit);
    ~PrivateMemory();
    PrivateMemory(const PrivateMemory&) = delete;
    PrivateMemory& operator=(const PrivateMemory&) = delete;
    PrivateMemory(PrivateMemory&&) = delete;
    PrivateMemory& operator=(PrivateMemory&&) = delete;

    [[nodiscard]] Word& word(Offset offset) const noexcept {
        return *reinterpret_cast<Word*>(base_ + offset);
    }

    /// Asks for the cache line of a word, and does not wait for it.
    void fetch(Offset offset) const noexcept { __builtin_prefetch(base_ + offset); }

    static void fence_acquire() noexcept { sync::fence_acquire(); }
    static void fence_release() noexcept { sync::fence_release(); }
    static void fence_full() noexcept { sync::fence_full(); }

    /// A block of at least `bytes`, line-aligned, content unspecified.
    /// Throws CapacityExceeded; nothing is changed then.
    Offset allocate(std::size_t bytes);
    /// A zeroed block that does not count as used: pages become memory when they are first touched.
    Offset allocate_sparse(std::size_t bytes);
    /// Takes back a block; `bytes` as asked for in `allocate`.
    void release(Offset offset, std::size_t bytes);

    /// Takes back a block that readers may still look at: it is kept as it is, but for words 5 to
    /// 7, until `reclaim`. The numbers of a line come in order, or nearly so.
    void retire(Line line, Offset offset, std::size_t bytes, std::uint64_t number);
    /// Releases blocks of a line in the order in which they came, as long as their number is at
    /// most `oldest` and more than `keep` bytes wait; so many at once that no call takes long.
    /// True: there may be more.
    bool reclaim(Line line, std::uint64_t oldest, std::size_t keep);
    /// Blocks that were retired with this number or a lower one may be in use again.
    [[nodiscard]] Word& reclaimed(Line line) const noexcept {
        return word(kReclaimedWord + 8 * static_cast<Offset>(line));
    }

    /// Bytes in blocks that are handed out or retired, in those of a line, and in blocks that wait
    /// to be used again.
    [[nodiscard]] std::size_t used_bytes() const noexcept;
    [[nodiscard]] std::size_t retired_bytes(Line line) const noexcept;
    [[nodiscard]] std::size_t free_bytes() const noexcept;

    /// The first block that is ever allocated: where the store keeps its own header.
    [[nodiscard]] static Offset root() noexcept;

private:
    // In a cache line of its own: all readers look at it.
    static constexpr Offset kReclaimedWord = kLineBytes;

    // All private functions: the lock is held.
    Offset bump(std::size_t bytes);
    Offset reuse_or_bump(const BlockClass& fit);
    void back_by_huge_pages(Offset end);
    static void count(Word& counter, std::size_t bytes);
    void put_back(Offset block, std::size_t bytes);
    [[nodiscard]] Word& line_word(Line line, Offset word) const noexcept;

    std::byte* base_ = nullptr;
    std::size_t reserved_ = 0;
    std::size_t limit_ = kNoLimit;
    std::size_t huge_pages_to_ = 0;
};

static_assert(Fetchable<PrivateMemory>);

}  // namespace tfdb::memory
