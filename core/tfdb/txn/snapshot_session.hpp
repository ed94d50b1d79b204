// The default engine: reads from a held snapshot, one commit at a time.
#pragma once

#include <span>

#include "tfdb/graph/pins.hpp"
#include "tfdb/txn/session.hpp"
#include "tfdb/txn/snapshot_view.hpp"

namespace tfdb::txn {

/// A transaction that reads commit S. Under the commit lock it is validated against the commits
/// since S. `Lock` is the store's commit lock.
/// Threads: one at a time. Guarantee: reads never wait; `begin(kAlone)` and `become_alone` block.
template <class M, class Lock>
class SnapshotSession {
public:
    using Memory = M;
    using View = SnapshotView<Memory>;
    static constexpr bool kWritesBesideOthers = false;
    static constexpr bool kIsolates = true;

    SnapshotSession(graph::Frames<Memory> frames, Lock& lock, clock::StampNs history, bool urgent)
        : frames_(frames), lock_(lock), history_(history), urgent_(urgent) {}
    ~SnapshotSession() { end(false); }
    SnapshotSession(const SnapshotSession&) = delete;
    SnapshotSession& operator=(const SnapshotSession&) = delete;

    void begin(Mode mode) {
        if (mode == Mode::kAlone) {
            take_lock(true);
            alone_ = true;
            commit_ = frames_.store_word(graph::kCommit).load_acquire();
            return;
        }
        pin_ = pins().take();
        pinned_ = true;
        commit_ = frames_.store_word(graph::kCommit).load_acquire();
    }

    [[nodiscard]] View view() { return {frames_, commit_, history_}; }
    [[nodiscard]] bool confirm() { return true; }
    [[nodiscard]] CommitNumber read_as_of() { return commit_; }
    /// Only a session that is alone writes.
    [[nodiscard]] bool lock(std::span<const FrameId>) { return alone_; }
    [[nodiscard]] CommitNumber take_ticket() { return commit_ + 1; }

    void become_alone() {
        if (alone_)
            return;
        take_lock(urgent_);
        alone_ = true;
        unpin();
    }
    [[nodiscard]] bool alone() const { return alone_; }

    void end(bool) {
        unpin();
        if (alone_)
            lock_.unlock();
        alone_ = false;
    }
    void pause() {}

private:
    void take_lock(bool urgent) {
        if (urgent)
            lock_.lock_urgently();
        else
            lock_.lock();
    }
    [[nodiscard]] graph::Pins<Memory> pins() const { return {frames_, graph::kHeldPins}; }
    void unpin() {
        if (pinned_)
            pins().drop(pin_);
        pinned_ = false;
    }

    graph::Frames<Memory> frames_;
    Lock& lock_;
    clock::StampNs history_;
    bool urgent_;
    CommitNumber commit_ = 0;
    unsigned pin_ = 0;  // the count of held snapshots, if pinned
    bool pinned_ = false;
    bool alone_ = false;
};

}  // namespace tfdb::txn
