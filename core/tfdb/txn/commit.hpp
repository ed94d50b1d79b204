// One commit in progress: what it made, wrote and removed, until it is published or undone.
#pragma once

#include <cstdint>
#include <string_view>
#include <vector>

#include "tfdb/base/error.hpp"
#include "tfdb/graph/frames.hpp"
#include "tfdb/graph/names.hpp"
#include "tfdb/history/edge_writer.hpp"
#include "tfdb/txn/snapshot_view.hpp"

namespace tfdb::txn {

/// A cycle that a commit would close, and the one of its samples that is to be left out.
struct Cycle {
    FrameId child = kNoFrame;
    FrameId parent = kNoFrame;
    std::size_t item = 0;  // as told to `append`: the greatest of those that close it together
    // The commit's other samples of this edge that name this parent for [from, to) close it too.
    clock::StampNs from = 0;
    clock::StampNs to = 0;
};

/// Lists that a commit fills; kept by the store, so that no commit allocates in steady state.
struct CommitScratch {
    struct Touched {
        FrameId id;
        FrameId old_parent;  // newest parent before this commit
        std::uint64_t late;  // how many samples had come late
    };
    struct Relation {  // a sample whose parent was not known to be one at its stamp
        FrameId child;
        FrameId parent;
        clock::StampNs stamp;
        std::size_t item;
    };
    struct Stop {  // of the walk that looks for cycles
        FrameId id;
        clock::StampNs from;
        clock::StampNs to;
        bool entered;  // what lies above it is being looked at
    };
    struct Mark {  // what one search knows of a frame
        std::uint64_t search = 0;
        clock::StampNs from = 0;  // within [from, to) all above it was looked at
        clock::StampNs to = 0;
        bool on_path = false;
        bool blamed = false;  // a sample of its edge is to be left out

        [[nodiscard]] bool covers(clock::StampNs a, clock::StampNs b) const {
            return from <= a && b <= to;
        }
        void leave(clock::StampNs a, clock::StampNs b) {
            on_path = false;
            const bool apart = from == to || b < from || to < a;
            from = apart || a < from ? a : from;
            to = apart || to < b ? b : to;
        }
    };
    std::vector<Touched> touched;
    std::vector<FrameId> made;
    std::vector<FrameId> removed;
    std::vector<FrameId> cleared;
    std::vector<Relation> relations;
    std::vector<Stop> stops;
    std::vector<FrameId> path;            // those of the stops that were entered
    std::vector<Mark> marks;              // by frame
    std::vector<std::uint32_t> by_child;  // the relations, sorted
    std::vector<std::uint32_t> depths;    // by frame
    std::vector<FrameId> climb;
    std::uint64_t attempts = 0;
    std::uint64_t searches = 0;
    std::uint64_t steps = 0;  // stops, samples and relations that searches looked at: for tests
};

/// Writes of one commit. Nothing is visible before `publish`; the destructor undoes what was not
/// published.
/// Threads: only the holder of the commit lock, from construction to destruction.
/// Guarantee: all or nothing, also when a call throws.
template <class Memory>
class Commit {
public:
    /// `readers` is asked only when a segment is full or a slot is to be reused, and outlives it.
    Commit(graph::Frames<Memory> frames, CommitScratch& scratch, clock::StampNs history,
           history::Readers& readers);
    ~Commit();
    Commit(const Commit&) = delete;
    Commit& operator=(const Commit&) = delete;

    [[nodiscard]] CommitNumber number() const { return context_.committed + 1; }
    /// The forest with what was written so far.
    [[nodiscard]] SnapshotView<Memory> view() const {
        return {frames_, number(), context_.history};
    }

    /// The frame of that name as this commit sees it, or kNoFrame.
    [[nodiscard]] FrameId find_frame(std::string_view name) const;
    /// The frame of that name, made if there is none. Throws CapacityExceeded.
    [[nodiscard]] FrameId frame(std::string_view name);
    /// True if this commit has written to the frame before; marks it as written.
    [[nodiscard]] bool touch(FrameId child);
    /// Appends one sample; `touch(child)` came before. The samples of one edge come in stamp order.
    void append(FrameId child, const history::NewSample<Memory>& sample, std::size_t item);
    /// Hides all samples of an edge; once in a commit at most.
    void clear(FrameId child);
    /// The frame exists no longer; nothing names it as its newest parent.
    void remove(FrameId id);

    /// Finds a cycle in time among what was appended. To be called before `publish`.
    [[nodiscard]] bool find_cycle(Cycle& cycle);
    /// Finds cycles, not always all: with their samples left out, there may be others.
    [[nodiscard]] bool find_cycles(std::vector<Cycle>& cycles);
    /// After a search: every sample that could be part of any cycle.
    void suspects(std::vector<Cycle>& cycles) const;
    /// Does beforehand all of `publish` that may throw.
    void prepare();
    /// Makes all of it visible at once. Throws nothing after `prepare`, and only before anything
    /// is visible.
    CommitNumber publish();

    /// The parent that the newest sample names, kNoFrame for a root.
    [[nodiscard]] FrameId newest_parent(FrameId id) const;

private:
    using StampNs = clock::StampNs;

    [[nodiscard]] history::EdgeWriter<Memory> writer(FrameId id) const {
        return {frames_.memory(), frames_.header(id)};
    }
    [[nodiscard]] FrameId take_slot();
    void empty_slot(FrameId id);
    void empty_removed();
    [[nodiscard]] bool holds(const CommitScratch::Relation& relation, StampNs& from,
                             StampNs& to) const;
    enum class Next : std::uint8_t {
        kGoOn,     // above the same suspect
        kSuspect,  // the other ones
        kEnd,
    };
    template <class Found>
    void search(Found found);
    template <class Found>
    [[nodiscard]] Next walk(const Cycle& suspect, Found& found);
    [[nodiscard]] CommitScratch::Mark& mark_of(FrameId id);
    template <class Visit>
    void for_each_in_cycle(FrameId top, Visit visit) const;
    [[nodiscard]] Cycle blame(const CommitScratch::Stop& top, const Cycle& suspect);
    [[nodiscard]] bool held_before(const CommitScratch::Relation& relation, StampNs stamp) const;
    void push_parents(const CommitScratch::Stop& at);
    void push_stop(FrameId parent, CommitNumber written, StampNs from, StampNs to);
    void push_mixed_parents(const history::EdgeView<Memory>& edge, const CommitScratch::Stop& at);
    void settle_parents();
    void refresh_depths();
    void abort();

    graph::Frames<Memory> frames_;
    graph::Names<Memory> names_;
    CommitScratch& scratch_;
    history::WriteContext context_;
    history::Readers& readers_;
    bool prepared_ = false;
    bool published_ = false;
    bool depths_stale_ = false;  // a frame with children got another parent
};

}  // namespace tfdb::txn

#include "tfdb/txn/commit.ipp"
#include "tfdb/txn/cycle.ipp"
