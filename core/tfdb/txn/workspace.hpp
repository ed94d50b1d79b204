// A transaction in progress: its session, its reads and its writes.
#pragma once

#include <algorithm>
#include <optional>
#include <string_view>
#include <utility>
#include <vector>

#include "tfdb/graph/names.hpp"
#include "tfdb/graph/pins.hpp"
#include "tfdb/txn/child_index.hpp"
#include "tfdb/txn/read_set.hpp"
#include "tfdb/txn/session.hpp"
#include "tfdb/txn/transaction_view.hpp"
#include "tfdb/txn/write_set.hpp"

namespace tfdb::txn {

/// The state of an edge that a write depends on.
struct EdgeKind {
    bool written = false;  // it has samples
    bool is_static = false;
    clock::StampNs newest = history::kNoStamp;
};

/// Reads and writes of one transaction. If a call returns kLapped, the transaction has a conflict.
/// Threads: one. Guarantee: that of the session; reads are recorded, writes are private.
template <Session S, class R = ReadSet>
class Workspace {
public:
    using Memory = typename S::Memory;
    using Outcome = lookup::Outcome;
    using View = TransactionView<S, R>;
    using Writes = WriteSet<Memory>;

    /// `session`: arguments of S. A session that is alone records no reads, because nothing can
    /// change.
    template <class... Args>
    Workspace(graph::Frames<Memory> frames, clock::StampNs history, Mode mode, Args&&... session)
        : frames_(frames),
          history_(history),
          noting_(mode != Mode::kAlone),
          session_(std::forward<Args>(session)...) {
        session_.begin(mode);
    }

    [[nodiscard]] S& session() { return session_; }
    [[nodiscard]] R& reads() { return *reads_; }
    [[nodiscard]] Writes& writes() const { return *writes_; }
    [[nodiscard]] View view() {
        return {session_.view(), graph::Names<Memory>(frames_), history_, writes(),
                noting_ ? &reads() : nullptr};
    }

    /// Runs `body(view)` until no writer overtakes it. kLapped: writers overtook it repeatedly, or
    /// an earlier read is outdated.
    template <class Body>
    [[nodiscard]] Outcome steadily(Body body) {
        constexpr int kTries = 16;
        constexpr int kTriesBeforePin = 4;
        std::optional<graph::Pin<Memory>> pin;
        Outcome outcome = Outcome::kLapped;
        for (int i = 0; i < kTries && outcome == Outcome::kLapped; ++i) {
            if (i == kTriesBeforePin)
                pin.emplace(graph::Pins<Memory>(frames_, graph::kReadPins));
            outcome = body(view());
        }
        return session_.confirm() ? outcome : Outcome::kLapped;
    }
    /// A frame may be missing in the view's state because its slot was reused since.
    [[nodiscard]] Outcome unless_reused(const View& view, Outcome outcome) const {
        Memory::fence_acquire();
        const CommitNumber floor = frames_.store_word(graph::kRecycleFloor).load_relaxed();
        return view.commit() < floor ? Outcome::kLapped : outcome;
    }

    /// kFailed: no frame has that name.
    [[nodiscard]] Outcome find(std::string_view name, FrameId& id) {
        return steadily([&](const View& view) {
            id = view.find(name);
            return id == kNoFrame ? unless_reused(view, Outcome::kFailed) : Outcome::kOk;
        });
    }

    /// Reads the kind of edge that a sample at `stamp` (or kStaticStamp) meets. It records the
    /// conditions under which the sample still fits.
    [[nodiscard]] Outcome look_at(FrameId child, clock::StampNs stamp, EdgeKind& kind) {
        return steadily([&](const View& view) {
            typename View::Edge edge;
            if (!view.open(child, edge))
                return Outcome::kLapped;
            kind.written = edge.has_samples();
            kind.is_static = edge.holds_static();
            if (!kind.is_static)
                kind.newest = edge.peek_newest().stamp;
            if (!edge.confirm())
                return Outcome::kLapped;
            if (!kind.written)
                edge.note_all();
            else if (stamp >= kind.newest - history_)
                edge.note_used(stamp);
            else
                edge.note_newest(kind.newest);  // the error names it
            return Outcome::kOk;
        });
    }
    /// Requires `look_at` before, unless the transaction created the frame.
    void put(FrameId child, const typename Writes::Sample& sample) {
        using history::Topology;
        const bool bare = writes_->is_own(child) || writes_->cleared();
        const std::uint64_t known = bare ? Topology::kRoot : frames_.topology(child);
        writes_->put(child, sample, Topology::parent(known),
                     Topology::depth(view().topology(sample.parent)));
    }

    /// Calls `start()`, then visit(view, id) for each existing frame until it answers other than
    /// kOk. The transaction then depends on the set of all frames.
    template <class Start, class Visit>
    [[nodiscard]] Outcome for_each_frame(Start start, Visit visit) {
        return steadily([&](const View& view) {
            start();
            const auto made = static_cast<FrameId>(writes_->made());
            const FrameId stored = view.frame_count() - made;
            for (FrameId i = 0; i < stored + made; ++i) {
                const FrameId id = i < stored ? i : Writes::own_id(i - stored);
                const Outcome outcome = view.alive(id) ? visit(view, id) : Outcome::kOk;
                if (outcome != Outcome::kOk)
                    return outcome;
            }
            if (noting_)
                note_every_frame();
            return unless_reused(view, Outcome::kOk);
        });
    }

    /// The frames whose newest parent is the frame, ascending.
    [[nodiscard]] Outcome children_of(FrameId id, std::vector<FrameId>& children) {
        children = writes_->naming(id);
        if (!writes_->is_own(id) && !append_stored_children(id, children))
            return Outcome::kLapped;
        std::sort(children.begin(), children.end());
        children.erase(std::unique(children.begin(), children.end()), children.end());
        Outcome outcome = Outcome::kOk;
        std::erase_if(children, [&](FrameId child) {
            if (writes_->is_removed(child) || outcome != Outcome::kOk)
                return true;
            FrameId parent = id;
            if (writes_->edge(child) != nullptr || writes_->cleared())
                outcome = newest_parent(child, parent);
            return parent != id;
        });
        return outcome;
    }

private:
    [[nodiscard]] Outcome newest_parent(FrameId child, FrameId& parent) {
        return steadily(
            [&](const View& view) { return lookup::parent_at(view, child, std::nullopt, parent); });
    }
    /// Frames that the transaction removes still exist for other sessions.
    void note_every_frame() {
        for (const FrameId id : writes_->removed()) {
            if (!writes_->is_own(id))
                (void)reads_->note_frame(id, frames_.generation(id));
        }
        reads_->note_every_frame();
    }
    /// Appends the store's own children. If the frame has no children now, that is recorded:
    /// children in the state that is read are either gone for good, or the commit finds them.
    [[nodiscard]] bool append_stored_children(FrameId id, std::vector<FrameId>& children) {
        std::vector<FrameId> stored;
        if (frames_.word(id, history::kChildren).load_relaxed() != 0) {
            const SnapshotView<Memory> below(frames_, session_.view().commit(), history_);
            if (!indexed_ && !index_.build(below))
                return false;
            indexed_ = true;
            index_.append_children(id, stored);
        }
        children.insert(children.end(), stored.begin(), stored.end());
        if (noting_)
            reads_->note_children(id, std::move(stored));
        return true;
    }

    graph::Frames<Memory> frames_;
    clock::StampNs history_;
    bool noting_;
    S session_;
    KeptByThread<R> reads_;
    KeptByThread<Writes> writes_;
    ChildIndex index_;  // for the state that is read
    bool indexed_ = false;
};

}  // namespace tfdb::txn
