// Which transactions a thread has open: so that it does not wait for itself.
#pragma once

#include "tfdb/store/buffer.hpp"
#include "tfdb/sync/word.hpp"

namespace tfdb::store {

/// An entry of its thread's list of open transactions.
/// Threads: entered and looked up by one thread; `close` any.
/// Guarantee: wait-free. What another thread closed is freed by its own thread, later.
class OpenTransaction {
public:
    /// Enters it; it is freed after `close`.
    static OpenTransaction* enter(const Reads::Impl& store, bool alone);
    void close() noexcept {
        if (state_.exchange(kClosed) == kThreadEnded)
            delete this;
    }

    /// Whether this thread has an open one of the store (that runs alone, if `alone`).
    [[nodiscard]] static bool any(const Reads::Impl& store, bool alone) noexcept {
        return head != nullptr && find(store, alone);
    }
    /// Something of this thread that no other thread has.
    [[nodiscard]] static const void* this_thread() noexcept { return &head; }

private:
    OpenTransaction(const Reads::Impl& store, bool alone, OpenTransaction* next)
        : store_(&store), alone_(alone), next_(next) {
        state_.store_relaxed(kOpen);
    }
    [[nodiscard]] static bool find(const Reads::Impl& store, bool alone) noexcept;
    static void sweep() noexcept;
    friend struct OpenTransactionsEnd;

    static constexpr std::uint64_t kOpen = 0;
    static constexpr std::uint64_t kClosed = 1;
    static constexpr std::uint64_t kThreadEnded = 2;

    static inline constinit thread_local OpenTransaction* head = nullptr;

    const Reads::Impl* store_;
    bool alone_;
    OpenTransaction* next_;
    sync::Word state_{};
};

[[noreturn]] void throw_transaction_active(const char* what);

/// For what a thread may not do to a store of which it has a transaction open: it would wait for
/// itself, or see its own half-done work. Throws TransactionActive.
inline void check_not_in_transaction(const Reads::Impl& store) {
    if (OpenTransaction::any(store, false))
        throw_transaction_active("use the transaction's methods, or end it first");
}
/// The same, where only a transaction that runs alone is in the way.
inline void check_not_alone_in_transaction(const Reads::Impl& store) {
    if (OpenTransaction::any(store, true))
        throw_transaction_active("it runs alone: end it first");
}

}  // namespace tfdb::store
