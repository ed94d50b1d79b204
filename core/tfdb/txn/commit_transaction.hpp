// The commit of a transaction: its reads are validated, then its writes become one commit.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "tfdb/txn/commit.hpp"
#include "tfdb/txn/read_set.hpp"
#include "tfdb/txn/session.hpp"
#include "tfdb/txn/write_set.hpp"

namespace tfdb::txn {

/// The outcome of a transaction.
struct CommitOutcome {
    enum Kind : std::uint8_t {
        kCommitted,
        kConflict,  // `conflict` is the reason; kNone: the engine aborted it
        kCycle,     // `child` would be its own ancestor
    };
    Kind kind = kCommitted;
    CommitNumber commit = 0;  // its number, or that of the state it read
    ReadConflict conflict;
    FrameId child = kNoFrame;  // in the transaction's ids
    FrameId parent = kNoFrame;
    clock::StampNs stamp = history::kNoStamp;
    std::uint32_t authority = 0;
};

/// Adds a WriteSet to a commit: a clear, removals, new frames, then each edge's samples in stamp
/// order.
/// Threads: as Commit. Guarantee: as Commit; after an exception, the Commit's destructor undoes the
/// rest.
template <class Memory>
class ApplyWrites {
public:
    using Writes = WriteSet<Memory>;

    /// `authors`: number of each edge's authority.
    ApplyWrites(Commit<Memory>& commit, const Writes& writes,
                std::span<const std::uint64_t> authors)
        : commit_(commit), writes_(writes), authors_(authors), ids_(writes.made(), kNoFrame) {}

    void apply() {
        if (writes_.cleared())
            commit_.clear_moving([this](FrameId id) { return writes_.is_removed(id); });
        for (const FrameId id : writes_.removed()) {
            if (!writes_.is_own(id))
                commit_.remove(id);
        }
        // Created and removed frames that samples still name come first: their names may have been
        // reused.
        for (const auto& edge : writes_.edges()) {
            for (const auto& sample : edge.samples.in_order()) {
                if (writes_.is_own(sample.parent) && writes_.is_removed(sample.parent))
                    make_and_remove(sample.parent);
            }
        }
        for (std::size_t place = 0; place < ids_.size(); ++place) {
            const FrameId own = Writes::own_id(place);
            if (!writes_.is_removed(own))
                ids_[place] = commit_.frame(writes_.name(own));
        }
        auto author = authors_.begin();
        for (const auto& edge : writes_.edges()) {
            commit_.set_author(*author++);
            if (edge.child != kNoFrame)
                append(edge);
        }
    }

    [[nodiscard]] FrameId real(FrameId id) const {
        return writes_.is_own(id) ? ids_[Writes::place_of(id)] : id;
    }
    /// The sample that an item of the commit stands for.
    void describe(std::size_t item, CommitOutcome& outcome) const {
        for (const auto& edge : writes_.edges()) {
            const auto& samples = edge.samples.in_order();
            if (item < samples.size()) {
                outcome.child = edge.child;
                outcome.parent = samples[item].parent;
                outcome.stamp = samples[item].stamp;
                outcome.authority = samples[item].authority;
                return;
            }
            item -= samples.size();
        }
    }

private:
    void make_and_remove(FrameId own) {
        FrameId& id = ids_[Writes::place_of(own)];
        if (id != kNoFrame)
            return;
        id = commit_.frame(writes_.name(own));
        commit_.remove(id);
    }
    void append(const typename Writes::Edge& edge) {
        const FrameId child = real(edge.child);
        (void)commit_.touch(child);
        const auto new_sample = [this](const auto& own) {
            return history::NewSample<Memory>{own.stamp, real(own.parent), own.payload};
        };
        const auto& samples = edge.samples.in_order();
        if (samples.size() == 1) {
            commit_.append(child, new_sample(samples.front()), items_++);
            return;
        }
        std::vector<history::NewSample<Memory>> together;
        together.reserve(samples.size());
        for (const auto& own : samples)
            together.push_back(new_sample(own));
        commit_.append(child, std::span<const history::NewSample<Memory>>(together),
                       [this](std::size_t i) { return items_ + i; });
        items_ += samples.size();
    }

    Commit<Memory>& commit_;
    const Writes& writes_;
    std::span<const std::uint64_t> authors_;
    std::vector<FrameId> ids_;  // of the frames that it creates, by position
    std::size_t items_ = 0;
};

/// Whether the written edges still have the kind, moving or static, that they had. For engines that
/// do not validate reads.
template <class Memory>
[[nodiscard]] ReadConflict check_kinds(const graph::Frames<Memory>& frames,
                                       const WriteSet<Memory>& writes) {
    for (const auto& edge : writes.edges()) {
        if (edge.child == kNoFrame || writes.is_own(edge.child))
            continue;
        const history::EdgeSegments<Memory> writer(frames.memory(), frames.header(edge.child));
        const bool is_static = writer.is_static();
        const bool goes = writes.cleared() && !is_static;
        if (writer.has_samples() && !goes && is_static != edge.is_static)
            return {ReadConflict::kEdge, edge.child, {}, {history::Change::kStatic, -1}};
    }
    return {};
}

/// Requires that the session is alone and its reads are still valid. `Store` starts commits,
/// numbers authorities and checks commits: `author_number(name)` and `check_writable(commit)` may
/// throw.
template <class Memory, class Store>
[[nodiscard]] CommitOutcome commit_alone(const WriteSet<Memory>& writes, Store& store) {
    CommitOutcome outcome;
    std::vector<std::uint64_t> authors;
    for (const auto& edge : writes.edges())
        authors.push_back(store.author_number(writes.author_of(edge)));
    Commit<Memory> commit = store.start_commit();
    ApplyWrites<Memory> applied(commit, writes, authors);
    applied.apply();
    store.check_writable(commit);
    Cycle cycle;
    if (commit.cycles().find(cycle)) {
        outcome.kind = CommitOutcome::kCycle;
        applied.describe(cycle.item, outcome);
        return outcome;
    }
    outcome.commit = commit.publish();
    return outcome;
}

/// Ends a transaction whose session is open. The session has ended unless this throws. If this
/// throws, nothing was stored.
template <Session S, class Reads, class Store>
[[nodiscard]] CommitOutcome commit_transaction(S& session, Reads& reads,
                                               const WriteSet<typename S::Memory>& writes,
                                               Store& store) {
    CommitOutcome outcome;
    outcome.kind = CommitOutcome::kConflict;
    const bool was_alone = session.alone();
    const CommitNumber since = session.read_as_of();
    outcome.commit = since;
    if (!session.confirm()) {
        session.end(false);
        return outcome;
    }
    if (writes.empty()) {
        session.end(true);
        outcome.kind = CommitOutcome::kCommitted;
        return outcome;
    }
    if (!was_alone) {
        if constexpr (S::kWritesBesideOthers) {
            if (commit_beside(session, writes, store, outcome))
                return outcome;
        }
        session.become_alone();
        const CommitNumber now = store.frames.store_word(graph::kCommit).load_acquire();
        outcome.conflict = reads.validate(store.frames, store.history, since, now, S::kIsolates);
        if (!outcome.conflict)
            outcome.conflict = check_kinds(store.frames, writes);
        if (outcome.conflict) {
            session.end(false);
            return outcome;
        }
    }
    outcome = commit_alone(writes, store);
    session.end(outcome.kind == CommitOutcome::kCommitted);
    return outcome;
}

}  // namespace tfdb::txn
