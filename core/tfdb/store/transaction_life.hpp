// The life of a transaction: who may use it and when, and that it ends with its thread.
#pragma once

#include <memory>
#include <optional>
#include <utility>

#include "tfdb/store/transaction.hpp"
#include "tfdb/sync/fork.hpp"
#include "tfdb/sync/word.hpp"

namespace tfdb::store {

class EngineTransaction;

/// A transaction from its making to its end, and, while it is open, an entry in its thread's list.
/// Threads: `begin` any, the first one has it from then on; `call` only that one, others get
/// WrongThread; `stage` and `release` any.
/// Guarantee: ends once; what is open when its thread ends is rolled back. Who ends it second waits
/// for who does it first.
class TransactionLife {
public:
    using Stage = Transaction::Stage;

    /// Throws InvalidArgument.
    TransactionLife(std::shared_ptr<Store> store, const TransactionOptions& options);
    TransactionLife(const TransactionLife&) = delete;
    TransactionLife& operator=(const TransactionLife&) = delete;

    /// As Transaction::begin.
    void begin();
    /// Throws Forked, WrongThread, TransactionClosed.
    void check() const;
    /// Throws WrongThread.
    void check_thread() const;
    /// Ends an open one by rolling back; counts that unless it was committed.
    void end(Stage how) noexcept;
    /// Ends it, and frees it once its thread's list does not have it any more.
    void release() noexcept;

    /// What `body(transaction)` returns. A Conflict ends it; so does what is no Error: memory may
    /// have run out amid a write, and half of one must never be committed.
    template <class Body>
    auto call(Body body) {
        check();
        try {
            return body(*transaction_);
        } catch (const Conflict& conflict) {
            end(Stage::kLost);
            lost_to_.emplace(conflict);
            throw;
        } catch (const Error&) {
            throw;
        } catch (...) {
            end(Stage::kAborted);
            throw;
        }
    }
    CommitNumber commit();

    /// An open one that somebody is about to end counts as ended.
    [[nodiscard]] Stage stage() const noexcept;
    [[nodiscard]] CommitNumber committed() const noexcept { return committed_; }
    [[nodiscard]] const std::optional<Conflict>& lost_to() const noexcept { return lost_to_; }
    [[nodiscard]] std::uint64_t age() const noexcept { return options_.age; }
    [[nodiscard]] const EngineTransaction& transaction() const { return *transaction_; }

    /// Rolls back what this thread has open, as its end would.
    static void end_thread() noexcept;
    /// Whether this thread has an open one of the store (that runs alone, if `alone`).
    [[nodiscard]] static bool any(const Store& store, bool alone) noexcept {
        return head != nullptr && find(store, alone);
    }

private:
    ~TransactionLife();  // by the last of those that have it

    static void sweep() noexcept;
    void drop() noexcept;
    [[noreturn]] void throw_ended() const;
    [[nodiscard]] static std::uint64_t this_thread() noexcept;
    [[nodiscard]] static bool find(const Store& store, bool alone) noexcept;

    // Above the stages: somebody rolls it back.
    static constexpr std::uint64_t kEnding = 1 << 8;

    static inline constinit thread_local TransactionLife* head = nullptr;

    const Store* which_;
    std::shared_ptr<Store> store_;
    TransactionOptions options_;
    std::unique_ptr<EngineTransaction> transaction_;
    std::optional<Conflict> lost_to_;
    CommitNumber committed_ = 0;
    std::uint64_t forks_ = sync::forks();  // in a child of its process it is nobody's
    TransactionLife* next_ = nullptr;      // in its thread's list
    sync::Word thread_{};                  // that it belongs to; 0: nobody has begun it
    sync::Word state_{};                   // a Stage
    sync::Word holders_{};                 // who made it, and the list
};

[[noreturn]] void throw_transaction_active(const char* what);

}  // namespace tfdb::store
