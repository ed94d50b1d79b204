// The writer's side of one edge: append, insert late samples, clear, evict, roll back.
//
// Readers run concurrently, so what they read never changes. New samples go into slots that no
// reader was ever sent to; a late one goes into a copy of its segment. One store of a word makes
// the sample part of the edge. Samples carry the number of their commit: those of an unpublished
// commit are invisible. A rollback (`trim`) excludes the commit's samples at the ends of segments
// and marks those inside. It needs only the number of the last commit, so it also works after a
// writer's death, and again after an interruption.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "tfdb/base/error.hpp"
#include "tfdb/history/edge_view.hpp"
#include "tfdb/history/segment.hpp"

namespace tfdb::history {

/// The state of readers that writers depend on.
/// Threads: those of the implementation. Guarantee: that of the implementation.
class Readers {
public:
    Readers() = default;
    Readers(const Readers&) = delete;
    Readers& operator=(const Readers&) = delete;
    virtual ~Readers() = default;

    /// The oldest state that may still be read. Data that neither it nor a later state shows can be
    /// freed.
    [[nodiscard]] virtual CommitNumber oldest_read() = 0;
    /// A read that begins in this epoch cannot reach blocks that were retired before the call.
    [[nodiscard]] virtual std::uint64_t next_epoch() = 0;
    /// Begins the next epoch. Returns an epoch: no protected read in progress began before it.
    [[nodiscard]] virtual std::uint64_t begin_epoch() = 0;
    /// Adds to the bytes that are kept for held states alone; modulo 2^64.
    virtual void held(std::uint64_t bytes) = 0;
};

/// The data of the current commit that edges need.
/// Threads: the writer's. Guarantee: calls `readers` as rarely as possible, for each call costs a
/// fence.
class WriteContext {
public:
    /// `newest`: the newest published commit; samples are tagged with the next one.
    WriteContext(CommitNumber newest, StampNs retained, Readers& readers)
        : committed(newest), history(retained), readers_(&readers) {}

    [[nodiscard]] CommitNumber number() const { return committed + 1; }
    /// As Readers', but never newer than the newest published commit.
    [[nodiscard]] CommitNumber oldest_read() const {
        if (!asked_) {
            oldest_ = std::min(readers_->oldest_read(), committed);
            asked_ = true;
        }
        return oldest_;
    }
    [[nodiscard]] bool is_held() const { return oldest_read() < committed; }
    /// Asks the readers again if a held snapshot counted: it may have been dropped meanwhile, to
    /// free memory for writes.
    void ask_again() const { asked_ = asked_ && oldest_ == committed; }
    /// Ignores held snapshots from now on: memory for them is exhausted.
    void give_up_snapshots() const {
        asked_ = true;
        oldest_ = committed;
    }
    [[nodiscard]] Readers& readers() const { return *readers_; }

    CommitNumber committed;
    StampNs history;

private:
    Readers* readers_;
    mutable bool asked_ = false;
    mutable CommitNumber oldest_ = 0;
};

/// A sample as passed to the writer.
template <class Memory>
struct NewSample {
    StampNs stamp = 0;  // or kStaticStamp
    FrameId parent = kNoFrame;
    std::array<std::uint64_t, Memory::kPayloadWords> payload{};
};

/// Fills a slot and the stamp that belongs to it.
template <class Memory>
void store_sample(Memory& memory, const Segment<Memory>& into, std::uint64_t index,
                  const NewSample<Memory>& sample, CommitNumber commit) {
    const Offset slot = into.slot(index);
    memory.word(slot).store_relaxed(SlotWord::pack(commit, sample.parent));
    // Unrolled, so that new values stay in registers.
#pragma GCC unroll 8
    for (unsigned i = 0; i < Memory::kPayloadWords; ++i)
        memory.word(slot + 8 * (1 + Offset{i})).store_relaxed(sample.payload[i]);
    memory.word(into.stamp_offset(index)).store_relaxed(as_word(sample.stamp));
}

using memory::Line;

/// Releases a line's waiting blocks beyond `keep` bytes. True: more are waiting.
template <class Memory>
bool reclaim(Memory& memory, const WriteContext& context, Line line, std::size_t keep) {
    if (memory.retired_bytes(line) <= keep)
        return false;
    return memory.reclaim(
        line, line == Line::kEnded ? context.oldest_read() : context.readers().begin_epoch(), keep);
}
/// Retires a block that readers may still access.
template <class Memory>
void retire(Memory& memory, const WriteContext& context, Line line, Offset block,
            std::size_t bytes) {
    memory.retire(line, block, bytes,
                  line == Line::kEnded ? context.number() : context.readers().next_epoch());
    reclaim(memory, context, line, Tuning<Memory>::kKept);
}
template <class Memory>
void retire_segment(Memory& memory, const WriteContext& context, Line line, std::uint64_t word) {
    const Segment<Memory> segment(memory, word);
    if (segment.block() == 0)
        return;
    const std::size_t bytes = Segment<Memory>::bytes(SegmentWord::capacity(word));
    if (const std::uint64_t held = segment.meta(kHeld).load_relaxed(); held != 0)
        context.readers().held(std::uint64_t{0} - held);
    retire(memory, context, line, segment.block(), bytes);
}

/// A block that nothing refers to yet: it is freed unless `use` is called.
/// Threads: one. Guarantee: as the memory's.
template <class Memory>
class NewBlock {
public:
    NewBlock(Memory& memory, std::size_t bytes)
        : memory_(memory), block_(memory.allocate(bytes)), bytes_(bytes) {}
    NewBlock(NewBlock&& other) noexcept
        : memory_(other.memory_), block_(std::exchange(other.block_, 0)), bytes_(other.bytes_) {}
    ~NewBlock() {
        if (block_ != 0)
            memory_.release(block_, bytes_);
    }
    NewBlock(const NewBlock&) = delete;
    NewBlock& operator=(const NewBlock&) = delete;
    NewBlock& operator=(NewBlock&&) = delete;

    [[nodiscard]] Offset offset() const { return block_; }
    void use() { block_ = 0; }

private:
    Memory& memory_;
    Offset block_;
    std::size_t bytes_;
};

/// A new segment without samples; samples in it count once its word is stored.
/// Threads: one. Guarantee: as the memory's.
template <class Memory>
class NewSegment : public NewBlock<Memory> {
public:
    NewSegment(Memory& memory, std::uint64_t capacity)
        : NewBlock<Memory>(memory, Segment<Memory>::bytes(capacity)),
          memory_(memory),
          into_(memory,
                SegmentWord::pack(this->offset(), static_cast<unsigned>(std::countr_zero(capacity)),
                                  0, 0)) {
        into_.meta(kLeast).store_relaxed(kMaxCommit);
        into_.meta(kGreatest).store_relaxed(0);
        into_.meta(kHeld).store_relaxed(0);
    }

    [[nodiscard]] Segment<Memory> segment() const { return {memory_, word()}; }
    /// Sets the index of the next sample.
    void start_at(std::uint64_t index) { begin_ = end_ = index; }
    [[nodiscard]] std::uint64_t word() const {
        return SegmentWord::only(into_.word(), begin_, end_);
    }
    void put(const NewSample<Memory>& sample, CommitNumber commit) {
        store_sample(memory_, into_, end_, sample, commit);
        extend(commit);
    }
    void copy(const Segment<Memory>& from, std::uint64_t index) {
        const Offset source = from.slot(index);
        const Offset target = into_.slot(end_);
        for (unsigned i = 0; i <= Memory::kPayloadWords; ++i) {
            memory_.word(target + 8 * Offset{i})
                .store_relaxed(memory_.word(source + 8 * Offset{i}).load_relaxed());
        }
        memory_.word(into_.stamp_offset(end_)).store_relaxed(as_word(from.stamp(index)));
        extend(from.commit(index));
    }

private:
    void extend(CommitNumber commit) {
        ++end_;
        if (commit < least_)
            into_.meta(kLeast).store_relaxed(least_ = commit);
        if (commit > greatest_)
            into_.meta(kGreatest).store_relaxed(greatest_ = commit);
    }

    Memory& memory_;
    Segment<Memory> into_;
    std::uint64_t begin_ = 0;
    std::uint64_t end_ = 0;
    CommitNumber least_ = kMaxCommit;
    CommitNumber greatest_ = 0;
};

/// Adds samples of the current commit to one edge, and rolls them back. Readers see nothing of it
/// before the store publishes the commit. Threads: only the holder of the commit lock, or of the
/// frame's. Guarantee: readers are never blocked. If a call throws or the process dies in it,
/// `trim` restores the committed samples.
template <class Memory>
class EdgeWriter : public EdgeSegments<Memory> {
public:
    using EdgeSegments<Memory>::EdgeSegments;

    /// Tags one sample with the context's commit and inserts it by its stamp, after those with an
    /// equal stamp. O(1) at the newest and at the oldest end. May throw CapacityExceeded.
    void append(const WriteContext& context, const NewSample<Memory>& sample);
    /// The same for many samples in stamp order: the segments before the tail are copied once.
    void append(const WriteContext& context, std::span<const NewSample<Memory>> samples);
    /// The same if no sample is older than the previous one or than the edge's samples: one store
    /// per segment that they fill. `sample(i)` returns them.
    template <class Sample>
    void append_behind(const WriteContext& context, std::size_t count, Sample sample);

    /// Reserves space for that many samples in order after all others, so that appending them
    /// cannot fail. False: too many to reserve. May throw as `append`.
    [[nodiscard]] bool reserve(const WriteContext& context, std::uint64_t samples);

    /// Hides all samples: later ones begin a new version of the edge. At most once per commit.
    void clear(const WriteContext& context);
    /// Sets the count of out-of-order samples; later ones add to it.
    void set_late(const WriteContext& context, std::uint64_t samples);
    /// Call after the commit that cleared the edge is published: only older snapshots need the old
    /// version.
    void retire_older(const WriteContext& context);

    /// Retires all segments that no readable state retains, except the tail. `append` does this
    /// step by step.
    void evict_all(const WriteContext& context);

    /// Excludes all samples newer than the committed ones. Allocates nothing.
    void trim(const WriteContext& context);

    /// Call after the sample's `parent` has become the newest parent: a hint for walks.
    void set_depth_hint(std::uint32_t depth);

    /// Call after the frame was removed: only held states show it.
    void hold_all(const WriteContext& context);
    /// Frees all memory: no readable state has the frame.
    void release(const WriteContext& context);

private:
    using Base = EdgeSegments<Memory>;
    using Base::begin;
    using Base::end;
    using Base::header_;
    using Base::memory_;
    using Base::newest_sample;
    using Base::segment;
    using Base::segment_of;
    using Base::version;
    using Base::word_of;
    using Seg = Segment<Memory>;
    using Dir = Directory<Memory>;
    using Sizes = Tuning<Memory>;
    static constexpr std::uint64_t kFull = std::uint64_t{1} << Sizes::kFullLog2;
    static constexpr std::uint64_t kLargest = std::uint64_t{1} << Sizes::kLargestLog2;
    static constexpr unsigned kMostEvicted = 64;  // segments per call, so that no commit takes long
    static_assert(Sizes::kLargestLog2 < 12, "a segment's word counts to 4095");

    [[nodiscard]] Seg tail() const { return segment(this->word(kTail).load_relaxed()); }

    void note(const WriteContext& context, const NewSample<Memory>& sample, const SampleAt& newest);
    void write(const WriteContext& context, const Seg& into, std::uint64_t index,
               const NewSample<Memory>& sample);
    template <class Work>
    void with_memory(const WriteContext& context, Work work);

    void append_behind(const WriteContext& context, const NewSample<Memory>& sample,
                       const SampleAt& newest);
    template <class Sample>
    [[nodiscard]] std::size_t fill_tail(const WriteContext& context, std::size_t count,
                                        Sample sample);
    [[nodiscard]] std::uint64_t spare(std::uint64_t capacity) const;
    void make_room(const WriteContext& context, std::uint64_t samples);
    void copy_tail(const WriteContext& context, const Seg& full, std::uint64_t first,
                   std::uint64_t capacity);
    void seal(const WriteContext& context, std::uint64_t next_capacity);
    void update_rate();
    [[nodiscard]] std::uint64_t first_needed(const WriteContext& context, const Seg& full) const;
    [[nodiscard]] std::uint64_t count_needed(const WriteContext& context, const Seg& in,
                                             std::uint64_t first) const;
    [[nodiscard]] bool superseded(const WriteContext& context, const Seg& in,
                                  std::uint64_t index) const;
    [[nodiscard]] bool is_needed(const WriteContext& context, const Seg& in,
                                 std::uint64_t index) const;
    void forget(const WriteContext& context, HeaderWord what);
    [[nodiscard]] static StampNs retained_from(const WriteContext& context, StampNs newest);
    [[nodiscard]] StampNs cutoff(const WriteContext& context) const;
    void evict(const WriteContext& context);
    void drop_superseded(const WriteContext& context, const Seg& tail);
    void hold(const WriteContext& context, const Seg& in, std::uint64_t bytes);
    bool hold_all_of(const WriteContext& context, std::uint64_t word);
    void hold_unshown(const WriteContext& context, const Seg& in);
    void hold_before(const WriteContext& context, StampNs stamp);
    void heal_parents();

    [[nodiscard]] std::uint64_t most_amid() const;
    void insert_late(const WriteContext& context, const NewSample<Memory>& sample,
                     const SampleAt& newest);
    void store_word_of(std::uint64_t k, std::uint64_t word, std::uint64_t index);
    void insert_in_copy(const WriteContext& context, std::uint64_t k, std::uint64_t index,
                        std::uint64_t capacity, const NewSample<Memory>& sample);
    void push_front(const WriteContext& context, const NewSample<Memory>& sample);
    void insert_run(const WriteContext& context, std::span<const NewSample<Memory>> run,
                    const SampleAt& newest);
    void merge(const WriteContext& context, std::uint64_t k,
               std::span<const NewSample<Memory>> samples, std::vector<NewSegment<Memory>>& made);

    template <class Enter>
    void copy_directory(const WriteContext& context, std::uint64_t at, std::uint64_t removed,
                        std::uint64_t added, Enter enter);
    void retire_directory(const WriteContext& context, Line line, Offset block);
    [[nodiscard]] std::uint64_t trimmed(const WriteContext& context, std::uint64_t word) const;
    void trim_directory(const WriteContext& context);
    void trim_version(const WriteContext& context);
    void retire_all(const WriteContext& context, Line line, std::uint64_t tail, Offset directory);
    void restore_topology();
};

}  // namespace tfdb::history

#include "tfdb/history/edge_writer.ipp"
