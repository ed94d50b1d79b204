// The object behind the Python class Transaction.
#pragma once

#include <nanobind/nanobind.h>

#include "reads.hpp"
#include "tfdb/store/transaction.hpp"

namespace nb = nanobind;

namespace tfdb::python {

/// One attempt at a transaction, begun by `with`. The Transaction itself checks its stage.
/// Threads: as Transaction; any thread may free it.
/// Guarantee: as Transaction's. From its begin to its end it is counted in the buffer.
class TransactionObject {
public:
    TransactionObject(nb::handle buffer, const TransactionOptions& options);
    ~TransactionObject();
    TransactionObject(const TransactionObject&) = delete;
    TransactionObject& operator=(const TransactionObject&) = delete;

    void begin();
    void commit();
    void abort() noexcept;

    /// Returns the result of `work(transaction)`; passes its exceptions on.
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

    bool alone_;            // it never waits for a lock
    bool counted_ = false;  // counted in the buffer's Reasons
};

}  // namespace tfdb::python
