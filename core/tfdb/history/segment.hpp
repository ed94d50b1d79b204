// A segment of an edge's history: samples in stamp order, in one block; and the list of segments.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <utility>

#include "tfdb/history/layout.hpp"

namespace tfdb::history {

/// A segment as one word: its block, and the range of samples that count. One store of this word
/// appends, inserts or rolls back samples. Zero is a segment without a block or samples.
struct SegmentWord {
    static constexpr std::uint64_t pack(Offset block, unsigned log2, std::uint64_t begin,
                                        std::uint64_t count) {
        return block / memory::kLineBytes << 28 | std::uint64_t{log2} << 24 | begin << 12 | count;
    }
    static constexpr Offset block(std::uint64_t word) { return (word >> 28) * memory::kLineBytes; }
    /// The same with arbitrary low bits, for `inside`, which clears them.
    static constexpr Offset near_block(std::uint64_t word) {
        return word >> (28 - std::countr_zero(memory::kLineBytes));
    }
    static constexpr unsigned log2_capacity(std::uint64_t word) {
        return static_cast<unsigned>(word >> 24) & 15;
    }
    static constexpr std::uint64_t capacity(std::uint64_t word) {
        return std::uint64_t{1} << log2_capacity(word);
    }
    static constexpr std::uint64_t begin(std::uint64_t word) { return word >> 12 & 0xFFF; }
    static constexpr std::uint64_t count(std::uint64_t word) { return word & 0xFFF; }
    static constexpr std::uint64_t end(std::uint64_t word) { return begin(word) + count(word); }
    /// One more sample at the end, or at the front.
    static constexpr std::uint64_t with_last(std::uint64_t word) { return word + 1; }
    static constexpr std::uint64_t with_first(std::uint64_t word) {
        return word - (1ULL << 12) + 1;
    }
    /// Only the samples at [from, to).
    static constexpr std::uint64_t only(std::uint64_t word, std::uint64_t from, std::uint64_t to) {
        return (word & ~0xFFFFFFULL) | from << 12 | (to - from);
    }
};

/// Words of a segment's block before its stamps. Memory keeps words 5 to 7 of a retired block.
enum SegmentMeta : unsigned {
    kLeast = 0,     // lower bound of the samples' commits
    kGreatest = 1,  // of a segment before the tail: upper bound of the samples' commits
    kHeld = 2,      // bytes of it that only held states show: see Readers::held
};

/// First word and payload of a slot.
template <class Memory>
struct SlotData {
    FrameId parent = kNoFrame;
    CommitNumber commit = 0;
    std::array<std::uint64_t, Memory::kPayloadWords> payload{};
};

/// A sample's slot and stamp; empty if `slot` is 0.
struct SampleAt {
    Offset slot = 0;
    StampNs stamp = kNoStamp;

    [[nodiscard]] explicit operator bool() const { return slot != 0; }
};

/// First index in [low, high) with at(i) > stamp, where `at(i)` ascends. Branch-free.
template <class At>
[[nodiscard]] std::uint64_t halve(At at, std::uint64_t low, std::uint64_t high, StampNs stamp) {
    std::uint64_t length = high - low;
    while (length > 0) {
        const std::uint64_t half = length / 2;
        const bool right = at(low + half) <= stamp;
        low = right ? low + half + 1 : low;
        length = right ? length - half - 1 : half;
    }
    return low;
}

/// The same, but it searches from `guess` outward with growing steps, then bisects.
template <class At>
[[nodiscard]] std::uint64_t gallop(At at, std::uint64_t low, std::uint64_t high,
                                   std::uint64_t guess, StampNs stamp) {
    if (low >= high)
        return low;
    guess = std::clamp(guess, low, high - 1);
    std::uint64_t step = 1;
    if (at(guess) <= stamp) {
        low = guess + 1;
        while (low + step < high && at(low + step) <= stamp) {
            low += step + 1;
            step *= 2;
        }
        high = std::min(high, low + step);
    } else {
        high = guess;
        while (high > low + step && at(high - step) > stamp) {
            high -= step;
            step *= 2;
        }
        if (high > low + step)
            low = high - step + 1;
    }
    return halve(at, low, high, stamp);
}

/// The position at `distance * rate` after `low`, clamped to a valid number.
[[nodiscard]] inline std::uint64_t guess_at(double distance, double rate, std::uint64_t low) {
    const double steps = distance * rate;
    return low + (steps > 0.0 && steps < 1e9 ? static_cast<std::uint64_t>(steps) : 0);
}

/// The samples of one segment. Its block holds the meta line, then the stamps, then the slots.
/// Threads: any; it is a value. Guarantee: wait-free; stays within the block.
template <class Memory>
class Segment {
public:
    static constexpr std::size_t kSlotBytes = 8 * (1 + Memory::kPayloadWords);

    static constexpr std::size_t bytes(std::uint64_t capacity) {
        return memory::kLineBytes + memory::round_up(8 * capacity, memory::kLineBytes) +
               kSlotBytes * capacity;
    }

    Segment(const Memory& memory, std::uint64_t word)
        : memory_(&memory),
          word_(word),
          stamps_(memory::inside(memory, SegmentWord::near_block(word)) + memory::kLineBytes),
          slots_(stamps_ + memory::round_up(8 * SegmentWord::capacity(word), memory::kLineBytes)) {}

    [[nodiscard]] std::uint64_t word() const { return word_; }
    [[nodiscard]] std::uint64_t begin() const { return SegmentWord::begin(word_); }
    [[nodiscard]] std::uint64_t end() const { return SegmentWord::end(word_); }
    [[nodiscard]] bool empty() const { return SegmentWord::count(word_) == 0; }

    [[nodiscard]] Offset block() const { return stamps_ - memory::kLineBytes; }
    [[nodiscard]] typename Memory::Word& meta(SegmentMeta m) const {
        return memory_->word(block() + 8 * Offset{m});
    }
    [[nodiscard]] Offset stamp_offset(std::uint64_t i) const { return stamps_ + 8 * i; }
    [[nodiscard]] Offset slot(std::uint64_t i) const { return slots_ + kSlotBytes * i; }
    [[nodiscard]] StampNs stamp(std::uint64_t i) const {
        return as_stamp(memory_->word(stamp_offset(i)).load_relaxed());
    }
    [[nodiscard]] std::uint64_t slot_word(std::uint64_t i) const {
        return memory_->word(slot(i)).load_relaxed();
    }
    [[nodiscard]] CommitNumber commit(std::uint64_t i) const {
        return SlotWord::commit(slot_word(i));
    }

    /// The first index with a greater stamp.
    [[nodiscard]] std::uint64_t upper_bound(StampNs stamp) const {
        return halve([this](std::uint64_t i) { return this->stamp(i); }, begin(), end(), stamp);
    }

private:
    const Memory* memory_;
    std::uint64_t word_;
    Offset stamps_;
    Offset slots_;
};

/// Summary of consecutive samples. Samples of equal stamp count once.
/// Threads: any; it is a value. Guarantee: wait-free.
struct Extent {
    std::uint64_t samples = 0;
    StampNs first = kNoStamp;
    StampNs last = kNoStamp;
    StampNs longest_gap = 0;

    bool operator==(const Extent&) const = default;

    /// Adds the next sample.
    void add(StampNs stamp) {
        if (samples == 0) {
            samples = 1;
            first = last = stamp;
            return;
        }
        const StampNs gap = as_stamp(as_word(stamp) - as_word(last));
        samples += gap == 0 ? 0 : 1;
        longest_gap = std::max(longest_gap, gap);
        last = stamp;
    }
    /// Adds the samples that follow.
    void add(const Extent& next) {
        if (next.samples == 0)
            return;
        if (samples == 0) {
            *this = next;
            return;
        }
        // Numbers of a reused block may have any value.
        const StampNs gap = as_stamp(as_word(next.first) - as_word(last));
        samples += next.samples - (gap == 0 ? 1 : 0);
        longest_gap = std::max({longest_gap, next.longest_gap, gap});
        last = next.last;
    }
};

/// The extent of a segment's samples from an index on, of commits up to `newest`.
template <class Memory>
[[nodiscard]] Extent extent_of(const Segment<Memory>& in, std::uint64_t from, CommitNumber newest) {
    Extent all;
    for (std::uint64_t i = from; i < in.end(); ++i) {
        if (in.commit(i) <= newest)
            all.add(in.stamp(i));
    }
    return all;
}

/// Words of a directory's block before its entries.
enum DirectoryWord : unsigned {
    kDirBegin = 0,  // the entries that count: [begin, end)
    kDirEnd = 1,
    kDirRate = 2,      // entries per ns, a double's bits
    kDirCapacity = 3,  // in entries
    kDirLowest = 4,    // no entry below it was ever used
};

/// The segments of an edge before its tail, in stamp order: for each, its first stamp and its word.
/// A segment's samples lie between its first stamp and the next segment's; the first segment also
/// holds all older samples.
///
/// Behind the entries come their summaries (nodes): one per segment (level 0), per 8 segments, per
/// 64, and so on. A node counts as long as the directory lists all its segments.
/// Threads: any; it is a value. Guarantee: wait-free.
template <class Memory>
class Directory {
public:
    /// A node's summary holds in states from `changed` on; no sample's commit is below `least`.
    struct Node {
        Extent extent;
        CommitNumber changed = 0;
        CommitNumber least = kMaxCommit;
    };

    static constexpr std::size_t bytes(std::uint64_t capacity) {
        unsigned levels = 0;
        while (segments(levels) <= capacity)
            ++levels;
        return nodes_at(capacity, levels);
    }
    /// The number of segments in a node.
    static constexpr std::uint64_t segments(unsigned level) {
        return std::uint64_t{1} << level * Tuning<Memory>::kFanLog2;
    }

    Directory(const Memory& memory, Offset block)
        : memory_(&memory), block_(memory::inside(memory, block)) {}

    [[nodiscard]] Offset block() const { return block_; }
    [[nodiscard]] typename Memory::Word& word(DirectoryWord w) const {
        return memory_->word(block_ + 8 * Offset{w});
    }
    [[nodiscard]] typename Memory::Word& first_word(std::uint64_t k) const {
        return memory_->word(block_ + memory::kLineBytes + 16 * k);
    }
    [[nodiscard]] typename Memory::Word& entry(std::uint64_t k) const {
        return memory_->word(block_ + memory::kLineBytes + 16 * k + 8);
    }
    [[nodiscard]] StampNs first(std::uint64_t k) const {
        return as_stamp(first_word(k).load_relaxed());
    }
    /// The capacity in entries.
    [[nodiscard]] std::uint64_t capacity() const {
        return memory::most_entries(*memory_, word(kDirCapacity).load_relaxed());
    }
    /// The valid entries are [begin, end), as a reader loads them.
    [[nodiscard]] std::uint64_t end() const {
        return memory::most_entries(*memory_, word(kDirEnd).load_acquire());
    }
    [[nodiscard]] std::uint64_t begin(std::uint64_t end) const {
        return std::min<std::uint64_t>(word(kDirBegin).load_acquire(), end);
    }
    /// Which of the segments at [begin, end) a stamp belongs to; `end` for the tail behind them.
    [[nodiscard]] std::uint64_t find(std::uint64_t begin, std::uint64_t end,
                                     const Segment<Memory>& tail, StampNs stamp) const {
        const bool in_tail = !tail.empty() && tail.stamp(tail.begin()) <= stamp;
        return begin == end || in_tail ? end : find(begin, end, stamp);
    }
    /// The same if there are segments and the stamp lies before the tail.
    [[nodiscard]] std::uint64_t find(std::uint64_t begin, std::uint64_t end, StampNs stamp) const {
        const double rate = std::bit_cast<double>(word(kDirRate).load_relaxed());
        const double distance = static_cast<double>(stamp) - static_cast<double>(first(begin));
        return gallop([&](std::uint64_t k) { return first(k); }, begin + 1, end,
                      guess_at(distance, rate, begin + 1), stamp) -
               1;
    }

    /// The node of a level whose first entry is `k`. `capacity`: the directory's.
    [[nodiscard]] Node node(std::uint64_t capacity, unsigned level, std::uint64_t k) const {
        const auto word = node_words(capacity, level, k);
        Node node;
        node.extent.samples = word(1).load_acquire();
        node.extent.first = as_stamp(word(2).load_acquire());
        node.extent.last = as_stamp(word(3).load_acquire());
        node.extent.longest_gap = as_stamp(word(4).load_acquire());
        // It is stored before the other words.
        node.changed = word(0).load_relaxed();
        node.least = word(5).load_relaxed();
        return node;
    }
    [[nodiscard]] CommitNumber least(std::uint64_t capacity, unsigned level,
                                     std::uint64_t k) const {
        return node_words(capacity, level, k)(5).load_relaxed();
    }
    /// For the writer: stores the summary of one segment; `sum_up` updates the nodes above it.
    void store_node(std::uint64_t k, const Node& node) const { store(capacity(), 0, k, node); }
    /// Computes the summary of an entry's segment in the current commit.
    void store_figures(std::uint64_t k) const {
        const Segment<Memory> in(*memory_, entry(k).load_relaxed());
        store_node(k, in, extent_of(in, in.begin(), SlotWord::kNever - 1));
    }
    /// The same if the sample at `index` is the only change.
    void store_figures_with(std::uint64_t k, const Segment<Memory>& in, std::uint64_t index) const {
        Extent all = node(capacity(), 0, k).extent;
        const StampNs stamp = in.stamp(index);
        const Extent one{1, stamp, stamp, 0};
        if (index + 1 == in.end()) {
            all.add(one);
        } else if (index == in.begin()) {
            const Extent behind = std::exchange(all, one);
            all.add(behind);
        } else if (in.stamp(index + 1) - in.stamp(index - 1) == all.longest_gap) {
            return store_figures(k);  // it may have been the only gap of that length
        } else if (in.stamp(index - 1) != stamp) {
            ++all.samples;
        }
        store_node(k, in, all);
    }
    /// Updates the nodes above an entry, as far as they lie before `end`.
    void sum_up(std::uint64_t k, std::uint64_t end) const {
        const std::uint64_t capacity = this->capacity();
        const std::uint64_t lowest = word(kDirLowest).load_relaxed();
        for (unsigned level = 1; segments(level) <= capacity && is_within(level, k, lowest, end);
             ++level)
            sum_up(capacity, level, k);
    }
    /// Copies an entry of another directory.
    void copy(std::uint64_t k, const Directory& other, std::uint64_t from) const {
        first_word(k).store_relaxed(other.first_word(from).load_relaxed());
        entry(k).store_relaxed(other.entry(from).load_relaxed());
        store_node(k, other.node(other.capacity(), 0, from));
    }
    /// Replaces an entry's segment by one with a new sample at `index`.
    void replace(std::uint64_t k, const Segment<Memory>& in, std::uint64_t index) const {
        const std::uint64_t old = entry(k).load_relaxed();
        entry(k).store_release(in.word());
        if (SegmentWord::count(in.word()) == SegmentWord::count(old) + 1) {
            store_figures_with(k, in, index);
        } else {
            store_figures(k);
        }
        sum_up(k, word(kDirEnd).load_relaxed());
    }
    /// Call after entries were added or removed.
    void update_rate() const {
        const std::uint64_t begin = word(kDirBegin).load_relaxed();
        const std::uint64_t end = word(kDirEnd).load_relaxed();
        const std::uint64_t room = memory::most_entries(*memory_, ~std::uint64_t{0});
        if (begin >= end || end > room)
            return;
        const StampNs span = first(end - 1) - first(begin);
        const auto steps = static_cast<double>(end - 1 - begin);
        const double rate = span > 0 ? steps / static_cast<double>(span) : 0.0;
        word(kDirRate).store_relaxed(std::bit_cast<std::uint64_t>(rate));
    }
    /// Updates all nodes above the entries at [begin, end).
    void sum_up_all(std::uint64_t begin, std::uint64_t end) const {
        const std::uint64_t capacity = this->capacity();
        for (unsigned level = 1; segments(level) <= end - begin; ++level) {
            const std::uint64_t step = segments(level);
            for (std::uint64_t k = (begin + step - 1) / step * step; k + step <= end; k += step)
                sum_up(capacity, level, k);
        }
    }

private:
    static constexpr Offset kNodeBytes = 48;
    static constexpr Offset nodes_at(std::uint64_t capacity, unsigned level) {
        Offset at = memory::kLineBytes + 16 * capacity;
        for (unsigned below = 0; below < level; ++below)
            at += kNodeBytes * (capacity / segments(below));
        return at;
    }
    static bool is_within(unsigned level, std::uint64_t k, std::uint64_t begin, std::uint64_t end) {
        const std::uint64_t first = k / segments(level) * segments(level);
        return first >= begin && first + segments(level) <= end;
    }

    [[nodiscard]] auto node_words(std::uint64_t capacity, unsigned level, std::uint64_t k) const {
        const Offset at = block_ + nodes_at(capacity, level) + kNodeBytes * (k / segments(level));
        return [memory = memory_, at](unsigned w) ->
               typename Memory::Word& { return memory->word(at + 8 * Offset{w}); };
    }
    void store_node(std::uint64_t k, const Segment<Memory>& in, const Extent& extent) const {
        store_node(k, {extent, in.meta(kGreatest).load_relaxed(), in.meta(kLeast).load_relaxed()});
    }
    /// A reader that loads a number of the node also sees the commit that stored it.
    void store(std::uint64_t capacity, unsigned level, std::uint64_t k, const Node& node) const {
        const auto word = node_words(capacity, level, k);
        word(0).store_relaxed(node.changed);
        word(1).store_release(node.extent.samples);
        word(2).store_release(as_word(node.extent.first));
        word(3).store_release(as_word(node.extent.last));
        word(4).store_release(as_word(node.extent.longest_gap));
        word(5).store_relaxed(node.least);
    }
    void sum_up(std::uint64_t capacity, unsigned level, std::uint64_t k) const {
        const std::uint64_t first = k / segments(level) * segments(level);
        Node sum;
        for (std::uint64_t at = first; at < first + segments(level); at += segments(level - 1)) {
            const Node part = node(capacity, level - 1, at);
            sum.extent.add(part.extent);
            sum.changed = std::max(sum.changed, part.changed);
            sum.least = std::min(sum.least, part.least);
        }
        store(capacity, level, first, sum);
    }

    const Memory* memory_;
    Offset block_;
};

/// An edge's segments as its writer sees them: the directory's, and the tail behind them.
/// Threads: the only writer of the edge. Guarantee: wait-free.
template <class Memory>
class EdgeSegments {
public:
    EdgeSegments(Memory& memory, Offset header) : memory_(memory), header_(header) {}

    [[nodiscard]] std::uint64_t topology() const { return word(kTopology).load_relaxed(); }
    [[nodiscard]] bool has_samples() const { return static_cast<bool>(newest_sample()); }
    [[nodiscard]] bool is_static() const { return newest_sample().stamp == kStaticStamp; }
    /// Greatest stamp; kNoStamp if the edge has no moving samples.
    [[nodiscard]] StampNs newest() const { return std::max(newest_sample().stamp, kNoStamp); }

    [[nodiscard]] SampleAt newest_sample() const {
        const Segment<Memory> tail = segment(word(kTail).load_relaxed());
        return tail.empty() ? newest_sealed() : last_of(tail);
    }
    /// The commit that began this version. If a clear was rolled back, its block holds it.
    [[nodiscard]] CommitNumber began() const {
        const std::uint64_t older = word(kOlder).load_relaxed();
        return (older & kTakenBack) == 0
                   ? word(kSince).load_relaxed()
                   : memory_.word(version(older) + 8 * Offset{kOldSince}).load_relaxed();
    }
    /// Number of stored samples, including those that no state shows.
    [[nodiscard]] std::uint64_t stored() const {
        std::uint64_t samples = 0;
        for (std::uint64_t k = begin(); k <= end(); ++k)
            samples += SegmentWord::count(word_of(k));
        return samples;
    }

    /// Visits every block of the edge's newest version: visit(offset, bytes). Calls held(bytes)
    /// with the bytes of its segments recorded as shown by held states alone.
    template <class Visit, class Held>
    void visit_blocks(Visit visit, Held held) const {
        for (std::uint64_t k = begin(); k <= end(); ++k) {
            const std::uint64_t found = word_of(k);
            const Segment<Memory> in = segment(found);
            if (in.block() == 0)
                continue;
            visit(in.block(), Segment<Memory>::bytes(SegmentWord::capacity(found)));
            held(in.meta(kHeld).load_relaxed());
        }
        if (const Offset list = directory().block(); list != 0)
            visit(list, Directory<Memory>::bytes(directory().capacity()));
        const std::uint64_t older = word(kOlder).load_relaxed();
        if ((older & kTakenBack) != 0)
            visit(version(older), kVersionBytes);
    }

    [[nodiscard]] std::uint64_t begin() const { return directory_word(kDirBegin); }
    /// Index of the tail.
    [[nodiscard]] std::uint64_t end() const { return directory_word(kDirEnd); }
    [[nodiscard]] std::uint64_t word_of(std::uint64_t k) const {
        return k == end() ? word(kTail).load_relaxed() : directory().entry(k).load_relaxed();
    }
    [[nodiscard]] Segment<Memory> segment(std::uint64_t word) const { return {memory_, word}; }
    /// Index of the segment that a stamp belongs to.
    [[nodiscard]] std::uint64_t segment_of(StampNs stamp) const {
        const Segment<Memory> tail = segment(word(kTail).load_relaxed());
        return directory().find(begin(), end(), tail, stamp);
    }

protected:
    [[nodiscard]] typename Memory::Word& word(HeaderWord w) const {
        return memory_.word(header_ + 8 * Offset{w});
    }
    [[nodiscard]] Directory<Memory> directory() const {
        return {memory_, word(kDirectory).load_relaxed()};
    }
    /// The block of a replaced version.
    [[nodiscard]] Offset version(std::uint64_t older) const {
        return memory::inside(memory_, older);
    }

    Memory& memory_;
    Offset header_;

private:
    [[nodiscard]] static SampleAt last_of(const Segment<Memory>& in) {
        return {in.slot(in.end() - 1), in.stamp(in.end() - 1)};
    }
    /// The newest sample behind an empty tail.
    [[nodiscard, gnu::noinline]] SampleAt newest_sealed() const {
        for (std::uint64_t k = end(); k > begin();) {
            const Segment<Memory> in = segment(word_of(--k));
            if (!in.empty())
                return last_of(in);
        }
        return {};
    }
    [[nodiscard]] std::uint64_t directory_word(DirectoryWord w) const {
        const Directory<Memory> list = directory();
        if (list.block() == 0)
            return 0;
        return memory::most_entries(memory_, list.word(w).load_relaxed());
    }
};

}  // namespace tfdb::history
