// The view of engines that guard frames: the current forest, each frame behind its session's lock
// or version.
#pragma once

#include "tfdb/base/types.hpp"
#include "tfdb/txn/snapshot_view.hpp"

namespace tfdb::txn {

/// All data of the frames that the session admits.
/// Threads: the session's only. Guarantee: as the session's; `open` and `enter` refuse once it has
/// given up. An opened frame stays unchanged until the next frame, or until the session ends.
template <class Session>
class GuardedView : public SnapshotView<typename Session::Memory> {
    using Base = SnapshotView<typename Session::Memory>;

public:
    using Memory = typename Session::Memory;
    using Edge = typename Base::Edge;

    GuardedView(Session& session, const graph::Frames<Memory>& frames, clock::StampNs history)
        : Base(frames, kSeesAll, history), session_(&session) {}

    [[nodiscard]] bool open(FrameId id, Edge& edge) const {
        return session_->enter(id) && Base::open(id, edge);
    }
    [[nodiscard]] bool enter(FrameId id) const { return session_->enter(id); }
    void leave(FrameId id) const { session_->leave(id); }

private:
    Session* session_;
};

}  // namespace tfdb::txn
