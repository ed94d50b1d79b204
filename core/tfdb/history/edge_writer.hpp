// The writer's side of one edge's ring: append, evict, grow, take late samples, undo.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <utility>
#include <vector>

#include "tfdb/history/layout.hpp"

namespace tfdb::history {

/// What the commit in progress needs to know to write.
struct WriteContext {
    CommitNumber committed = 0;  // newest published commit; samples are tagged with the next one
    StampNs history = kForever;
    mutable bool may_evict = true;  // false while held snapshots may still need what is oldest
    // Where finding that out costs a fence, it is asked for when a ring is full, and not before.
    mutable bool (*ask_may_evict)(void* store) = nullptr;
    // The same, where those that are held are told from those that are not: the oldest state that
    // anybody may read, or later; what it does not show may go.
    mutable CommitNumber (*ask_oldest)(void* store) = nullptr;
    mutable CommitNumber oldest = kMaxCommit;
    void* store = nullptr;

    /// What this state does not show may be overwritten. Nothing that is newer than it may.
    [[nodiscard]] CommitNumber oldest_read() const {
        if (ask_oldest != nullptr) {
            oldest = ask_oldest(store);
            ask_oldest = nullptr;
        }
        if (ask_may_evict != nullptr) {
            may_evict = ask_may_evict(store);
            ask_may_evict = nullptr;
        }
        return may_evict ? std::min(oldest, committed) : 0;
    }
    /// Whether no held snapshot may need what is oldest.
    [[nodiscard]] bool eviction_allowed() const { return oldest_read() == committed; }
};

/// A sample as the writer hands it in.
template <class Memory>
struct NewSample {
    StampNs stamp = 0;  // or kStaticStamp, kClearMarker
    FrameId parent = kNoFrame;
    std::array<std::uint64_t, Memory::kPayloadWords> payload{};
};

/// The header's words before a commit touched them: what an abort puts back.
struct EdgeUndo {
    static constexpr std::array<HeaderWord, 9> kWords = {
        kHead, kTopology, kHeadCommit, kNewest, kOrder, kCleared, kOrderedFrom, kLate, kParentFrom};
    std::array<std::uint64_t, kWords.size()> words{};

    [[nodiscard]] constexpr std::uint64_t operator[](HeaderWord word) const {
        std::size_t at = 0;
        while (kWords[at] != word)
            ++at;
        return words[at];
    }
};

/// Appends samples of the commit in progress to one edge. Nothing that it writes is seen by a
/// reader before the store publishes the commit.
/// Threads: only the holder of the commit lock.
/// Guarantee: readers are never blocked; if `append` throws, `undo` leaves what was committed.
template <class Memory>
class EdgeWriter {
public:
    EdgeWriter(Memory& memory, Offset header) : memory_(memory), header_(header) {}

    /// Tags one sample with commit `context.committed + 1` and puts it behind the newest one.
    /// O(1) at the newest end. May throw CapacityExceeded, having changed nothing that counts.
    void append(const WriteContext& context, const NewSample<Memory>& sample);

    /// Makes room for samples that come one after another in stamp order, beginning with `first`
    /// (a stamp, or kStaticStamp): to append them cannot fail then. May throw as `append`.
    void reserve(const WriteContext& context, std::uint64_t samples, StampNs first);

    [[nodiscard]] EdgeUndo save() const;
    /// The same into a place that is there: a block copied through memory stalls.
    void save(EdgeUndo& saved) const;
    /// Takes off all samples that are newer than `committed` and puts the header back. Readers go
    /// on beside it, unless other things than newer samples of the same parent came.
    void undo(const EdgeUndo& saved);

    /// After the sample `parent` has become the newest parent: hint for walks.
    void set_depth_hint(std::uint32_t depth);

    /// Gives the ring's memory back when the frame's slot is reused.
    void free_ring();

    [[nodiscard]] std::uint64_t topology() const { return word(kTopology).load_relaxed(); }
    /// Greatest stamp, kNoStamp if the edge has no moving samples.
    [[nodiscard]] StampNs newest() const { return as_stamp(word(kNewest).load_relaxed()); }
    [[nodiscard]] bool has_samples() const;

private:
    /// Flags that go once the last sample that made them is evicted.
    static constexpr std::uint64_t kHeals =
        Topology::kUnordered | Topology::kMixedParents | Topology::kCleared | Topology::kRebuilt;

    /// Those at [first, end) of the ring: stamp and index.
    struct SortedSamples {
        std::uint64_t first = 0;
        std::uint64_t end = 0;
        std::vector<std::pair<StampNs, std::uint64_t>> samples;
    };

    [[nodiscard]] typename Memory::Word& word(HeaderWord w) const {
        return memory_.word(header_ + 8 * w);
    }
    [[nodiscard]] StampNs stamp_at(std::uint64_t ring, std::uint64_t index) const;
    [[nodiscard]] Offset slot_at(std::uint64_t ring, std::uint64_t index) const;
    [[nodiscard]] CommitNumber commit_at(std::uint64_t ring, std::uint64_t index) const;

    [[nodiscard]] bool has_room(std::uint64_t samples) const;
    void make_room(const WriteContext& context);
    void free_or_grow(const WriteContext& context);
    [[nodiscard]] bool is_obsolete(const WriteContext& context, std::uint64_t ring,
                                   std::uint64_t index, CommitNumber state) const;
    [[nodiscard]] StampNs newest_of(std::uint64_t ring, std::uint64_t from,
                                    CommitNumber state) const;
    [[nodiscard]] CommitNumber evictable(const WriteContext& context) const;
    void evict_one(CommitNumber state);
    void evict_early(const WriteContext& context, std::uint64_t ring);
    void grow();
    void copy_sample(std::uint64_t from_ring, std::uint64_t from, std::uint64_t to_ring,
                     std::uint64_t to);
    void publish_ring(std::uint64_t old_ring, std::uint64_t new_ring);

    void note_first(const NewSample<Memory>& sample, std::uint64_t head);
    void turn_readers_back();
    void close_ring();
    void note_parent(FrameId parent, std::uint64_t head);
    void note_late(const WriteContext& context, StampNs stamp);
    [[nodiscard]] bool widen_slack(std::uint64_t ring, StampNs stamp);
    void start_run(const WriteContext& context);
    [[nodiscard]] SortedSamples sorted_samples(const WriteContext& context) const;
    void replace_by(const WriteContext& context, const SortedSamples& sorted);
    void rebuild(const WriteContext& context);
    [[nodiscard]] bool compact(const WriteContext& context);
    void write_slot(const WriteContext& context, const NewSample<Memory>& sample);
    [[nodiscard]] bool only_appended(const EdgeUndo& saved) const;
    void lower_head(const EdgeUndo& saved);
    void update_rate(std::uint64_t ring, std::uint64_t head);

    Memory& memory_;
    Offset header_;
};

}  // namespace tfdb::history

#include "tfdb/history/edge_writer_late.ipp"
#include "tfdb/history/edge_writer_ring.ipp"
