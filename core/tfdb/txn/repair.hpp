// Rolls the state back to the last commit after a writer died.
#pragma once

#include <algorithm>
#include <cstdint>
#include <utility>
#include <vector>

#include "tfdb/graph/frames.hpp"
#include "tfdb/graph/names.hpp"
#include "tfdb/history/edge_writer.hpp"
#include "tfdb/txn/snapshot_view.hpp"

namespace tfdb::txn {

/// Visits all frames and excludes data newer than the last commit. It needs no log: a frame's
/// header words of newer commits show where to look, and counts and lists elsewhere are rebuilt. So
/// it may be interrupted at any instruction and repeated.
/// Threads: only the holder of the commit lock. Guarantee: readers run concurrently.
template <class Memory>
class Repair {
public:
    Repair(graph::Frames<Memory> frames, clock::StampNs history, history::Readers& readers)
        : frames_(frames),
          names_(frames),
          context_(frames.store_word(graph::kCommit).load_relaxed(), history, readers) {}

    /// Throws std::bad_alloc before it changes anything.
    void run() {
        const std::uint32_t count = frames_.count();
        retired_.reserve(count);
        for (FrameId id = 0; id < count; ++id)
            take_back(id);
        count_children();
        list_slots();
        names_.recount();
    }

private:
    [[nodiscard]] std::uint64_t load(FrameId id, history::HeaderWord w) const {
        return frames_.word(id, w).load_relaxed();
    }

    void take_back(FrameId id) {
        if (frames_.born(id) > context_.committed) {
            clear_slot(id);
            retired_.push_back({0, id});
            return;
        }
        std::uint64_t died = load(id, history::kDied);
        if (died > context_.committed) {
            frames_.revive(id);
            died = 0;
        }
        const std::uint64_t newest = std::max(
            {load(id, history::kChanged), load(id, history::kSince), load(id, history::kReshaped)});
        if (newest > context_.committed) {
            history::EdgeWriter<Memory>(frames_.memory(), frames_.header(id)).trim(context_);
            frames_.refresh_hint(id);
        }
        if (died != 0)
            retired_.push_back({died, id});
    }

    /// Clears a frame that no state shows, or a slot without a frame.
    void clear_slot(FrameId id) {
        if (frames_.born(id) != kMaxCommit)
            frames_.seal(id);
        if (load(id, history::kName) != 0) {
            names_.erase(id);
            frames_.word(id, history::kName).store_release(0);
        }
        // A sweep of the region finds its blocks and the block of its name.
        for (const auto w : {history::kTail, history::kDirectory, history::kOlder, history::kDied})
            frames_.word(id, w).store_relaxed(0);
    }

    void count_children() {
        const std::uint32_t count = frames_.count();
        for (FrameId id = 0; id < count; ++id)
            frames_.word(id, history::kChildren).store_relaxed(0);
        for (FrameId id = 0; id < count; ++id) {
            if (!frames_.alive(id, context_.committed))
                continue;
            const FrameId parent = newest_parent(frames_, id, context_.committed, context_.history);
            if (parent >= count)
                continue;
            auto& children = frames_.word(parent, history::kChildren);
            children.store_relaxed(children.load_relaxed() + 1);
        }
    }

    /// Lists slots that were never published, then those of removed frames in the order of removal.
    void list_slots() {
        std::sort(retired_.begin(), retired_.end());
        for (const auto w : {graph::kFreeHead, graph::kFreeTail, graph::kFreeFull})
            frames_.store_word(w).store_relaxed(0);
        for (const auto& [died, id] : retired_) {
            if (load(id, history::kName) != 0)
                frames_.push_retired(id);
            else
                frames_.push_empty(id);
        }
    }

    graph::Frames<Memory> frames_;
    graph::Names<Memory> names_;
    history::WriteContext context_;
    std::vector<std::pair<CommitNumber, FrameId>> retired_;
};

}  // namespace tfdb::txn
