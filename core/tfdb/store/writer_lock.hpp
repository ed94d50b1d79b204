// The writers' lock: among the threads of a process, and among processes that share a store.
#pragma once

#include <cstdint>
#include <string>

#include "tfdb/memory/control.hpp"
#include "tfdb/memory/shared_file.hpp"
#include "tfdb/sync/commit_lock.hpp"
#include "tfdb/sync/event_count.hpp"

namespace tfdb::store {

/// The threads of a process first take a lock of their own; its holder then takes the lock of the
/// store's processes. After a death, the next holder repairs the store first.
/// Threads: any may lock; only the holder may unlock.
/// Guarantee: blocks. Urgent requests go first within a process.
class WriterLock {
public:
    /// Repairs a store after a death. Threads: the holder of the lock. Guarantee: that of the
    /// implementation.
    class Repairs {
    public:
        Repairs() = default;
        Repairs(const Repairs&) = delete;
        Repairs& operator=(const Repairs&) = delete;
        virtual void repair() noexcept = 0;

    protected:
        ~Repairs() = default;
    };

    /// `word`: of the process's lock. `commit_event`: for waits for commits. `shared`: null for a
    /// private store.
    WriterLock(sync::Word& word, sync::Word& commit_event, const memory::SharedFile* shared,
               Repairs& repairs)
        : own_(word), commit_event_(commit_event), shared_(shared), repairs_(repairs) {}

    /// The only place where a thread waits for other writers. It calls `interruption_point` a few
    /// times a second, without the lock; an exception from it ends the wait. For a shared store,
    /// both throw ReadOnly, LockTimeout (another process holds the lock too long), CorruptStore
    /// (the lock was damaged).
    void lock() { lock_any(false); }
    void lock_urgently() { lock_any(true); }
    /// Throws ReadOnly, CorruptStore.
    bool try_lock() {
        if (!own_.try_lock())
            return false;
        return shared_ == nullptr || try_lock_shared(0);
    }
    void unlock() noexcept {
        if (shared_ != nullptr) [[unlikely]]
            shared_->control->unlock();
        own_.unlock();
        commit_event_.notify();
    }
    /// Whether a thread of this process holds the lock or urgently requests it.
    [[nodiscard]] bool in_use() const noexcept { return own_.in_use(); }

private:
    // Longest single wait. After it, `interruption_point` is called and, if another process holds
    // the lock, other threads of this process get their turn.
    static constexpr std::int64_t kTurnNs = 50'000'000;

    void lock_any(bool urgently) {
        if (!try_lock()) [[unlikely]]
            await(urgently);
    }
    void await(bool urgently);
    [[nodiscard]] bool try_lock_shared(std::int64_t longest_ns);
    [[noreturn]] void throw_timeout() const;
    void check_writable() const;
    /// Handles a result other than kNo.
    void handle_result(memory::Control::Taken taken);

    sync::CommitLock own_;
    sync::EventCount commit_event_;
    const memory::SharedFile* shared_;
    Repairs& repairs_;
};

}  // namespace tfdb::store
