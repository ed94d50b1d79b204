// What is behind the Python class Transaction.
#pragma once

#include <nanobind/nanobind.h>

#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>

#include "reads.hpp"
#include "tfdb/store/transaction.hpp"

namespace nb = nanobind;

namespace tfdb::python {

/// How far a transaction has come.
enum class Stage : std::uint8_t { kNotBegun, kOpen, kCommitted, kAborted, kLost, kRefused };

/// A thread, as long as anybody asks for it: unlike its id, no other thread ever gets it.
/// Threads: any. Guarantee: wait-free.
class ThreadLife {
public:
    /// That of this thread.
    static const std::shared_ptr<ThreadLife>& mine();
    [[nodiscard]] bool ended() const { return ended_; }

private:
    friend struct ThreadLifeEnd;
    std::atomic<bool> ended_{false};
};

/// One attempt at a transaction, begun by `with`.
/// Threads: only the one that began it, others get WrongThread; it may be freed by any.
/// Guarantee: what was not committed is aborted, at the end of its thread at the latest; after its
/// end nothing is read or written.
class TransactionObject {
public:
    TransactionObject(nb::handle buffer, const TransactionOptions& options);
    ~TransactionObject();
    TransactionObject(const TransactionObject&) = delete;
    TransactionObject& operator=(const TransactionObject&) = delete;

    void begin();
    CommitNumber commit();
    void abort();
    /// Throws the Conflict that it was lost with, if the program went on after that.
    void rethrow_if_lost() const;
    /// Throws WrongThread.
    void check_thread() const;

    /// What `work(transaction)` returns. Throws TransactionClosed, WrongThread, and what the work
    /// throws; a Conflict ends the transaction.
    template <class Work>
    auto run(Work&& work) {
        const std::shared_ptr<Transaction> transaction = opened();
        try {
            const LongWork long_work(may_wait());
            return work(*transaction);
        } catch (const Conflict& conflict) {
            lose(conflict);
            throw;
        }
    }

    [[nodiscard]] std::shared_ptr<Transaction> opened() const;
    /// Whether reads must not keep the GIL. One that runs alone waits for nobody.
    [[nodiscard]] bool may_wait() const { return !options_.alone && buffer().reasons.to_wait(); }
    [[nodiscard]] BufferObject& buffer() const { return *nb::inst_ptr<BufferObject>(owner); }
    [[nodiscard]] Stage stage() const { return stage_.load(); }
    [[nodiscard]] bool is_open() const {
        const ThreadLife* const owner_thread = thread_;
        return stage() == Stage::kOpen && owner_thread != nullptr && !owner_thread->ended();
    }
    [[nodiscard]] std::uint64_t age() const { return options_.age; }
    [[nodiscard]] std::optional<CommitNumber> committed() const {
        return stage() == Stage::kCommitted ? std::optional(committed_) : std::nullopt;
    }

    nb::object owner;  // the Buffer

private:
    void claim();
    void finish(Stage stage);
    void lose(const Conflict& conflict);

    TransactionOptions options_;
    std::shared_ptr<Transaction> open_;
    std::optional<Conflict> conflict_;
    CommitNumber committed_ = 0;
    std::atomic<const ThreadLife*> thread_{nullptr};  // null: nobody has begun it
    std::shared_ptr<const ThreadLife> life_;          // keeps it
    std::atomic<Stage> stage_{Stage::kNotBegun};
    bool counted_ = false;  // among the buffer's reasons
};

}  // namespace tfdb::python
