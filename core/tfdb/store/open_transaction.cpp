#include "tfdb/store/open_transaction.hpp"

#include "tfdb/store/attempt.hpp"
#include "tfdb/store/impl.hpp"

namespace tfdb::store {

/// Rolls back and frees what is left when its thread ends.
/// Threads: its own. Guarantee: waits for nobody but who closes a transaction meanwhile.
struct OpenTransactionsEnd {
    ~OpenTransactionsEnd() { OpenTransaction::end_thread(); }
};

OpenTransaction* OpenTransaction::enter(Reads::Impl& store, bool alone, Attempt& attempt) {
    static thread_local const OpenTransactionsEnd end;
    (void)end;
    sweep();
    head = new OpenTransaction(store, alone, attempt, head);
    return head;
}

void OpenTransaction::close(bool aborted) noexcept {
    if (claim()) {
        roll_back(aborted, kClosed);
    } else if (await_end() == kThreadEnded) {
        delete this;
    }
}

void OpenTransaction::end_thread() noexcept {
    while (head != nullptr) {
        OpenTransaction* const entry = head;
        head = entry->next_;
        if (entry->forks_ != sync::forks())
            continue;
        if (entry->claim()) {
            entry->roll_back(true, kThreadEnded);  // whoever closes it frees it
        } else {
            (void)entry->await_end();
            delete entry;
        }
    }
}

void OpenTransaction::roll_back(bool aborted, std::uint64_t then) noexcept {
    if (aborted)
        store_->aborts.fetch_add(1);
    attempt_->rollback();
    // From the exchange on another thread may free this: waiters look at it again by themselves.
    (void)state_.exchange(then);
}

std::uint64_t OpenTransaction::await_end() const noexcept {
    std::uint64_t state = state_.load_acquire();
    for (; state == kEnding; state = state_.load_acquire())
        sync::spin_pause();
    return state;
}

std::uint64_t OpenTransaction::this_thread() noexcept {
    static sync::Word threads{};
    static thread_local const std::uint64_t mine = threads.fetch_add(1) + 1;
    return mine;
}

bool OpenTransaction::find(const Reads::Impl& store, bool alone) noexcept {
    sweep();
    for (const OpenTransaction* at = head; at != nullptr; at = at->next_) {
        if (at->store_ == &store && at->forks_ == sync::forks() && (at->alone_ || !alone))
            return true;
    }
    return false;
}

void OpenTransaction::sweep() noexcept {
    for (OpenTransaction** at = &head; *at != nullptr;) {
        OpenTransaction* const entry = *at;
        if (entry->state_.load_acquire() != kClosed) {
            at = &entry->next_;
            continue;
        }
        *at = entry->next_;
        delete entry;
    }
}

void throw_transaction_active(const char* what) {
    throw TransactionActive(std::string("this thread has an open transaction on the store: ") +
                            what);
}

}  // namespace tfdb::store
