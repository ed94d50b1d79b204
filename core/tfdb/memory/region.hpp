// The region that a store lives in: words addressed by offsets, and the blocks that they lie in.
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

/// One mapping, a bump allocator and free lists, all state inside the region, so that processes
/// which map the same file have one region. There only the holder of the commit lock allocates and
/// releases; a death leaves what `repair` puts right, and blocks that `sweep` finds. Words 0
/// and 10 to 14 are the file's: see file.hpp.
/// Threads: any.
/// Guarantee: `word`, `reclaimed` and the numbers of bytes are wait-free; the rest takes turns
/// under a lock of its own. A word stays readable for the life of the region, also in a released
/// block: a reader that was overtaken reads stale words, never unmapped memory.
class Region {
public:
    using Word = sync::Word;
    static constexpr unsigned kPayloadWords = 7;
    static constexpr std::size_t kNoLimit = std::numeric_limits<std::size_t>::max();

    /// The region in the mapping; a new one where that has none. Throws CapacityExceeded.
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
    /// The block at an offset that was read from the region: what a damaged file says leads into
    /// it, too.
    [[nodiscard]] Offset inside(Offset offset) const noexcept { return offset & mask_; }

    /// Asks for the cache line of a word, and does not wait for it.
    void fetch(Offset offset) const noexcept { __builtin_prefetch(base_ + offset); }

    static void fence_acquire() noexcept { sync::fence_acquire(); }
    static void fence_release() noexcept { sync::fence_release(); }
    static void fence_full() noexcept { sync::fence_full(); }

    /// A block of at least `bytes`, line-aligned, content unspecified.
    /// Throws CapacityExceeded; nothing is changed then.
    Offset allocate(std::size_t bytes);
    /// A zeroed block that does not count as used: pages become memory when they are first touched,
    /// which in a file is only allowed after `touch`.
    Offset allocate_sparse(std::size_t bytes);
    /// Readies the next part of a sparse block for use, of parts that all have this size and come
    /// in order; `first`: none came before. Throws CapacityExceeded.
    void touch(Offset offset, std::size_t bytes, bool first) const;
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

    /// Whether nothing was allocated yet: what is in a file was made before it was published.
    [[nodiscard]] bool is_new() const noexcept;
    /// The first block that is ever allocated: where the store keeps its own header.
    [[nodiscard]] static Offset root() noexcept;
    /// Behind the last block.
    [[nodiscard]] Offset end() const noexcept;
    /// What the caller puts behind the last block, up to there, counts as used from now on.
    void extend(Offset end) noexcept;
    [[nodiscard]] std::size_t capacity() const noexcept { return reserved_; }

    /// This process's pin words (see graph::Pins); null: those of the region.
    [[nodiscard]] Word* pins() const noexcept { return pins_; }
    void set_pins(Word* pins) noexcept { pins_ = pins; }

    struct Block {
        Offset offset;
        std::size_t bytes;
    };
    /// Repairs the allocator after a process died; no other thread uses it. May be repeated.
    /// True: it died in the allocator, so large blocks may be lost until the next `sweep`.
    bool repair();
    /// Less than a quarter of what blocks may take is left for new ones.
    [[nodiscard]] bool is_short() const noexcept;
    /// Frees all but these blocks, retired ones too: no reader may need them. As `repair`; reads
    /// that are under way, up to the given epoch, and states older than the commit find out.
    void sweep(std::vector<Block> in_use, std::uint64_t epoch, std::uint64_t commit);
    /// Gives the pages of large free blocks back to the system, until they are used again. Most is
    /// to be had after a `sweep`.
    void give_back();

private:
    class AtWork;
    // In a cache line of its own: all readers look at it.
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
    std::size_t granule_;  // how much is given back at a time
    std::size_t limit_;
    Word* pins_ = nullptr;
};

static_assert(Fetchable<Region>);

}  // namespace tfdb::memory
