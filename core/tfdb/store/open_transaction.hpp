// Which transactions a thread has open: so that it does not wait for itself, and nobody for the
// dead.
#pragma once

#include "tfdb/store/buffer.hpp"
#include "tfdb/sync/fork.hpp"
#include "tfdb/sync/word.hpp"

namespace tfdb::store {

class Attempt;

/// An entry of its thread's list of open transactions. What is still open when the thread ends is
/// rolled back.
/// Threads: entered and looked up by one thread; `close` any, once.
/// Guarantee: whoever closes it and its thread's end roll back once; each waits for that, if the
/// other has begun it.
class OpenTransaction {
public:
    /// Enters it; it is freed after `close`.
    static OpenTransaction* enter(Reads::Impl& store, bool alone, Attempt& attempt);
    /// Rolls back, unless the thread's end did; counts that as `aborts` does where `aborted`.
    void close(bool aborted) noexcept;
    /// Rolls back what this thread has open, as its end would.
    static void end_thread() noexcept;

    /// Whether this thread has an open one of the store (that runs alone, if `alone`).
    [[nodiscard]] static bool any(const Reads::Impl& store, bool alone) noexcept {
        return head != nullptr && find(store, alone);
    }
    /// A number of this thread that no other thread ever has.
    [[nodiscard]] static std::uint64_t this_thread() noexcept;

private:
    OpenTransaction(Reads::Impl& store, bool alone, Attempt& attempt, OpenTransaction* next)
        : store_(&store), alone_(alone), attempt_(&attempt), next_(next) {
        state_.store_relaxed(kOpen);
    }
    /// True for the one who is to roll back.
    [[nodiscard]] bool claim() noexcept {
        std::uint64_t found = kOpen;
        return state_.compare_exchange(found, kEnding);
    }
    void roll_back(bool aborted, std::uint64_t then) noexcept;
    /// The state after the one who has claimed it is done.
    std::uint64_t await_end() const noexcept;
    [[nodiscard]] static bool find(const Reads::Impl& store, bool alone) noexcept;
    static void sweep() noexcept;
    friend struct OpenTransactionsEnd;

    static constexpr std::uint64_t kOpen = 0;
    static constexpr std::uint64_t kEnding = 1;  // somebody rolls it back
    static constexpr std::uint64_t kClosed = 2;
    static constexpr std::uint64_t kThreadEnded = 3;

    static inline constinit thread_local OpenTransaction* head = nullptr;

    Reads::Impl* store_;
    bool alone_;
    Attempt* attempt_;
    OpenTransaction* next_;
    std::uint64_t forks_ = sync::forks();  // in a child of its process it is nobody's
    sync::Word state_{};
};

[[noreturn]] void throw_transaction_active(const char* what);

}  // namespace tfdb::store
