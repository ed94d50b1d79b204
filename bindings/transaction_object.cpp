// The Python object's use of the GIL in a transaction.
#include <string>

#include "transaction.hpp"

namespace tfdb::python {

TransactionObject::TransactionObject(nb::handle buffer_object, const TransactionOptions& options)
    : owner(nb::borrow(buffer_object)),
      transaction(buffer().open_store(), options, Transaction::BeginLater{}),
      alone_(options.alone) {}

TransactionObject::~TransactionObject() {
    // The thread that frees an unreachable transaction aborts it.
    abort();
}

void TransactionObject::begin() {
    // Called before it locks: from now on no thread waits for it with the GIL.
    if (alone_)
        buffer().reasons.add_wait();
    try {
        const LongWork work(buffer().reasons.to_wait());
        transaction.begin();
    } catch (...) {
        if (alone_)
            buffer().reasons.end_wait();
        throw;
    }
    counted_ = true;
    buffer().reasons.add_transaction();
}

void TransactionObject::commit() {
    try {
        const LongWork work(true);
        transaction.commit();
    } catch (const Error& error) {
        forget_ended();
        if (transaction.stage() != Transaction::Stage::kRefused)
            throw;
        throw Error(error.code(),
                    std::string(error.what()) + "; the transaction has ended, nothing was stored",
                    error.detail());
    } catch (...) {
        forget_ended();
        throw;
    }
    forget_ended();
}

void TransactionObject::abort() noexcept {
    transaction.abort();
    forget_ended();
}

void TransactionObject::forget_ended() noexcept {
    if (!counted_ || transaction.is_open())
        return;
    counted_ = false;
    buffer().reasons.end_transaction();
    if (alone_)
        buffer().reasons.end_wait();
}

}  // namespace tfdb::python
