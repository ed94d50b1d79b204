// The region that holds a store: words addressed by offsets, and the blocks that contain them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "tfdb/base/types.hpp"
#include "tfdb/memory/block_sizes.hpp"
#include "tfdb/memory/mapping.hpp"
#include "tfdb/memory/memory.hpp"
#include "tfdb/sync/word.hpp"

namespace tfdb::memory {

/// One mapping, a bump allocator and free lists. All state is inside the region, so processes that
/// map the same file share one region. There only the holder of the commit lock allocates and
/// releases. After a death `repair` restores the allocator, and `sweep` finds lost blocks. Words 0
/// and 10 to 14 are the file's: see file.hpp.
/// Threads: any.
/// Guarantee: `word`, `reclaimed` and the byte counts are wait-free; the rest locks the region. A
/// word stays readable for the life of the region, even in a released block: an overtaken reader
/// reads stale words, never unmapped memory.
class Region {
public:
    using Word = sync::Word;
    static constexpr unsigned kPayloadWords = 7;
    static constexpr std::size_t kNoLimit = std::numeric_limits<std::size_t>::max();

    /// The region in the mapping; a new one if the mapping has none. Throws CapacityExceeded.
    explicit Region(std::size_t limit_bytes = kNoLimit) : Region(Mapping::reserve(), limit_bytes) {}
    explicit Region(Mapping mapping, std::size_t limit_bytes = kNoLimit);
    ~Region() = default;
    Region(const Region&) = delete;
    Region& operator=(const Region&) = delete;
    Region(Region&&) = delete;
    Region& operator=(Region&&) = delete;

    [[nodiscard]] Word& word(Offset offset) const noexcept {
        return *reinterpret_cast<Word*>(base_ + offset);
    }
    /// The block at an offset that was read from the region, forced inside: a damaged file may hold
    /// any offset.
    [[nodiscard]] Offset inside(Offset offset) const noexcept { return offset & mask_; }

    /// Prefetches the cache line of a word.
    void fetch(Offset offset) const noexcept { __builtin_prefetch(base_ + offset); }

    static void fence_acquire() noexcept { sync::fence_acquire(); }
    static void fence_release() noexcept { sync::fence_release(); }
    static void fence_full() noexcept { sync::fence_full(); }

    /// A block of at least `bytes`, line-aligned, content unspecified. Throws CapacityExceeded and
    /// then changes nothing.
    Offset allocate(std::size_t bytes);
    /// A zeroed block that does not count as used. Its pages get memory when they are first
    /// touched; in a file that requires a `touch` before.
    Offset allocate_sparse(std::size_t bytes);
    /// Backs the next part of a sparse block. All parts have this size and come in order; `first`:
    /// no part came before. Throws CapacityExceeded.
    void touch(Offset offset, std::size_t bytes, bool first) const;
    /// Releases a block; `bytes` as passed to `allocate`.
    void release(Offset offset, std::size_t bytes);

    /// Retires a block that readers may still access: except for words 5 to 7 it stays unchanged
    /// until `reclaim`. The numbers of a line are ascending, or nearly so.
    void retire(Line line, Offset offset, std::size_t bytes, std::uint64_t number);
    /// Releases blocks of a line in order, while their number is at most `oldest` and more than
    /// `keep` bytes wait. It bounds the number of blocks so that no call takes long. True: more may
    /// be releasable.
    bool reclaim(Line line, std::uint64_t oldest, std::size_t keep);
    /// Blocks retired with this number or a lower one may have been reused.
    [[nodiscard]] Word& reclaimed(Line line) const noexcept {
        return word(kReclaimedWord + 8 * static_cast<Offset>(line));
    }

    /// Bytes in allocated or retired blocks, in the retired blocks of a line, and in free blocks.
    [[nodiscard]] std::size_t used_bytes() const noexcept;
    [[nodiscard]] std::size_t retired_bytes(Line line) const noexcept;
    [[nodiscard]] std::size_t free_bytes() const noexcept;

    /// Whether nothing was allocated yet. A file's first block was made before it was published.
    [[nodiscard]] bool is_new() const noexcept;
    /// The first block ever allocated: the store's own header.
    [[nodiscard]] static Offset root() noexcept;
    /// End of the last block.
    [[nodiscard]] Offset end() const noexcept;
    /// Counts the range behind the last block, up to there, as used; the caller has filled it.
    void extend(Offset end) noexcept;
    [[nodiscard]] std::size_t capacity() const noexcept { return reserved_; }

    /// This process's pin words (see graph::Pins); null: the region's.
    [[nodiscard]] Word* pins() const noexcept { return pins_; }
    void set_pins(Word* pins) noexcept { pins_ = pins; }

    struct Block {
        Offset offset;
        std::size_t bytes;
    };
    /// Repairs the allocator after a process died; no other thread uses it. May be repeated. True:
    /// the process died inside the allocator, so large blocks may be lost until the next `sweep`.
    bool repair();
    /// Whether less than a quarter of the limit is left for new blocks.
    [[nodiscard]] bool is_short() const noexcept;
    /// Frees all blocks but these, including retired ones: no reader may need the others. Excludes
    /// other threads like `repair`. Reads in progress up to the given epoch, and states older than
    /// the commit, detect it.
    void sweep(std::vector<Block> in_use, std::uint64_t epoch, std::uint64_t commit);
    /// Returns the pages of large free blocks to the system until they are reused. It returns most
    /// after a `sweep`.
    void give_back();

private:
    class AtWork;
    // In a cache line of its own: all readers load it.
    static constexpr Offset kReclaimedWord = kLineBytes;

    // All private functions: the lock is held.
    Offset bump(std::size_t bytes);
    Offset reuse_or_bump(const BlockClass& fit);
    Offset cut_or_bump(const BlockClass& fit);
    struct Gap {
        Offset from = 0;
        Offset to = 0;
    };
    [[nodiscard]] Gap to_cut() const noexcept;
    bool has_to_cut(const BlockClass& fit);
    Offset cut(std::size_t bytes);
    void back(Offset end);
    void release_gap(Offset from, Offset to);
    static void count(Word& counter, std::size_t bytes);
    [[nodiscard]] bool is_block(Offset offset, std::size_t bytes) const noexcept;
    [[noreturn]] static void throw_damaged();
    [[nodiscard]] Word& given_back(Offset granule) const noexcept;
    bool give_back_granule(Offset from);
    void regain(Offset from, Offset to);
    [[nodiscard]] bool can_regain_line(Offset block) noexcept;
    void put_back(Offset block, const BlockClass& fit);
    void put_back_gap(Offset from, Offset to);
    void take_back(Offset block, std::size_t bytes);
    [[nodiscard]] Word& line_word(Line line, Offset word) const noexcept;

    Mapping mapping_;
    std::byte* base_;
    Offset mask_;
    std::size_t reserved_;
    std::size_t granule_;  // the unit in which memory is returned
    std::size_t limit_;
    Word* pins_ = nullptr;
};

static_assert(Fetchable<Region>);

}  // namespace tfdb::memory
