#include "tfdb/memory/region.hpp"

#include <algorithm>
#include <bit>
#include <string>
#include <utility>

#include "tfdb/memory/file.hpp"
#include "tfdb/sync/commit_lock.hpp"

namespace tfdb::memory {
namespace {

constexpr Offset kFileWord = 8 * kMagicWord;  // not zero: the file was published
constexpr Offset kBumpWord = 8 * kEndWord;
constexpr Offset kUsedWord = 16;
constexpr Offset kFreeWord = 24;
constexpr Offset kLockWord = 32;
constexpr Offset kBackedWord = 40;
constexpr Offset kSparseWord = 48;  // the last sparse block
constexpr Offset kSparseEndWord = 56;
// remaining part of the free block that is being cut; its first word: end
constexpr Offset kCutWord = 120;
// For each line of retired blocks.
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
// For a file: one bit per granule, set if the granule may have no memory.
constexpr Offset kGivenBack = kHeads + 8 * kSizeClasses;
constexpr std::size_t kMostGranules = 4096;
constexpr Offset kFirstBlock = round_up(kGivenBack + kMostGranules / 8, kLineBytes);

// Large blocks at power-of-two distances collide in the caches; three odd lines spread them.
constexpr std::size_t kSkewFrom = std::size_t{1} << 16;
constexpr std::size_t kSkewBytes = 3 * kLineBytes;

}  // namespace

/// In a file the commit lock already excludes other threads. There this word only marks work in
/// progress, so that a damaged word blocks no process. In private memory the word is a lock.
/// Threads: one. Guarantee: in a file wait-free; else it blocks.
class Region::AtWork {
public:
    explicit AtWork(Region& region)
        : word_(region.word(kLockWord)), lock_(word_), shared_(region.mapping_.is_file()) {
        if (shared_) {
            word_.store_relaxed(1);
            fence_release();
        } else {
            lock_.lock();
        }
    }
    ~AtWork() {
        if (shared_)
            word_.store_release(0);
        else
            lock_.unlock();
    }
    AtWork(const AtWork&) = delete;
    AtWork& operator=(const AtWork&) = delete;

private:
    Word& word_;
    sync::CommitLock lock_;
    bool shared_;
};

Region::Region(Mapping mapping, std::size_t limit_bytes)
    : mapping_(std::move(mapping)),
      base_(mapping_.base()),
      mask_((mapping_.is_file() ? std::bit_ceil(mapping_.bytes()) : Offset{0}) - kLineBytes),
      reserved_(mapping_.bytes()),
      granule_(mapping_.is_file()
                   ? std::max(mapping_.step(), std::bit_ceil(reserved_) / kMostGranules)
                   : mapping_.step()),
      limit_(limit_bytes) {
    if (word(kBumpWord).load_relaxed() != 0 || word(kFileWord).load_relaxed() != 0)
        return;
    word(kBackedWord).store_relaxed(mapping_.step());
    word(kBumpWord).store_relaxed(kFirstBlock);
}

Offset Region::root() noexcept {
    return kFirstBlock;
}
Offset Region::end() const noexcept {
    return std::min<Offset>(word(kBumpWord).load_relaxed(), reserved_);
}
bool Region::is_new() const noexcept {
    return end() <= kFirstBlock && word(kFileWord).load_relaxed() == 0;
}

/// Whether an allocated block can lie here: a damaged file may hold any number.
bool Region::is_block(Offset offset, std::size_t bytes) const noexcept {
    const Offset end = this->end();
    return offset % kLineBytes == 0 && offset >= kFirstBlock && offset < end &&
           bytes <= end - offset;
}
void Region::throw_damaged() {
    throw CorruptStore(
        "the store is damaged in its list of free blocks; remove it and create it "
        "again");
}

void Region::extend(Offset end) noexcept {
    count(word(kUsedWord), end - this->end());
    word(kBumpWord).store_relaxed(end);
}

Offset Region::bump(std::size_t bytes) {
    const std::size_t skew = bytes >= kSkewFrom ? kSkewBytes : 0;
    const Offset at = end();
    if (at < kFirstBlock || at % kLineBytes != 0)
        throw_damaged();
    if (bytes + skew > reserved_ - at) {
        throw CapacityExceeded("the store's " + std::to_string(reserved_) +
                               " bytes are full: give it a shorter history" +
                               (mapping_.is_file() ? ", or a larger size" : ""));
    }
    back(at + bytes + skew);
    word(kBumpWord).store_relaxed(at + bytes + skew);
    return at;
}

void Region::back(Offset end) {
    const Offset backed = word(kBackedWord).load_relaxed();
    if (end <= backed)
        return;
    const Offset to = std::min(round_up(end, mapping_.step()), reserved_);
    // A private region uses huge pages once its blocks fill one: most stores are smaller.
    const Offset first = std::max<Offset>(word(kSparseEndWord).load_relaxed(), mapping_.step());
    if (mapping_.is_file())
        mapping_.back(backed, to);
    else if (to > first + kHugePage)
        mapping_.back(backed > first + kHugePage ? backed : first, to);
    word(kBackedWord).store_relaxed(to);
}

/// Adds to a counter that other threads may read; `bytes` may be a negated number.
void Region::count(Word& counter, std::size_t bytes) {
    counter.store_relaxed(counter.load_relaxed() + bytes);
}

Offset Region::reuse_or_bump(const BlockClass& fit) {
    Word& head = word(kHeads + 8 * Offset{fit.index});
    const Offset waiting = head.load_relaxed();
    if (waiting == 0) {
        return cut_or_bump(fit);
    }
    if (!is_block(waiting, fit.bytes))
        throw_damaged();
    regain(waiting, waiting + fit.bytes);
    head.store_relaxed(word(waiting).load_relaxed());
    count(word(kFreeWord), std::size_t{0} - fit.bytes);
    return waiting;
}

/// Cuts up a larger block if many bytes are free, or if no space is left behind the last block.
Offset Region::cut_or_bump(const BlockClass& fit) {
    const bool full = reserved_ - end() < fit.bytes + kSkewBytes;
    if ((full || free_bytes() > used_bytes() / 4) && has_to_cut(fit))
        return cut(fit.bytes);
    return bump(fit.bytes);
}

/// The block that is being cut up; empty if there is none or if the words are damaged.
Region::Gap Region::to_cut() const noexcept {
    const Offset at = word(kCutWord).load_relaxed();
    if (at == 0 || !is_block(at, kLineBytes))
        return {};
    const Offset end = word(at).load_relaxed();
    return end > at && is_block(at, end - at) ? Gap{at, end} : Gap{};
}

/// Whether the block that is being cut has room for such a block; if not, takes another one. If the
/// process dies here, the block is lost until the next sweep.
bool Region::has_to_cut(const BlockClass& fit) {
    const Gap left = to_cut();
    if (left.to - left.from >= fit.bytes)
        return true;
    for (unsigned larger = fit.index + 1; larger < kSizeClasses; ++larger) {
        Word& head = word(kHeads + 8 * Offset{larger});
        const Offset block = head.load_relaxed();
        if (block == 0)
            continue;
        if (!is_block(block, class_bytes(larger)))
            throw_damaged();
        word(kCutWord).store_relaxed(0);
        fence_release();
        count(word(kFreeWord), left.from - left.to);
        put_back_gap(left.from, left.to);
        head.store_relaxed(word(block).load_relaxed());
        word(block).store_relaxed(block + class_bytes(larger));
        word(kCutWord).store_release(block);
        return true;
    }
    return false;
}

Offset Region::cut(std::size_t bytes) {
    const Gap left = to_cut();
    if (left.to - left.from < bytes)
        throw_damaged();
    const Offset rest = left.from + bytes;
    regain(left.from, rest == left.to ? rest : rest + kLineBytes);
    if (rest != left.to)
        word(rest).store_relaxed(left.to);
    word(kCutWord).store_release(rest == left.to ? 0 : rest);
    count(word(kFreeWord), std::size_t{0} - bytes);
    return left.from;
}

Offset Region::allocate(std::size_t bytes) {
    const BlockClass fit = block_class(bytes);
    if (fit.index >= kSizeClasses)
        throw CapacityExceeded("a block of that size cannot be allocated");
    const AtWork alone(*this);
    if (word(kUsedWord).load_relaxed() + fit.bytes > limit_) {
        throw CapacityExceeded("the store's memory limit of " + std::to_string(limit_) +
                               " bytes is reached: raise memory_limit or shorten history");
    }
    const Offset block = reuse_or_bump(fit);
    count(word(kUsedWord), fit.bytes);
    // After its acquire fence, a late reader of the block's former content must see the data that
    // were published when the block was released.
    fence_release();
    return block;
}

Offset Region::allocate_sparse(std::size_t bytes) {
    const AtWork alone(*this);
    const Offset block = word(kBumpWord).load_relaxed();
    const Offset end = round_up(block + bytes, kHugePage);
    if (end > reserved_) {
        throw CapacityExceeded("a store of " + std::to_string(reserved_) +
                               " bytes has no room for a table of " + std::to_string(bytes) +
                               ": give it a larger size, or fewer frames");
    }
    word(kSparseWord).store_relaxed(block);
    word(kSparseEndWord).store_relaxed(end);
    word(kBackedWord).store_relaxed(std::max<Offset>(word(kBackedWord).load_relaxed(), end));
    word(kBumpWord).store_relaxed(end);
    return block;
}

void Region::touch(Offset offset, std::size_t bytes, bool first) const {
    const std::size_t step = mapping_.step();
    if (!mapping_.is_file() || (!first && (offset + bytes - 1) % step >= bytes))
        return;
    mapping_.back(offset / step * step, std::min(round_up(offset + bytes, step), reserved_));
}

sync::Word& Region::given_back(Offset granule) const noexcept {
    return word(kGivenBack + granule / 64 * 8);
}

/// Backs granules whose memory was returned. Throws CapacityExceeded.
void Region::regain(Offset from, Offset to) {
    if (!mapping_.is_file())
        return;
    for (Offset granule = from / granule_; granule * granule_ < to; ++granule) {
        Word& bits = given_back(granule);
        const std::uint64_t bit = std::uint64_t{1} << granule % 64;
        if ((bits.load_relaxed() & bit) == 0)
            continue;
        mapping_.back(granule * granule_, std::min((granule + 1) * granule_, reserved_));
        bits.store_relaxed(bits.load_relaxed() & ~bit);
    }
}

bool Region::can_regain_line(Offset block) noexcept {
    try {
        regain(block, block + kLineBytes);
        return true;
    } catch (const CapacityExceeded&) {
        return false;
    }
}

/// Marks the granule before it returns the memory: a death in between costs the next user one call.
bool Region::give_back_granule(Offset from) {
    if (mapping_.is_file()) {
        Word& bits = given_back(from / granule_);
        const std::uint64_t bit = std::uint64_t{1} << from / granule_ % 64;
        if ((bits.load_relaxed() & bit) != 0)
            return true;
        bits.store_relaxed(bits.load_relaxed() | bit);
        fence_release();
    }
    return mapping_.give_back(from, from + granule_);
}

void Region::give_back() {
    const AtWork alone(*this);
    for (unsigned i = block_class(granule_).index; i < kSizeClasses; ++i) {
        const std::size_t bytes = class_bytes(i);
        Offset block = word(kHeads + 8 * Offset{i}).load_relaxed();
        // More bytes than the region holds: the damaged list is circular.
        for (std::size_t seen = 0; seen < reserved_ && is_block(block, bytes); seen += bytes) {
            // All except the line of the list's word.
            Offset from = round_up(block + kLineBytes, granule_);
            for (; from + granule_ <= block + bytes; from += granule_) {
                if (!give_back_granule(from))
                    return;
            }
            block = word(block).load_relaxed();
        }
    }
}

/// Puts a block into the free list. If the list's word gets no memory, the block is lost until the
/// next sweep.
void Region::put_back(Offset block, const BlockClass& fit) {
    if (!is_block(block, fit.bytes) || !can_regain_line(block))
        return;
    Word& head = word(kHeads + 8 * Offset{fit.index});
    word(block).store_relaxed(head.load_relaxed());
    head.store_relaxed(block);
    count(word(kFreeWord), fit.bytes);
}

void Region::take_back(Offset block, std::size_t bytes) {
    const BlockClass fit = block_class(bytes);
    put_back(block, fit);
    count(word(kUsedWord), std::size_t{0} - fit.bytes);
}

/// Frees the range as consecutive blocks of the largest sizes that fit.
void Region::put_back_gap(Offset from, Offset to) {
    while (from < to && to - from >= kLineBytes) {
        const std::size_t bytes = whole_block_lines((to - from) / kLineBytes) * kLineBytes;
        put_back(from, block_class(bytes));
        from += bytes;
    }
}

void Region::release(Offset offset, std::size_t bytes) {
    const AtWork alone(*this);
    take_back(offset, bytes);
}

sync::Word& Region::line_word(Line line, Offset word) const noexcept {
    return this->word(kLineWords + kLineWordBytes * static_cast<Offset>(line) + word);
}

void Region::retire(Line line, Offset offset, std::size_t bytes, std::uint64_t number) {
    word(offset + kNext).store_relaxed(0);
    word(offset + kBytes).store_relaxed(bytes);
    word(offset + kNumber).store_relaxed(number);
    const AtWork alone(*this);
    const Offset last = inside(line_word(line, kLastRetired).load_relaxed());
    (last == 0 ? line_word(line, kFirstRetired) : word(last + kNext)).store_relaxed(offset);
    line_word(line, kLastRetired).store_relaxed(offset);
    count(line_word(line, kRetiredBytes), block_class(bytes).bytes);
}

bool Region::reclaim(Line line, std::uint64_t oldest, std::size_t keep) {
    const AtWork alone(*this);
    for (unsigned i = 0; i < kMostReclaimed && retired_bytes(line) > keep; ++i) {
        const Offset block = inside(line_word(line, kFirstRetired).load_relaxed());
        const std::uint64_t number = word(block + kNumber).load_relaxed();
        if (number > oldest)
            return false;
        const std::size_t bytes = word(block + kBytes).load_relaxed();
        const Offset next = word(block + kNext).load_relaxed();
        if (!is_block(block, bytes)) {
            // Damaged: the remaining blocks stay unused.
            for (const Offset lost : {kFirstRetired, kLastRetired, kRetiredBytes})
                line_word(line, lost).store_relaxed(0);
            return false;
        }
        line_word(line, kFirstRetired).store_relaxed(next);
        if (next == 0)
            line_word(line, kLastRetired).store_relaxed(0);
        const std::size_t freed = std::min(retired_bytes(line), block_class(bytes).bytes);
        count(line_word(line, kRetiredBytes), std::size_t{0} - freed);
        if (reclaimed(line).load_relaxed() < number) {
            reclaimed(line).store_relaxed(number);
            // Readers must see this before any later write to the block.
            fence_release();
        }
        take_back(block, bytes);
    }
    return retired_bytes(line) > keep;
}

bool Region::repair() {
    if (word(kLockWord).load_relaxed() == 0)
        return false;
    for (unsigned i = 0; i < kLines; ++i) {
        const auto line = static_cast<Line>(i);
        Offset last = 0;
        std::size_t bytes = 0;
        Offset block = line_word(line, kFirstRetired).load_relaxed();
        // More bytes than the region holds: the damaged list is circular.
        while (bytes < reserved_ && is_block(block, word(inside(block) + kBytes).load_relaxed())) {
            last = block;
            bytes += block_class(word(block + kBytes).load_relaxed()).bytes;
            block = word(block + kNext).load_relaxed();
        }
        (last == 0 ? line_word(line, kFirstRetired) : word(last + kNext)).store_relaxed(0);
        line_word(line, kLastRetired).store_relaxed(last);
        line_word(line, kRetiredBytes).store_relaxed(bytes);
    }
    word(kLockWord).store_release(0);
    return true;
}

void Region::sweep(std::vector<Block> in_use, std::uint64_t epoch, std::uint64_t commit) {
    const AtWork alone(*this);
    for (const auto& [line, number] : {std::pair(Line::kReplaced, epoch), {Line::kEnded, commit}}) {
        reclaimed(line).store_relaxed(
            std::max<std::uint64_t>(reclaimed(line).load_relaxed(), number));
        line_word(line, kFirstRetired).store_relaxed(0);
        line_word(line, kLastRetired).store_relaxed(0);
        line_word(line, kRetiredBytes).store_relaxed(0);
    }
    for (unsigned i = 0; i < kSizeClasses; ++i)
        word(kHeads + 8 * Offset{i}).store_relaxed(0);
    word(kCutWord).store_relaxed(0);
    word(kFreeWord).store_relaxed(0);
    // Readers must see the numbers before any later write to the blocks.
    fence_release();
    std::erase_if(in_use,
                  [this](const Block& block) { return !is_block(block.offset, block.bytes); });
    std::sort(in_use.begin(), in_use.end(),
              [](const Block& a, const Block& b) { return a.offset < b.offset; });
    std::size_t used = 0;
    Offset at = kFirstBlock;
    for (const Block& block : in_use) {
        release_gap(at, block.offset);
        const std::size_t bytes = block_class(block.bytes).bytes;
        used += bytes;
        at = block.offset + bytes;
    }
    release_gap(at, word(kBumpWord).load_relaxed());
    word(kUsedWord).store_relaxed(used);
}

void Region::release_gap(Offset from, Offset to) {
    const Offset sparse = word(kSparseWord).load_relaxed();
    if (from <= sparse && sparse < to) {
        put_back_gap(from, sparse);
        from = word(kSparseEndWord).load_relaxed();
    }
    put_back_gap(from, to);
}

bool Region::is_short() const noexcept {
    const Offset sparse = word(kSparseEndWord).load_relaxed() - word(kSparseWord).load_relaxed();
    return (reserved_ - end() + free_bytes()) < (reserved_ - sparse) / 4;
}

std::size_t Region::used_bytes() const noexcept {
    return word(kUsedWord).load_relaxed();
}
std::size_t Region::retired_bytes(Line line) const noexcept {
    return std::min<std::size_t>(line_word(line, kRetiredBytes).load_relaxed(), reserved_);
}
std::size_t Region::free_bytes() const noexcept {
    return word(kFreeWord).load_relaxed();
}

}  // namespace tfdb::memory
