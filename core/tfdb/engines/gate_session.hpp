// Common base of the sessions of all engines with a gate: slot, exclusive mode, pauses.
#pragma once

#include "tfdb/engines/backoff.hpp"
#include "tfdb/engines/shared_state.hpp"
#include "tfdb/txn/session.hpp"

namespace tfdb::txn {

/// Occupies a slot of the gate, or holds the closed gate and the commit lock. `Engine` is the
/// derived session: its `release_locks` releases its locks on frames, and its destructor ends an
/// open session. Threads: one. Guarantee: a thread in a slot never waits for the gate or the commit
/// lock.
template <class M, class Engine>
class GateSession {
public:
    using Memory = M;
    using Shared = SharedState<Memory>;

    GateSession(Shared& shared, const SessionOptions& options)
        : shared_(shared), options_(options), backoff_(options.slot) {}
    GateSession(const GateSession&) = delete;
    GateSession& operator=(const GateSession&) = delete;

    void begin(Mode mode) {
        if (mode == Mode::kAlone)
            return be_alone(true);
        slot_ = shared_.gate.enter(options_.slot);
        where_ = Where::kInSlot;
        engine().start();
    }
    [[nodiscard]] CommitNumber read_as_of() { return shared_.committed(); }
    [[nodiscard]] CommitNumber take_ticket() { return shared_.take_ticket(); }
    void become_alone() {
        leave_slot();
        be_alone(options_.priority > 0);
    }
    [[nodiscard]] bool alone() const { return where_ == Where::kAlone; }
    void end(bool) {
        leave_slot();
        if (alone()) {
            shared_.gate.open();
            shared_.lock.unlock();
            where_ = Where::kOutside;
        }
    }
    void pause() { backoff_.pause(); }

    /// For statistics; call between begin and end.
    void count(sync::SlotCount which) { shared_.gate.add(slot_, which); }
    /// Lists of the slot; use between begin and end, and not while alone.
    [[nodiscard]] SlotScratch<Memory>& scratch() { return shared_.scratch[slot_]; }
    [[nodiscard]] Shared& shared() { return shared_; }

protected:
    ~GateSession() = default;

    [[nodiscard]] typename Memory::Word& lock_word(FrameId id) const {
        return shared_.frames.word(id, history::kLock);
    }

    Shared& shared_;
    SessionOptions options_;
    unsigned slot_ = 0;

private:
    enum class Where : std::uint8_t { kOutside, kInSlot, kAlone };

    [[nodiscard]] Engine& engine() { return static_cast<Engine&>(*this); }
    void leave_slot() {
        if (where_ != Where::kInSlot)
            return;
        engine().release_locks();
        shared_.gate.leave(slot_);
        where_ = Where::kOutside;
    }
    void be_alone(bool urgent) {
        if (urgent)
            shared_.lock.lock_urgently();
        else
            shared_.lock.lock();
        shared_.gate.close();
        where_ = Where::kAlone;
        slot_ = 0;  // with the gate closed, no other thread counts in slot 0
    }

    Where where_ = Where::kOutside;
    sync::Backoff backoff_;
};

}  // namespace tfdb::txn
