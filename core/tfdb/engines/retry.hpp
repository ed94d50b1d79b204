// Runs a lookup or a concurrent write in a session: the number of attempts, and when one counts.
#pragma once

#include <algorithm>

#include "tfdb/engines/parallel_commit.hpp"
#include "tfdb/engines/shared_state.hpp"
#include "tfdb/txn/commit_transaction.hpp"
#include "tfdb/txn/session.hpp"

namespace tfdb::txn {

/// Runs `attempt(view)` until all its reads are of one state. After kAttemptsBeforeAlone failed
/// attempts it urgently requests to run alone, ahead of ordinary writers. So it ends, however many
/// others write at full speed. `as_of`: the commit that it saw.
template <Session S, class Attempt>
[[nodiscard]] lookup::Outcome read_through(S& session, CommitNumber& as_of, Attempt attempt) {
    constexpr int kAttempts = SyncTuning<typename S::Memory>::kAttemptsBeforeAlone;
    for (int tries = 0;; ++tries) {
        session.begin(tries < kAttempts ? Mode::kBesideOthers : Mode::kAlone);
        const lookup::Outcome outcome = attempt(session.view());
        as_of = session.read_as_of();
        const bool counts = outcome != lookup::Outcome::kLapped && session.confirm();
        if (counts || session.alone()) {
            session.end(counts);
            return outcome;
        }
        session.count(sync::SlotCount::kRetries);
        session.end(false);
        session.pause();
    }
}

/// The result of one attempt of a concurrent write.
enum class Written : std::uint8_t {
    kDone,
    kGiveUp,    // end(false), pause, begin again
    kNotPlain,  // requires a session that is alone; nothing was stored
};

/// Whether all of a batch only appends to its edges; certain if the frames are locked.
template <class Memory>
[[nodiscard]] bool only_adds(const SharedState<Memory>& shared, const PlainBatch<Memory>& batch) {
    return std::all_of(batch.items.begin(), batch.items.end(), [&](const auto& item) {
        return fits_edge(shared.frames, item.child, item.sample) &&
               fits_behind(shared.frames, item.child, item.sample.stamp);
    });
}

/// Appends a batch under its frames' locks, if all reads of the session are still valid. It calls
/// `stored(item)`, which must not throw, before the sample is visible. Throws CapacityExceeded:
/// then nothing is stored and no number is used. An engine without isolation stores each sample by
/// itself.
template <Session S, class Stored>
[[nodiscard]] Written write_beside(S& session, const PlainBatch<typename S::Memory>& batch,
                                   history::Readers& readers, CommitNumber& number, Stored stored) {
    using Item = typename PlainBatch<typename S::Memory>::Item;
    auto& shared = session.shared();
    history::WriteContext context(shared.committed(), shared.history, readers);
    const auto reserve = [&](std::span<const Item> items) {
        context = {shared.committed(), shared.history, readers};
        return reserve_beside<typename S::Memory>(shared.frames, context, items);
    };
    const auto store = [&](std::span<const Item> items) {
        number = session.take_ticket();
        context.committed = number - 1;
        append_beside<typename S::Memory>(shared.frames, context, items);
        for (const Item& item : items)
            stored(item);
    };
    if constexpr (S::kIsolates) {
        if (!session.lock(batch.frames))
            return Written::kGiveUp;
        if (!only_adds(shared, batch))
            return Written::kNotPlain;
        if (!session.confirm())
            return Written::kGiveUp;
        if (!reserve(batch.items))
            return Written::kNotPlain;
        store(batch.items);
    } else {
        // A sample that has become too old is still stored; no read returns it.
        if (!only_adds(shared, batch))
            return Written::kNotPlain;
        // If memory suffices only for a part, nothing is stored.
        bool fits = true;
        for_each_edge<typename S::Memory>(shared.frames, batch.items, [&](auto, const auto& items) {
            (void)session.lock({&items.front().child, 1});
            fits = fits && reserve(items);
            session.release_locks();
        });
        if (!fits)
            return Written::kNotPlain;
        for (const Item& item : batch.items) {
            (void)session.lock({&item.child, 1});
            (void)reserve({&item, 1});
            store({&item, 1});
            session.release_locks();
        }
    }
    return Written::kDone;
}

/// Runs `beside(number)` until it succeeds, or `alone()` if it cannot run concurrently or has
/// failed kAttemptsBeforeAlone times. Returns the commit's number; an exception from these ends the
/// session.
template <Session S, class Beside, class ByItself>
CommitNumber write_through(S& session, Beside beside, ByItself alone) {
    constexpr int kAttempts = SyncTuning<typename S::Memory>::kAttemptsBeforeAlone;
    for (int tries = 0;; ++tries) {
        session.begin(tries < kAttempts ? Mode::kBesideOthers : Mode::kAlone);
        CommitNumber number = 0;
        const Written written = session.alone() ? Written::kNotPlain : beside(number);
        if (written == Written::kNotPlain) {
            if (!session.alone())
                session.become_alone();
            number = alone();
        }
        if (written != Written::kGiveUp) {
            session.end(true);
            return number;
        }
        session.count(sync::SlotCount::kRetries);
        session.end(false);
        session.pause();
    }
}

/// Converts the writes to samples that only append to existing edges. False: they do more.
template <class Memory, class Store>
[[nodiscard]] bool make_plain(const WriteSet<Memory>& writes, Store& store,
                              PlainBatch<Memory>& plain) {
    plain.items.clear();
    plain.frames.clear();
    if (writes.made() != 0 || !writes.removed().empty())
        return false;
    std::vector<const typename WriteSet<Memory>::Edge*> edges;
    for (const auto& edge : writes.edges())
        edges.push_back(&edge);
    std::sort(edges.begin(), edges.end(),
              [](const auto* a, const auto* b) { return a->child < b->child; });
    for (const auto* edge : edges) {
        plain.frames.push_back(edge->child);
        const std::uint64_t author = store.author_number(writes.author_of(*edge));
        for (const auto& own : edge->samples.in_order()) {
            auto& item = plain.items.emplace_back();
            item.child = edge->child;
            item.author = author;
            item.sample.stamp = own.stamp;
            item.sample.parent = own.parent;
            item.sample.payload = own.payload;
        }
    }
    return true;
}

/// Stores plain writes concurrently: the transaction has then ended, with or without success.
/// False: it must be alone for them.
template <Session S, class Store>
[[nodiscard]] bool commit_beside(S& session, const WriteSet<typename S::Memory>& writes,
                                 Store& store, CommitOutcome& outcome) {
    auto& plain = session.scratch().batch;
    if (writes.cleared() || !make_plain(writes, store, plain))
        return false;
    const Written written =
        write_beside(session, plain, store.readers(), outcome.commit,
                     [&](const auto& item) { store.set_author(item.child, item.author); });
    if (written == Written::kNotPlain)
        return false;
    if (written == Written::kDone)
        outcome.kind = CommitOutcome::kCommitted;
    session.end(written == Written::kDone);
    return true;
}

}  // namespace tfdb::txn
