// EdgeWriter: the ring itself.
#pragma once

#include <algorithm>
#include <bit>

#include "tfdb/base/error.hpp"
#include "tfdb/history/edge_writer.hpp"

namespace tfdb::history {

inline constexpr std::uint64_t kEvictShare = 16;  // of a full ring this part goes at once

template <class Memory>
StampNs EdgeWriter<Memory>::stamp_at(std::uint64_t ring, std::uint64_t index) const {
    const std::uint64_t mask = RingWord::capacity(ring) - 1;
    return as_stamp(
        memory_.word(RingLayout<Memory>::stamps(ring) + 8 * (index & mask)).load_relaxed());
}

template <class Memory>
Offset EdgeWriter<Memory>::slot_at(std::uint64_t ring, std::uint64_t index) const {
    const std::uint64_t mask = RingWord::capacity(ring) - 1;
    return RingLayout<Memory>::slots(ring) + RingLayout<Memory>::kSlotBytes * (index & mask);
}

template <class Memory>
CommitNumber EdgeWriter<Memory>::commit_at(std::uint64_t ring, std::uint64_t index) const {
    return SlotWord::commit(memory_.word(slot_at(ring, index)).load_relaxed());
}

template <class Memory>
bool EdgeWriter<Memory>::has_samples() const {
    const std::uint64_t head = word(kHead).load_relaxed();
    return head > word(kBegin).load_relaxed() && word(kCleared).load_relaxed() != head;
}

template <class Memory>
void EdgeWriter<Memory>::append(const WriteContext& context, const NewSample<Memory>& sample) {
    make_room(context);
    const std::uint64_t head = word(kHead).load_relaxed();
    if (sample.stamp == kClearMarker) {
        word(kCleared).store_relaxed(head + 1);
        constexpr std::uint64_t kKept =
            Topology::kMortal | Topology::kRebuilt | Topology::kParented;
        word(kTopology).store_release((topology() & kKept) | Topology::kRoot | Topology::kCleared);
        word(kNewest).store_relaxed(as_word(kNoStamp));
    } else if (!has_samples()) {
        note_first(sample, head);
    } else {
        if (Topology::parent(topology()) != sample.parent)
            note_parent(sample.parent, head);
        if (sample.stamp >= 0) {
            if (sample.stamp > newest()) {
                word(kNewest).store_relaxed(as_word(sample.stamp));
            } else {
                note_late(context, sample.stamp);
            }
        }
    }
    write_slot(context, sample);
}

/// Readers take no sample at or above the head they loaded, and find the newest commit beside it.
template <class Memory>
void EdgeWriter<Memory>::write_slot(const WriteContext& context, const NewSample<Memory>& sample) {
    const std::uint64_t head = word(kHead).load_relaxed();
    const std::uint64_t ring = word(kRing).load_relaxed();
    const CommitNumber commit = context.committed + 1;
    // Orders `begin` before the words that overwrite what lay there.
    Memory::fence_release();
    const Offset slot = slot_at(ring, head);
    memory_.word(slot).store_relaxed(SlotWord::pack(commit, sample.parent));
    for (unsigned i = 0; i < Memory::kPayloadWords; ++i) {
        memory_.word(slot + 8 * (1 + i)).store_relaxed(sample.payload[i]);
    }
    const std::uint64_t mask = RingWord::capacity(ring) - 1;
    memory_.word(RingLayout<Memory>::stamps(ring) + 8 * (head & mask))
        .store_relaxed(as_word(sample.stamp));
    word(kHeadCommit).store_relaxed(commit);
    word(kHead).store_release(head + 1);
    if ((head & 31) == 31)
        update_rate(ring, head);
}

template <class Memory>
void EdgeWriter<Memory>::note_first(const NewSample<Memory>& sample, std::uint64_t head) {
    std::uint64_t flags = topology() & (Topology::kMortal | Topology::kRebuilt |
                                        Topology::kCleared | Topology::kParented);
    if (sample.stamp == kStaticStamp)
        flags |= Topology::kStatic;
    if (head > word(kBegin).load_relaxed())
        turn_readers_back();
    word(kOrder).store_relaxed(std::uint64_t{1} << 32);
    word(kOrderedFrom).store_relaxed(head);
    word(kParentFrom).store_relaxed(head);
    word(kNewest).store_relaxed(as_word(sample.stamp == kStaticStamp ? kNoStamp : sample.stamp));
    word(kTopology).store_release(Topology::with_parent(flags, sample.parent, 0));
}

/// Readers that have begun find at the end that the ring's word has changed, and start again: what
/// is stored next is not what their samples need.
template <class Memory>
void EdgeWriter<Memory>::turn_readers_back() {
    const std::uint64_t ring = word(kRing).load_relaxed();
    word(kRing).store_release(RingWord::pack(RingWord::block(ring), RingWord::log2_capacity(ring),
                                             RingWord::version(ring) + 1));
    Memory::fence_release();
}

/// The same, and those that come meanwhile turn back at once, until a ring's word is stored again:
/// the header is going to be a mix of two states.
template <class Memory>
void EdgeWriter<Memory>::close_ring() {
    word(kRing).store_release(RingWord::busy(RingWord::version(word(kRing).load_relaxed()) + 1));
    Memory::fence_release();
}

template <class Memory>
void EdgeWriter<Memory>::note_parent(FrameId parent, std::uint64_t head) {
    word(kParentFrom).store_relaxed(head);
    word(kTopology).store_release(
        Topology::with_parent(topology(), parent, Topology::depth(topology())) |
        Topology::kMixedParents);
}

template <class Memory>
void EdgeWriter<Memory>::set_depth_hint(std::uint32_t depth) {
    // Whoever reads this word must see all that its flags stand for, as with every other store to
    // it.
    word(kTopology).store_release(
        Topology::with_parent(topology(), Topology::parent(topology()), depth));
}

template <class Memory>
void EdgeWriter<Memory>::update_rate(std::uint64_t ring, std::uint64_t head) {
    const std::uint64_t begin = word(kBegin).load_relaxed();
    const StampNs span = stamp_at(ring, head) - stamp_at(ring, begin);
    if (head <= begin || span <= 0)
        return;
    word(kRate).store_relaxed(std::bit_cast<std::uint64_t>(static_cast<double>(head - begin) /
                                                           static_cast<double>(span)));
}

template <class Memory>
bool EdgeWriter<Memory>::has_room(std::uint64_t samples) const {
    const std::uint64_t ring = word(kRing).load_relaxed();
    const std::uint64_t taken = word(kHead).load_relaxed() - word(kBegin).load_relaxed();
    return !RingWord::empty(ring) && taken + samples <= RingWord::capacity(ring);
}

template <class Memory>
void EdgeWriter<Memory>::reserve(const WriteContext& context, std::uint64_t samples,
                                 StampNs first) {
    while (!has_room(samples))
        free_or_grow(context);
    // Samples in stamp order start one run at most.
    if (first >= 0 && first <= newest() &&
        word(kOrder).load_relaxed() >> 32 >= Tuning<Memory>::kMaxRuns) {
        rebuild(context);
    }
}

template <class Memory>
void EdgeWriter<Memory>::make_room(const WriteContext& context) {
    if (has_room(1)) {
        evict_early(context, word(kRing).load_relaxed());
    } else {
        free_or_grow(context);
    }
}

template <class Memory>
void EdgeWriter<Memory>::free_or_grow(const WriteContext& context) {
    const std::uint64_t ring = word(kRing).load_relaxed();
    const std::uint64_t begin = word(kBegin).load_relaxed();
    // To learn what may go costs more than to see that nothing could.
    const CommitNumber committed = context.committed;
    const bool obsolete = !RingWord::empty(ring) && is_obsolete(context, ring, begin, committed);
    const CommitNumber state = obsolete ? evictable(context) : 0;
    if (obsolete && is_obsolete(context, ring, begin, state)) {
        // Several at a time, for the same reason.
        const std::uint64_t most =
            std::max<std::uint64_t>(1, RingWord::capacity(ring) / kEvictShare);
        std::uint64_t evicted = 0;
        do {
            evict_one(state);
        } while (++evicted < most && is_obsolete(context, ring, begin + evicted, state));
        return;
    }
    try {
        const bool repeats = (topology() & Topology::kUnordered) != 0;
        if (!repeats || !context.eviction_allowed() || !compact(context))
            grow();
    } catch (const CapacityExceeded&) {
        // A held snapshot makes writers take more memory, but never stops them.
        if (!obsolete)
            throw;
        evict_one(committed);
    }
}

/// Keeps room in a ring that is half full of what nobody can see any more. Were it full when a
/// snapshot is taken, it would grow; and again when that room is used up and the next one is taken.
template <class Memory>
void EdgeWriter<Memory>::evict_early(const WriteContext& context, std::uint64_t ring) {
    const std::uint64_t capacity = RingWord::capacity(ring);
    const std::uint64_t share = std::max<std::uint64_t>(1, capacity / kEvictShare);
    const std::uint64_t head = word(kHead).load_relaxed();
    // Now and then only, and not amid a commit, where it costs more to find out what may go.
    if ((head & (share - 1)) != 0 || word(kHeadCommit).load_relaxed() > context.committed)
        return;
    // Twice what came, so that what gathered while a snapshot was held goes again.
    for (std::uint64_t evicted = 0; evicted < 2 * share; ++evicted) {
        const std::uint64_t begin = word(kBegin).load_relaxed();
        if (2 * (head - begin) <= capacity ||
            !is_obsolete(context, ring, begin, context.committed) ||
            !is_obsolete(context, ring, begin, evictable(context))) {
            return;
        }
        evict_one(evictable(context));
    }
}

/// The state by which to judge what may go; 0, which shows nothing as obsolete, if it is not worth
/// the search: where commits do not lie in order, only the newest state is asked.
template <class Memory>
CommitNumber EdgeWriter<Memory>::evictable(const WriteContext& context) const {
    const CommitNumber state = context.oldest_read();
    const bool in_order = (topology() & (Topology::kUnordered | Topology::kRebuilt)) == 0;
    return state == context.committed || in_order ? state : 0;
}

/// Only what neither that state nor a later one shows to anyone may go: an abort must lose nothing.
template <class Memory>
bool EdgeWriter<Memory>::is_obsolete(const WriteContext& context, std::uint64_t ring,
                                     std::uint64_t index, CommitNumber state) const {
    if (commit_at(ring, index) > state)
        return false;
    const std::uint64_t cleared = word(kCleared).load_relaxed();
    if (index < cleared) {
        return commit_at(ring, cleared - 1) <= state;
    }
    const StampNs stamp = stamp_at(ring, index);
    if (stamp == kStaticStamp) {
        return index + 1 < word(kHead).load_relaxed() && commit_at(ring, index + 1) <= state;
    }
    // The greatest stamp of that state is the greatest of all unless a later commit raised it.
    const StampNs newest = word(kHeadCommit).load_relaxed() > state
                               ? newest_of(ring, index, state)
                               : as_stamp(word(kNewest).load_relaxed());
    return stamp < newest - context.history;
}

/// The greatest stamp from that index on that a state shows.
template <class Memory>
StampNs EdgeWriter<Memory>::newest_of(std::uint64_t ring, std::uint64_t from,
                                      CommitNumber state) const {
    std::uint64_t end = word(kHead).load_relaxed();
    if ((topology() & (Topology::kUnordered | Topology::kRebuilt)) == 0) {
        // Commits and stamps rise together: the last one that the state shows.
        std::uint64_t seen = from;
        while (seen < end) {
            const std::uint64_t middle = seen + (end - seen) / 2;
            if (commit_at(ring, middle) <= state) {
                seen = middle + 1;
            } else {
                end = middle;
            }
        }
        return end > from ? stamp_at(ring, end - 1) : kNoStamp;
    }
    StampNs newest = kNoStamp;
    while (end-- > from) {
        if (commit_at(ring, end) <= state)
            newest = std::max(newest, stamp_at(ring, end));
    }
    return newest;
}

template <class Memory>
void EdgeWriter<Memory>::evict_one(CommitNumber state) {
    const std::uint64_t begin = word(kBegin).load_relaxed() + 1;
    auto& safe = word(kEvictSafe);
    if (safe.load_relaxed() < state)
        safe.store_relaxed(state);
    word(kBegin).store_release(begin);
    std::uint64_t topology = this->topology();
    if ((topology & kHeals) == 0)
        return;
    // What was unusual is gone once its last sample is.
    if (begin >= word(kCleared).load_relaxed())
        topology &= ~Topology::kCleared;
    if (begin >= word(kSortedEnd).load_relaxed())
        topology &= ~Topology::kRebuilt;
    if (begin >= word(kParentFrom).load_relaxed())
        topology &= ~Topology::kMixedParents;
    if (begin >= word(kOrderedFrom).load_relaxed())
        topology &= ~Topology::kUnordered;
    word(kTopology).store_release(topology);
}

template <class Memory>
void EdgeWriter<Memory>::copy_sample(std::uint64_t from_ring, std::uint64_t from,
                                     std::uint64_t to_ring, std::uint64_t to) {
    const Offset source = slot_at(from_ring, from);
    const Offset target = slot_at(to_ring, to);
    for (unsigned i = 0; i <= Memory::kPayloadWords; ++i) {
        memory_.word(target + 8 * i).store_relaxed(memory_.word(source + 8 * i).load_relaxed());
    }
    const std::uint64_t mask = RingWord::capacity(to_ring) - 1;
    memory_.word(RingLayout<Memory>::stamps(to_ring) + 8 * (to & mask))
        .store_relaxed(as_word(stamp_at(from_ring, from)));
}

/// Readers of the old block find at the end that the ring's word has changed, and read again.
template <class Memory>
void EdgeWriter<Memory>::publish_ring(std::uint64_t old_ring, std::uint64_t new_ring) {
    word(kRing).store_release(new_ring);
    if (!RingWord::empty(old_ring)) {
        // A freed block may be written again at once: the new word must be seen before that.
        Memory::fence_release();
        memory_.release(RingWord::block(old_ring),
                        RingLayout<Memory>::bytes(RingWord::capacity(old_ring)));
    }
}

template <class Memory>
void EdgeWriter<Memory>::grow() {
    const std::uint64_t old_ring = word(kRing).load_relaxed();
    const unsigned log2_capacity = RingWord::empty(old_ring)
                                       ? Tuning<Memory>::kFirstLog2Capacity
                                       : RingWord::log2_capacity(old_ring) + 1;
    const std::uint64_t capacity = std::uint64_t{1} << log2_capacity;
    const Offset block = memory_.allocate(RingLayout<Memory>::bytes(capacity));
    const std::uint64_t ring =
        RingWord::pack(block, log2_capacity, RingWord::version(old_ring) + 1);
    for (unsigned run = 0; run < kMaxRuns; ++run) {
        const std::uint64_t start =
            RingWord::empty(old_ring)
                ? 0
                : memory_.word(RingWord::block(old_ring) + 8 * run).load_relaxed();
        memory_.word(block + 8 * run).store_relaxed(start);
    }
    if (!RingWord::empty(old_ring)) {
        const std::uint64_t head = word(kHead).load_relaxed();
        for (std::uint64_t i = word(kBegin).load_relaxed(); i < head; ++i) {
            copy_sample(old_ring, i, ring, i);
        }
    }
    publish_ring(old_ring, ring);
}

template <class Memory>
void EdgeWriter<Memory>::free_ring() {
    const std::uint64_t ring = word(kRing).load_relaxed();
    publish_ring(ring, RingWord::pack(0, 0, RingWord::version(ring) + 1));
    word(kHead).store_relaxed(0);
    word(kBegin).store_relaxed(0);
}

template <class Memory>
EdgeUndo EdgeWriter<Memory>::save() const {
    EdgeUndo saved;
    save(saved);
    return saved;
}

template <class Memory>
void EdgeWriter<Memory>::save(EdgeUndo& saved) const {
    for (std::size_t i = 0; i < EdgeUndo::kWords.size(); ++i) {
        saved.words[i] = word(EdgeUndo::kWords[i]).load_relaxed();
    }
}

/// True if samples were put behind the others at most, and nothing that readers rely on was changed
/// but the head. What an eviction healed meanwhile stays healed.
template <class Memory>
bool EdgeWriter<Memory>::only_appended(const EdgeUndo& saved) const {
    constexpr HeaderWord kSame[] = {kOrder, kCleared, kOrderedFrom, kLate, kParentFrom};
    for (const HeaderWord w : kSame) {
        if (word(w).load_relaxed() != saved[w])
            return false;
    }
    const std::uint64_t added = topology() & ~saved[kTopology];
    const std::uint64_t gone = saved[kTopology] & ~topology();
    return (added & ~Topology::kParented) == 0 && (gone & ~kHeals) == 0;
}

/// Takes off what was only appended. Nobody sees samples of a commit that was not published, so
/// readers need not be turned back: one that has the old head also finds kHeadCommit raised, and
/// leaves out what is too new for it. Hence that stays as it is.
template <class Memory>
void EdgeWriter<Memory>::lower_head(const EdgeUndo& saved) {
    word(kNewest).store_relaxed(saved[kNewest]);
    word(kHead).store_release(saved[kHead]);
}

/// If a rebuild or an eviction happened meanwhile, its flags and order are the ones that hold; but
/// those of an edge that was cleared speak of what came after it.
template <class Memory>
void EdgeWriter<Memory>::undo(const EdgeUndo& saved) {
    if (only_appended(saved))
        return lower_head(saved);
    const bool cleared = word(kCleared).load_relaxed() != saved[kCleared];
    const auto valid = [&](HeaderWord w) { return cleared ? saved[w] : word(w).load_relaxed(); };
    const std::uint64_t order = valid(kOrder);
    const std::uint64_t flags =
        topology() & (cleared ? Topology::kParented
                              : Topology::kUnordered | Topology::kRebuilt |
                                    Topology::kMixedParents | Topology::kParented);
    const std::uint64_t ordered_from = valid(kOrderedFrom);
    const std::uint64_t parent_from = valid(kParentFrom);
    const std::uint64_t ring = word(kRing).load_relaxed();
    close_ring();
    for (std::size_t i = 0; i < EdgeUndo::kWords.size(); ++i) {
        word(EdgeUndo::kWords[i]).store_relaxed(saved.words[i]);
    }
    if (has_samples()) {
        // Too wide a slack only costs time; runs that would begin behind the head go.
        const std::uint64_t head = word(kHead).load_relaxed();
        const Offset starts = RingWord::block(ring);
        std::uint64_t runs = order >> 32;
        while (runs > 1 && memory_.word(starts + 8 * (runs - 1)).load_relaxed() >= head)
            --runs;
        word(kOrder).store_relaxed(runs << 32 | (order & 0xFFFFFFFFU));
        word(kOrderedFrom).store_relaxed(ordered_from);
        word(kParentFrom).store_relaxed(parent_from);
        word(kTopology).store_relaxed(topology() | flags);
    } else {
        word(kTopology).store_relaxed(topology() | (flags & Topology::kParented));
    }
    word(kRing).store_release(RingWord::pack(RingWord::block(ring), RingWord::log2_capacity(ring),
                                             RingWord::version(ring) + 1));
}

}  // namespace tfdb::history
