// The default engine's view: every frame as one commit left it, read without any lock.
#pragma once

#include <optional>

#include "tfdb/graph/frames.hpp"
#include "tfdb/history/edge_view.hpp"
#include "tfdb/lookup/edge.hpp"
#include "tfdb/lookup/view.hpp"

namespace tfdb::txn {

/// Newer than any commit: frames are read as they are now.
inline constexpr CommitNumber kSeesAll = kMaxCommit - 1;

/// State number `commit` of the forest.
/// Threads: any; it is a value. Guarantee: wait-free; it never delays writers.
template <class M>
class SnapshotView {
public:
    using Memory = M;
    using Edge = history::EdgeView<Memory>;

    /// `commit` may be kSeesAll; frames are then read as they are now.
    SnapshotView(graph::Frames<Memory> frames, CommitNumber commit, clock::StampNs history)
        : frames_(frames), commit_(commit), as_of_(now()), history_(history) {}

    [[nodiscard]] bool open(FrameId id, Edge& edge) const {
        if (!edge.open(frames_.memory(), frames_.header(id), commit_, history_, as_of()))
            return false;
        // Not born yet, or the slot of a frame of this state was reused since.
        return !edge.empty() || frames_.born(id) <= commit_ ||
               frames_.store_word(graph::kRecycleFloor).load_acquire() <= commit_;
    }
    /// The values loaded before any read. A view of the current frames loads them again for each
    /// frame.
    [[nodiscard]] history::AsOf as_of() const { return commit_ == kSeesAll ? now() : as_of_; }
    [[nodiscard]] std::uint64_t topology(FrameId id) const { return frames_.topology(id); }
    [[nodiscard]] bool alive(FrameId id) const { return frames_.alive(id, commit_); }
    [[nodiscard]] bool alive_since(FrameId id, CommitNumber commit) const {
        return frames_.born(id) <= commit && frames_.alive(id, commit_);
    }
    /// The frame's generation in this state; kNoGeneration if the slot holds a later frame.
    [[nodiscard]] std::uint32_t generation(FrameId id) const {
        const std::uint64_t born = frames_.word(id, history::kBorn).load_relaxed();
        return born >> kFrameBits <= commit_ ? static_cast<std::uint32_t>(born & kNoFrame)
                                             : lookup::kNoGeneration;
    }
    [[nodiscard]] std::uint32_t frame_count() const { return frames_.count(); }
    [[nodiscard]] CommitNumber commit() const { return commit_; }
    [[nodiscard]] const graph::Frames<Memory>& frames() const { return frames_; }
    [[nodiscard]] clock::StampNs history() const { return history_; }

private:
    /// For a state, its own number selects the versions.
    [[nodiscard]] history::AsOf now() const {
        const CommitNumber commit =
            commit_ == kSeesAll ? frames_.store_word(graph::kCommit).load_acquire() : commit_;
        return {frames_.store_word(graph::kEpoch).load_acquire(), commit};
    }

    graph::Frames<Memory> frames_;
    CommitNumber commit_;
    history::AsOf as_of_;
    clock::StampNs history_;
};

/// The parent in a frame's newest sample in a state; kNoFrame for a root. Only for the holder of
/// the commit lock, which no writer overtakes.
template <class Memory>
[[nodiscard]] FrameId newest_parent(const graph::Frames<Memory>& frames, FrameId id,
                                    CommitNumber commit, clock::StampNs history) {
    const std::uint64_t topology = frames.topology(id);
    FrameId parent = history::Topology::parent(topology);
    if ((topology & history::Topology::kMixedParents) != 0) {
        const SnapshotView<Memory> view(frames, commit, history);
        (void)lookup::parent_at(view, id, std::nullopt, parent);
    }
    return parent;
}

}  // namespace tfdb::txn
