// One lock per frame and no further isolation, like TF with finer locks. Not atomic.
#pragma once

#include <span>

#include "tfdb/engines/frame_lock.hpp"
#include "tfdb/engines/gate_session.hpp"
#include "tfdb/txn/snapshot_view.hpp"

namespace tfdb::txn {

/// One frame as `fine` reads it: its lock is held until the edge is destroyed or opens another
/// frame.
/// Threads: the session's only. Guarantee: as history::EdgeView's.
template <class Session>
class FineEdge : public history::EdgeView<typename Session::Memory> {
public:
    FineEdge() = default;
    ~FineEdge() { release_locks(); }
    FineEdge(const FineEdge&) = delete;
    FineEdge& operator=(const FineEdge&) = delete;

    void take(Session& session, FrameId id) {
        release_locks();
        (void)session.enter(id);
        session_ = &session;
        id_ = id;
    }

private:
    void release_locks() {
        if (session_ != nullptr)
            session_->leave(id_);
        session_ = nullptr;
    }

    Session* session_ = nullptr;
    FrameId id_ = kNoFrame;
};

/// Every frame in its current state.
/// Threads: the session's only. Guarantee: each frame is of one state; two frames may be of two
/// states.
template <class Session>
class FineView : public SnapshotView<typename Session::Memory> {
    using Base = SnapshotView<typename Session::Memory>;

public:
    using Memory = typename Session::Memory;
    using Edge = FineEdge<Session>;

    FineView(Session& session, const graph::Frames<Memory>& frames, clock::StampNs history)
        : Base(frames, kSeesAll, history), session_(&session) {}

    [[nodiscard]] bool open(FrameId id, Edge& edge) const {
        edge.take(*session_, id);
        return Base::open(id, edge);
    }
    [[nodiscard]] bool enter(FrameId id) const { return session_->enter(id); }
    void leave(FrameId id) const { session_->leave(id); }

private:
    Session* session_;
};

/// A frame's lock is held, shared, while the frame is read, and exclusively while one sample is
/// stored. So a path may mix samples of different commits, and readers may see parts of a batch:
/// this engine exists for comparison.
/// Threads: one. Guarantee: never gives up. A waiting reader holds nothing and a waiting writer
/// holds only frames of lower ids, so no cycle can arise.
template <class M>
class FineSession : public GateSession<M, FineSession<M>> {
    using Base = GateSession<M, FineSession<M>>;
    using Lock = sync::BasicFrameLock<typename M::Word>;

public:
    using View = FineView<FineSession>;
    static constexpr bool kWritesBesideOthers = true;
    static constexpr bool kIsolates = false;

    using Base::Base;
    ~FineSession() { this->end(false); }

    [[nodiscard]] View view() { return {*this, this->shared_.frames, this->shared_.history}; }
    [[nodiscard]] bool confirm() { return true; }
    [[nodiscard]] bool lock(std::span<const FrameId> frames) {
        auto& held = this->scratch().held;
        held.reserve(held.size() + frames.size());  // nothing may throw after the lock was granted
        for (const FrameId id : frames) {
            get(id, true);
            held.push_back(id);
        }
        return true;
    }
    /// Releases its locks and stays in the slot.
    void release_locks() {
        if (stays_ > 0)
            release(read_);
        start();
        auto& held = this->scratch().held;
        for (; !held.empty(); held.pop_back())
            release(held.back());
    }

    /// Locks one frame at a time. Waiting for a second lock while holding the first could deadlock,
    /// so a second frame is read without its lock.
    [[nodiscard]] bool enter(FrameId id) {
        if (this->alone() || (stays_ > 0 && id != read_))
            return true;
        if (stays_ == 0)
            get(id, false);
        read_ = id;
        ++stays_;
        return true;
    }
    void leave(FrameId id) {
        if (id == read_ && --stays_ == 0) {
            release(id);
            read_ = kNoFrame;
        }
    }
    [[nodiscard]] std::uint64_t age() const { return 0; }

private:
    friend Base;

    void start() {
        stays_ = 0;
        read_ = kNoFrame;
    }
    void get(FrameId id, bool exclusive) {
        Lock lock(this->lock_word(id));
        const auto request = [&] {
            return exclusive ? lock.try_exclusive(this->slot_) : lock.try_shared(this->slot_);
        };
        auto attempt = request();
        if (!attempt)
            this->count(sync::SlotCount::kLockWaits);
        for (int spin = 0; !attempt; attempt = request(), ++spin) {
            if (spin < Base::Shared::Tuning::kSpins) {
                sync::spin_pause();
            } else {
                lock.wait_for(attempt, this->shared_.event, [] { return false; });
            }
        }
    }
    void release(FrameId id) {
        Lock lock(this->lock_word(id));
        if (lock.release(this->slot_))
            this->shared_.event.notify_all();
    }

    FrameId read_ = kNoFrame;
    unsigned stays_ = 0;
};

}  // namespace tfdb::txn
