// Optimistic engine: reads record versions and validate them at the end, after S. Tu et al. (SOSP
// 2013).
#pragma once

#include <algorithm>
#include <span>

#include "tfdb/engines/gate_session.hpp"
#include "tfdb/engines/guarded_view.hpp"
#include "tfdb/engines/version_lock.hpp"

namespace tfdb::txn {

/// Reads take no lock. A read records the frame's version first; `confirm` checks that all versions
/// are unchanged, otherwise the attempt is void. Writes lock their frames in order of id.
/// Threads: one. Guarantee: no thread waits for a reader. A locking thread waits while it holds
/// only frames of lower ids, so no cycle can arise.
template <class M>
class SiloSession : public GateSession<M, SiloSession<M>> {
    using Base = GateSession<M, SiloSession<M>>;
    using Lock = sync::BasicVersionLock<typename M::Word, Base::Shared::Tuning::kSpins>;

public:
    using View = GuardedView<SiloSession>;
    static constexpr bool kWritesBesideOthers = true;
    static constexpr bool kIsolates = true;

    using Base::Base;
    ~SiloSession() { this->end(false); }

    [[nodiscard]] View view() { return {*this, this->shared_.frames, this->shared_.history}; }
    [[nodiscard]] bool confirm() {
        if (this->alone())
            return true;
        const auto& noted = this->scratch().noted;
        return !given_up_ && std::all_of(noted.begin(), noted.end(), [&](const auto& frame) {
            Lock lock(this->lock_word(frame.id));
            return lock.unchanged(frame.version) ||
                   (locked(frame.id) && lock.unchanged_until_mine(frame.version));
        });
    }
    /// `frames` ascends, so the locked ids stay sorted.
    [[nodiscard]] bool lock(std::span<const FrameId> frames) {
        auto& held = this->scratch().held;
        held.reserve(held.size() + frames.size());
        for (const FrameId id : frames) {
            Lock lock(this->lock_word(id));
            if (!lock.try_lock()) {
                this->count(sync::SlotCount::kLockWaits);
                lock.lock(this->shared_.event);
            }
            held.push_back(id);
        }
        return true;
    }
    [[nodiscard]] CommitNumber take_ticket() {
        wrote_ = true;
        return Base::take_ticket();
    }

    [[nodiscard]] bool enter(FrameId id) {
        if (this->alone())
            return true;
        Lock lock(this->lock_word(id));
        std::uint64_t version = lock.version();
        for (int spin = 0; Lock::locked(version) && !locked(id); ++spin) {
            if (given_up_ || spin >= Base::Shared::Tuning::kSpins) {
                given_up_ = true;
                return false;
            }
            sync::spin_pause();
            version = lock.version();
        }
        if (!Lock::locked(version))
            this->scratch().noted.push_back({id, version});
        return !given_up_;
    }
    void leave(FrameId) {}
    [[nodiscard]] std::uint64_t age() const { return 0; }

private:
    friend Base;

    void start() {
        given_up_ = false;
        wrote_ = false;
    }
    void release_locks() {
        bool tell = false;
        auto& held = this->scratch().held;
        for (; !held.empty(); held.pop_back()) {
            Lock lock(this->lock_word(held.back()));
            // Even samples that were stored and rolled back may have been read meanwhile.
            tell |= lock.unlock(wrote_);
        }
        this->scratch().noted.clear();
        if (tell)
            this->shared_.event.notify_all();
    }
    [[nodiscard]] bool locked(FrameId id) {
        const auto& held = this->scratch().held;
        return std::binary_search(held.begin(), held.end(), id);
    }

    bool given_up_ = false;
    bool wrote_ = false;
};

}  // namespace tfdb::txn
