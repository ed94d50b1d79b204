// The frame table: one header per frame. Commits create and remove frames, and slots are reused.
#pragma once

#include <algorithm>
#include <cstdint>

#include "tfdb/base/types.hpp"
#include "tfdb/graph/layout.hpp"
#include "tfdb/history/layout.hpp"

namespace tfdb::graph {

/// The headers' location, and the commits in which each frame exists.
/// Threads: reads any; stores only the holder of the commit lock.
/// Guarantee: reads are wait-free.
template <class Memory>
class Frames {
public:
    Frames(Memory& memory, Offset root, Offset base, std::uint32_t max_frames)
        : memory_(&memory), root_(root), base_(base), max_frames_(max_frames) {}

    /// Size of the table: the headers, followed by the hints.
    [[nodiscard]] static constexpr std::size_t bytes(std::uint32_t max_frames) {
        return std::size_t{max_frames} * (history::kHeaderBytes + 8);
    }

    [[nodiscard]] Memory& memory() const { return *memory_; }
    [[nodiscard]] Offset header(FrameId id) const {
        return base_ + Offset{id} * history::kHeaderBytes;
    }
    [[nodiscard]] typename Memory::Word& word(FrameId id, history::HeaderWord w) const {
        return memory_->word(header(id) + 8 * w);
    }
    [[nodiscard]] typename Memory::Word& store_word(StoreWord w) const {
        return memory_->word(root_ + 8 * w);
    }
    /// A pin word of this process: see Pins.
    [[nodiscard]] typename Memory::Word& pin_word(StoreWord first, unsigned w) const {
        if constexpr (requires { memory_->pins(); }) {
            if (typename Memory::Word* const pins = memory_->pins(); pins != nullptr)
                return pins[(first == kHeldPins ? 0 : kPinWords) + w];
        }
        return store_word(static_cast<StoreWord>(first + w));
    }
    [[nodiscard]] std::uint64_t topology(FrameId id) const {
        return word(id, history::kTopology).load_acquire();
    }
    /// A frame's topology when its parent last changed. Eight frames share a line, which a plain
    /// write does not change. Use it only as a guess, such as for prefetching.
    [[nodiscard]] std::uint64_t hint(FrameId id) const requires memory::Fetchable<Memory> {
        return hint_word(id).load_relaxed();
    }
    void refresh_hint(FrameId id) const {
        if constexpr (memory::Fetchable<Memory>)
            hint_word(id).store_relaxed(word(id, history::kTopology).load_relaxed());
    }
    static constexpr std::uint32_t kLastGeneration = kNoFrame;
    [[nodiscard]] std::uint32_t generation(FrameId id) const {
        return static_cast<std::uint32_t>(word(id, history::kBorn).load_relaxed() & kNoFrame);
    }
    [[nodiscard]] CommitNumber born(FrameId id) const {
        return word(id, history::kBorn).load_acquire() >> kFrameBits;
    }
    /// Whether the frame exists in that state.
    [[nodiscard]] bool alive(FrameId id, CommitNumber snapshot) const {
        if ((topology(id) & history::Topology::kMortal) != 0) {
            const CommitNumber died = word(id, history::kDied).load_acquire();
            if (died != 0 && snapshot >= died)
                return false;
        }
        // Last: a slot that is reused meanwhile is sealed before the rest of it is written.
        return born(id) <= snapshot;
    }
    [[nodiscard]] std::uint32_t count() const {
        return static_cast<std::uint32_t>(
            std::min<std::uint64_t>(store_word(kFrameCount).load_acquire(), max_frames_));
    }
    [[nodiscard]] std::uint32_t max_frames() const { return max_frames_; }

    /// An unused slot, or kNoFrame if all are taken. May throw CapacityExceeded.
    [[nodiscard]] FrameId take_fresh_slot() const {
        const std::uint32_t count = this->count();
        if (count >= max_frames_)
            return kNoFrame;
        // For memory whose pages must be backed before a write.
        if constexpr (requires { memory_->touch(Offset{}, std::size_t{}, true); }) {
            memory_->touch(header(count), history::kHeaderBytes, count == 0);
            memory_->touch(header(max_frames_) + 8 * Offset{count}, 8, count == 0);
        }
        return count;
    }

    /// Ends the slot's former frame in every state; concurrent readers detect it by `born`.
    void seal(FrameId id) const {
        // The last generation is kept, so that its slot stays unused.
        const std::uint64_t generation = std::min(this->generation(id) + 1, kLastGeneration);
        word(id, history::kBorn).store_release(kMaxCommit << kFrameBits | generation);
        Memory::fence_release();
    }

    /// Turns a sealed or fresh slot into a frame without samples, born with the current commit.
    void make(FrameId id, CommitNumber commit, Offset name_block) const {
        for (unsigned w = 0; w < history::kHeaderWords; ++w) {
            if (w != history::kBorn)
                memory_->word(header(id) + 8 * w).store_relaxed(0);
        }
        word(id, history::kName).store_release(name_block);
        word(id, history::kTopology).store_release(history::Topology::kRoot);
        refresh_hint(id);
        const std::uint64_t generation = word(id, history::kBorn).load_relaxed() & kNoFrame;
        word(id, history::kBorn).store_release(commit << kFrameBits | generation);
        if (id >= count())
            store_word(kFrameCount).store_release(std::uint64_t{id} + 1);
    }

    /// Undoes the removal of the frame, when its commit is rolled back.
    void revive(FrameId id) const {
        word(id, history::kDied).store_relaxed(0);
        auto& topology = word(id, history::kTopology);
        topology.store_release(topology.load_relaxed() & ~history::Topology::kMortal);
    }

    /// Slots wait for reuse in the order in which their frames were removed; the first ones may
    /// already be empty. Returns the first of all, or kNoFrame.
    [[nodiscard]] FrameId first_retired() const { return id_in(kFreeHead); }
    /// The first slot whose frame still has its name and samples, or kNoFrame.
    [[nodiscard]] FrameId first_full() const { return id_in(kFreeFull); }
    void pop_retired() const {
        const FrameId id = first_retired();
        if (id == first_full())
            pass_full();
        const std::uint64_t next = word(id, history::kNextFree).load_relaxed();
        store_word(kFreeHead).store_relaxed(next);
        if (next == 0)
            store_word(kFreeTail).store_relaxed(0);
    }
    /// Moves past the first full slot, which is now empty.
    void pass_full() const {
        store_word(kFreeFull).store_relaxed(word(first_full(), history::kNextFree).load_relaxed());
    }
    void push_retired(FrameId id) const {
        const std::uint64_t link = std::uint64_t{id} + 1;
        word(id, history::kNextFree).store_relaxed(0);
        const FrameId tail = id_in(kFreeTail);
        if (tail == kNoFrame) {
            store_word(kFreeHead).store_relaxed(link);
        } else {
            word(tail, history::kNextFree).store_relaxed(link);
        }
        store_word(kFreeTail).store_relaxed(link);
        if (first_full() == kNoFrame)
            store_word(kFreeFull).store_relaxed(link);
    }
    /// Adds an empty slot after a death, before the full ones are listed.
    void push_empty(FrameId id) const {
        push_retired(id);
        store_word(kFreeFull).store_relaxed(0);
    }
    /// An empty slot whose frame was never published is reused before all others.
    void push_unseen(FrameId id) const {
        const std::uint64_t head = store_word(kFreeHead).load_relaxed();
        word(id, history::kNextFree).store_relaxed(head);
        store_word(kFreeHead).store_relaxed(std::uint64_t{id} + 1);
        if (head == 0)
            store_word(kFreeTail).store_relaxed(std::uint64_t{id} + 1);
    }

private:
    [[nodiscard]] typename Memory::Word& hint_word(FrameId id) const {
        return memory_->word(header(max_frames_) + 8 * Offset{id});
    }
    [[nodiscard]] FrameId id_in(StoreWord w) const {
        const std::uint64_t link = store_word(w).load_relaxed();
        return link == 0 || link > max_frames_ ? kNoFrame : static_cast<FrameId>(link - 1);
    }

    Memory* memory_;
    Offset root_;
    Offset base_;
    std::uint32_t max_frames_;
};

}  // namespace tfdb::graph
