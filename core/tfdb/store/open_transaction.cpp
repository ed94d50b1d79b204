#include "tfdb/store/open_transaction.hpp"

namespace tfdb::store {

/// Frees what is left when its thread ends.
/// Threads: its own. Guarantee: wait-free.
struct OpenTransactionsEnd {
    ~OpenTransactionsEnd() {
        while (OpenTransaction::head != nullptr) {
            OpenTransaction* const next = OpenTransaction::head->next_;
            // If still open, whoever closes it frees it.
            if (OpenTransaction::head->state_.exchange(OpenTransaction::kThreadEnded) ==
                OpenTransaction::kClosed) {
                delete OpenTransaction::head;
            }
            OpenTransaction::head = next;
        }
    }
};

OpenTransaction* OpenTransaction::enter(const Reads::Impl& store, bool alone) {
    static thread_local const OpenTransactionsEnd end;
    (void)end;
    sweep();
    head = new OpenTransaction(store, alone, head);
    return head;
}

bool OpenTransaction::find(const Reads::Impl& store, bool alone) noexcept {
    sweep();
    for (const OpenTransaction* at = head; at != nullptr; at = at->next_) {
        if (at->store_ == &store && (at->alone_ || !alone))
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
