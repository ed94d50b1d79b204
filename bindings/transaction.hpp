// What is behind the Python class Transaction.
#pragma once

#include <nanobind/nanobind.h>

#include "reads.hpp"
#include "tfdb/store/transaction.hpp"

namespace nb = nanobind;

namespace tfdb::python {

/// One attempt at a transaction, begun by `with`. What may be done to it when is its own matter.
/// Threads: as Transaction; it may be freed by any.
/// Guarantee: as Transaction's. The buffer knows of it from its begin to its end.
class TransactionObject {
public:
    TransactionObject(nb::handle buffer, const TransactionOptions& options);
    ~TransactionObject();
    TransactionObject(const TransactionObject&) = delete;
    TransactionObject& operator=(const TransactionObject&) = delete;

    void begin();
    void commit();
    void abort() noexcept;

    /// What `work(transaction)` returns, and throws what it throws.
    template <class Work>
    auto run(Work&& work) {
        transaction.check();
        try {
            const LongWork long_work(!alone_ && buffer().reasons.to_wait());
            return work(transaction);
        } catch (...) {
            forget_ended();
            throw;
        }
    }

    [[nodiscard]] BufferObject& buffer() const { return *nb::inst_ptr<BufferObject>(owner); }

    nb::object owner;  // the Buffer
    Transaction transaction;

private:
    void forget_ended() noexcept;

    bool alone_;            // it waits for no lock
    bool counted_ = false;  // among the buffer's reasons
};

}  // namespace tfdb::python
