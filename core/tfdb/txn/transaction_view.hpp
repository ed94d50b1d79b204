// The forest as a transaction sees it: its session's reads, overlaid with its own writes.
#pragma once

#include <cstdint>
#include <string_view>

#include "tfdb/graph/names.hpp"
#include "tfdb/lookup/view.hpp"
#include "tfdb/txn/merged_edge.hpp"
#include "tfdb/txn/read_set.hpp"
#include "tfdb/txn/session.hpp"
#include "tfdb/txn/write_set.hpp"

namespace tfdb::txn {

/// A lookup::View that records queries in a ReadSet and overlays the answers with a WriteSet.
/// Threads: one. Guarantee: that of the session's view.
template <class S, class R = ReadSet>
class TransactionView {
public:
    using Memory = typename S::Memory;
    using Below = typename S::View;
    using Reads = R;

private:
    struct Parts {
        using Memory = typename S::Memory;
        using Below = typename S::View;
        using Edge = typename S::View::Edge;
        using Reads = R;
    };

public:
    using Edge = MergedEdge<Parts>;
    static constexpr bool kNotesReads = true;

    /// `reads` null: no recording, because nothing can change.
    TransactionView(const Below& below, graph::Names<Memory> names, clock::StampNs history,
                    const WriteSet<Memory>& writes, Reads* reads)
        : below_(below), names_(names), history_(history), writes_(&writes), reads_(reads) {}

    [[nodiscard]] bool open(FrameId id, Edge& edge) const {
        return edge.open(below_, id, writes_->edge(id), writes_->is_own(id), writes_->cleared(),
                         history_, reads_);
    }
    /// A hint. If the transaction gives a frame several parents, only the samples are exact.
    [[nodiscard]] std::uint64_t topology(FrameId id) const {
        using history::Topology;
        const std::uint64_t below = writes_->is_own(id) ? Topology::kRoot : below_.topology(id);
        const auto* own = writes_->edge(id);
        if (own == nullptr)
            return below;
        const std::uint64_t mixed = own->mixed ? Topology::kMixedParents : 0;
        return Topology::with_parent(below, own->newest().parent, own->depth) | mixed;
    }
    [[nodiscard]] bool alive(FrameId id) const {
        if (writes_->is_removed(id))
            return false;
        if (writes_->is_own(id))
            return true;
        const bool alive = below_.alive(id);
        if (alive && reads_ != nullptr)
            (void)reads_->note_frame(id, below_.generation(id));
        return alive;
    }
    [[nodiscard]] bool alive_since(FrameId id, CommitNumber commit) const {
        if (writes_->is_own(id))
            return commit == kOwnCommit && !writes_->is_removed(id);
        return id != kNoFrame && below_.alive_since(id, commit) && alive(id);
    }
    [[nodiscard]] std::uint32_t generation(FrameId id) const {
        return writes_->is_own(id) ? kOwnGeneration : below_.generation(id);
    }
    [[nodiscard]] std::uint32_t frame_count() const {
        return below_.frame_count() + static_cast<std::uint32_t>(writes_->made());
    }
    [[nodiscard]] CommitNumber commit() const { return below_.commit(); }

    /// The frame with that name, or kNoFrame.
    [[nodiscard]] FrameId find(std::string_view name) const {
        if (writes_->made() != 0) {
            const FrameId own = writes_->find(name);
            if (own != kNoFrame)
                return own;
        }
        const FrameId found = names_.find(name, below_.commit());
        if (found == kNoFrame) {
            if (reads_ != nullptr)
                reads_->note_absent(name);
            return found;
        }
        return alive(found) ? found : kNoFrame;
    }

private:
    Below below_;
    graph::Names<Memory> names_;
    clock::StampNs history_;
    const WriteSet<Memory>* writes_;
    Reads* reads_;
};

}  // namespace tfdb::txn
