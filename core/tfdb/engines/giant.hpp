// One mutex for everything, as in tf2.
#pragma once

#include <span>

#include "tfdb/engines/backoff.hpp"
#include "tfdb/engines/shared_state.hpp"
#include "tfdb/txn/session.hpp"
#include "tfdb/txn/snapshot_view.hpp"

namespace tfdb::txn {

/// Holds the commit lock from `begin` to `end`: no other operation runs concurrently.
/// Threads: one. Guarantee: never gives up; `begin` waits for all earlier operations.
template <class M>
class GiantSession {
public:
    using Memory = M;
    using Shared = SharedState<Memory>;
    using View = SnapshotView<Memory>;
    static constexpr bool kWritesBesideOthers = false;
    static constexpr bool kIsolates = true;

    GiantSession(Shared& shared, const SessionOptions& options)
        : shared_(shared), options_(options) {}
    ~GiantSession() { end(false); }
    GiantSession(const GiantSession&) = delete;
    GiantSession& operator=(const GiantSession&) = delete;

    void begin(Mode mode) {
        if (options_.priority > 0 || mode == Mode::kAlone) {
            shared_.lock.lock_urgently();
        } else if (!shared_.lock.try_lock()) {
            shared_.lock.lock();
            count(sync::SlotCount::kLockWaits);
        }
        open_ = true;
    }
    [[nodiscard]] View view() { return {shared_.frames, shared_.committed(), shared_.history}; }
    [[nodiscard]] bool confirm() { return true; }
    [[nodiscard]] CommitNumber read_as_of() { return shared_.committed(); }
    [[nodiscard]] bool lock(std::span<const FrameId>) { return true; }
    [[nodiscard]] CommitNumber take_ticket() { return shared_.take_ticket(); }
    void become_alone() {}
    [[nodiscard]] bool alone() const { return true; }
    void end(bool) {
        if (open_)
            shared_.lock.unlock();
        open_ = false;
    }
    void pause() {}
    void count(sync::SlotCount which) { shared_.gate.add(0, which); }
    [[nodiscard]] std::uint64_t age() const { return 0; }

private:
    Shared& shared_;
    SessionOptions options_;
    bool open_ = false;
};

}  // namespace tfdb::txn
