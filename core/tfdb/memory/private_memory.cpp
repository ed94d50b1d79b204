#include "tfdb/memory/private_memory.hpp"

#include <sys/mman.h>

#include <algorithm>
#include <bit>
#include <mutex>
#include <string>

#include "tfdb/base/error.hpp"
#include "tfdb/sync/commit_lock.hpp"

namespace tfdb::memory {
namespace {

constexpr Offset kBumpWord = 8;
constexpr Offset kUsedWord = 16;
constexpr Offset kFreeWord = 24;
constexpr Offset kLockWord = 32;
// Of each line of retired blocks.
constexpr Offset kLineWords = 2 * kLineBytes;
constexpr Offset kFirstRetired = 0;
constexpr Offset kLastRetired = 8;
constexpr Offset kRetiredBytes = 16;
constexpr std::size_t kLineWordBytes = 32;
constexpr Offset kHeads = kLineWords + kLines * kLineWordBytes;  // one free list per size class
constexpr unsigned kMostReclaimed = 64;                          // by one call
// Words of a retired block.
constexpr Offset kNext = 40;
constexpr Offset kBytes = 48;
constexpr Offset kNumber = 56;
constexpr Offset kFirstBlock = round_up(kHeads + 8 * kSizeClasses, kLineBytes);

constexpr std::size_t kLargestReserve = std::size_t{1} << 38;   // 256 GiB of addresses
constexpr std::size_t kFairReserve = std::size_t{1} << 30;      // 1 GiB: also where stores are many
constexpr std::size_t kSmallestReserve = std::size_t{1} << 28;  // 256 MiB: if no more is to be had
// A process has 128 TiB of addresses. Half of them go to stores that may be large; each takes no
// more than this part of what is left of that half, so that thousands of stores find room.
constexpr std::size_t kShared = std::size_t{1} << 46;
constexpr std::size_t kPart = 256;
constexpr std::size_t kHugePage = std::size_t{1} << 21;
// Large blocks at power-of-two distances collide in the caches; three odd lines spread them.
constexpr std::size_t kSkewFrom = std::size_t{1} << 16;
constexpr std::size_t kSkewBytes = 3 * kLineBytes;

sync::Word g_reserved;  // by all stores of this process

/// How much to ask for. Two at once may both count the same bytes as left: it is a measure, no
/// limit.
std::size_t reserve_wanted() {
    const std::size_t taken = g_reserved.load_relaxed();
    const std::size_t left = taken < kShared ? kShared - taken : 0;
    return std::clamp(std::bit_floor(left / kPart), kFairReserve, kLargestReserve);
}

}  // namespace

PrivateMemory::PrivateMemory(std::size_t limit_bytes) : limit_(limit_bytes) {
    for (std::size_t size = reserve_wanted(); size >= kSmallestReserve; size /= 2) {
        void* mapped = ::mmap(nullptr, size, PROT_READ | PROT_WRITE,
                              MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
        if (mapped == MAP_FAILED)
            continue;
        base_ = static_cast<std::byte*>(mapped);
        reserved_ = size;
        g_reserved.fetch_add(size);
        huge_pages_to_ = kHugePage;
        word(kBumpWord).store_relaxed(kFirstBlock);
        return;
    }
    throw CapacityExceeded("cannot reserve address space for a store: raise `ulimit -v`");
}

PrivateMemory::~PrivateMemory() {
    ::munmap(base_, reserved_);
    g_reserved.fetch_add(std::uint64_t{0} - reserved_);
}

Offset PrivateMemory::root() noexcept {
    return kFirstBlock;
}

Offset PrivateMemory::bump(std::size_t bytes) {
    const std::size_t skew = bytes >= kSkewFrom ? kSkewBytes : 0;
    const Offset at = word(kBumpWord).load_relaxed();
    if (bytes + skew > reserved_ - at) {
        throw CapacityExceeded("the store's address space of " + std::to_string(reserved_) +
                               " bytes is full: give it a shorter history");
    }
    word(kBumpWord).store_relaxed(at + bytes + skew);
    return at;
}

/// Page-table misses cost writers of many cold edges a factor of four (measured).
void PrivateMemory::back_by_huge_pages(Offset end) {
    if (end <= huge_pages_to_)
        return;
    const std::size_t to = round_up(end, kHugePage);
    ::madvise(base_ + huge_pages_to_, to - huge_pages_to_, MADV_HUGEPAGE);
    huge_pages_to_ = to;
}

/// Adds to a counter that others only read meanwhile; `bytes` may be a negative number's.
void PrivateMemory::count(Word& counter, std::size_t bytes) {
    counter.store_relaxed(counter.load_relaxed() + bytes);
}

Offset PrivateMemory::reuse_or_bump(const BlockClass& fit) {
    Word& head = word(kHeads + 8 * Offset{fit.index});
    const Offset waiting = head.load_relaxed();
    if (waiting == 0) {
        const Offset block = bump(fit.bytes);
        back_by_huge_pages(block + fit.bytes);
        return block;
    }
    head.store_relaxed(word(waiting).load_relaxed());
    count(word(kFreeWord), std::size_t{0} - fit.bytes);
    return waiting;
}

Offset PrivateMemory::allocate(std::size_t bytes) {
    const BlockClass fit = block_class(bytes);
    if (fit.index >= kSizeClasses)
        throw CapacityExceeded("a block that large cannot be had");
    sync::CommitLock lock(word(kLockWord));
    const std::lock_guard guard(lock);
    if (word(kUsedWord).load_relaxed() + fit.bytes > limit_) {
        throw CapacityExceeded("the store's memory limit of " + std::to_string(limit_) +
                               " bytes is reached: raise memory_limit or shorten history");
    }
    const Offset block = reuse_or_bump(fit);
    count(word(kUsedWord), fit.bytes);
    // Whoever still reads the block's former content must see, after its acquire fence, what was
    // published when the block was released.
    fence_release();
    return block;
}

Offset PrivateMemory::allocate_sparse(std::size_t bytes) {
    sync::CommitLock lock(word(kLockWord));
    const std::lock_guard guard(lock);
    const Offset block = bump(round_up(bytes, kHugePage));
    huge_pages_to_ = std::max(huge_pages_to_, round_up(block + bytes, kHugePage));
    return block;
}

/// Into the free list.
void PrivateMemory::put_back(Offset block, std::size_t bytes) {
    const BlockClass fit = block_class(bytes);
    Word& head = word(kHeads + 8 * Offset{fit.index});
    word(block).store_relaxed(head.load_relaxed());
    head.store_relaxed(block);
    count(word(kUsedWord), std::size_t{0} - fit.bytes);
    count(word(kFreeWord), fit.bytes);
}

void PrivateMemory::release(Offset offset, std::size_t bytes) {
    sync::CommitLock lock(word(kLockWord));
    const std::lock_guard guard(lock);
    put_back(offset, bytes);
}

sync::Word& PrivateMemory::line_word(Line line, Offset word) const noexcept {
    return this->word(kLineWords + kLineWordBytes * static_cast<Offset>(line) + word);
}

void PrivateMemory::retire(Line line, Offset offset, std::size_t bytes, std::uint64_t number) {
    word(offset + kNext).store_relaxed(0);
    word(offset + kBytes).store_relaxed(bytes);
    word(offset + kNumber).store_relaxed(number);
    sync::CommitLock lock(word(kLockWord));
    const std::lock_guard guard(lock);
    const Offset last = line_word(line, kLastRetired).load_relaxed();
    (last == 0 ? line_word(line, kFirstRetired) : word(last + kNext)).store_relaxed(offset);
    line_word(line, kLastRetired).store_relaxed(offset);
    count(line_word(line, kRetiredBytes), block_class(bytes).bytes);
}

bool PrivateMemory::reclaim(Line line, std::uint64_t oldest, std::size_t keep) {
    sync::CommitLock lock(word(kLockWord));
    const std::lock_guard guard(lock);
    for (unsigned i = 0; i < kMostReclaimed && retired_bytes(line) > keep; ++i) {
        const Offset block = line_word(line, kFirstRetired).load_relaxed();
        const std::uint64_t number = word(block + kNumber).load_relaxed();
        if (number > oldest)
            return false;
        const std::size_t bytes = word(block + kBytes).load_relaxed();
        const Offset next = word(block + kNext).load_relaxed();
        line_word(line, kFirstRetired).store_relaxed(next);
        if (next == 0)
            line_word(line, kLastRetired).store_relaxed(0);
        count(line_word(line, kRetiredBytes), std::size_t{0} - block_class(bytes).bytes);
        if (reclaimed(line).load_relaxed() < number) {
            reclaimed(line).store_relaxed(number);
            // Readers must see this before what is written into the block from now on.
            fence_release();
        }
        put_back(block, bytes);
    }
    return retired_bytes(line) > keep;
}

std::size_t PrivateMemory::used_bytes() const noexcept {
    return word(kUsedWord).load_relaxed();
}
std::size_t PrivateMemory::retired_bytes(Line line) const noexcept {
    return line_word(line, kRetiredBytes).load_relaxed();
}
std::size_t PrivateMemory::free_bytes() const noexcept {
    return word(kFreeWord).load_relaxed();
}

}  // namespace tfdb::memory
