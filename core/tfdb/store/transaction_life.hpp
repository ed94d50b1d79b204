// The life of a transaction: its owner thread, its stage, and its end with that thread.
#pragma once

#include <memory>
#include <optional>
#include <utility>

#include "tfdb/store/transaction.hpp"
#include "tfdb/sync/fork.hpp"
#include "tfdb/sync/word.hpp"

namespace tfdb::store {

class EngineTransaction;

/// A transaction from creation to end and, while it is open, an entry in its thread's list.
/// Threads: any may call `begin`, and the first caller becomes the owner; only the owner may call
/// `call`, others get WrongThread; any may call `stage` and `release`.
/// Guarantee: ends once; an open transaction is rolled back when its thread ends. A second end
/// waits for the first.
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
    /// Ends an open transaction by rolling back, and counts that unless it was committed.
    void end(Stage how) noexcept;
    /// Ends it, and frees it once its thread's list no longer contains it.
    void release() noexcept;

    /// Returns the result of `body(transaction)`. A Conflict ends the transaction, and so does
    /// every exception that is not an Error: memory may have run out during a write, and half a
    /// write must never be committed.
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

    /// An open transaction that is about to end counts as ended.
    [[nodiscard]] Stage stage() const noexcept;
    [[nodiscard]] CommitNumber committed() const noexcept { return committed_; }
    [[nodiscard]] bool has_written() const noexcept { return has_written_; }
    [[nodiscard]] const std::optional<Conflict>& lost_to() const noexcept { return lost_to_; }
    [[nodiscard]] std::uint64_t age() const noexcept { return options_.age; }
    [[nodiscard]] const EngineTransaction& transaction() const { return *transaction_; }

    /// Rolls back this thread's open transactions, as its end would.
    static void end_thread() noexcept;
    /// Whether this thread has an open transaction of the store (one that runs alone, if `alone`).
    [[nodiscard]] static bool any(const Store& store, bool alone) noexcept {
        return head != nullptr && find(store, alone);
    }

private:
    ~TransactionLife();  // called by the last holder

    static void sweep() noexcept;
    void drop() noexcept;
    [[noreturn]] void throw_ended() const;
    [[nodiscard]] static std::uint64_t this_thread() noexcept;
    [[nodiscard]] static bool find(const Store& store, bool alone) noexcept;

    // A flag besides the stage: it is being rolled back.
    static constexpr std::uint64_t kEnding = 1 << 8;

    static inline constinit thread_local TransactionLife* head = nullptr;

    const Store* which_;
    std::shared_ptr<Store> store_;
    TransactionOptions options_;
    std::unique_ptr<EngineTransaction> transaction_;
    std::optional<Conflict> lost_to_;
    CommitNumber committed_ = 0;
    bool has_written_ = false;
    std::uint64_t forks_ = sync::forks();  // a forked child has no owner of it
    TransactionLife* next_ = nullptr;      // in its thread's list
    sync::Word thread_{};                  // its owner; 0: not begun
    sync::Word state_{};                   // a Stage
    sync::Word holders_{};                 // its creator and the list
};

[[noreturn]] void throw_transaction_active(const char* what);

}  // namespace tfdb::store
