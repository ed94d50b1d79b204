// The life of a transaction: the thread and stage of its use, and its end with its thread.
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
/// Guarantee: ends once; what is open when its thread ends is rolled back. A second end waits
/// for the first.
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

    /// What `body(transaction)` returns. A Conflict ends it, and so does every exception that
    /// is not an Error: memory may have run out in a write, and half of one must never be
    /// committed.
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

    /// An open one that is about to end counts as ended.
    [[nodiscard]] Stage stage() const noexcept;
    [[nodiscard]] CommitNumber committed() const noexcept { return committed_; }
    [[nodiscard]] bool has_written() const noexcept { return has_written_; }
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

    // Above the stages: it is being rolled back.
    static constexpr std::uint64_t kEnding = 1 << 8;

    static inline constinit thread_local TransactionLife* head = nullptr;

    const Store* which_;
    std::shared_ptr<Store> store_;
    TransactionOptions options_;
    std::unique_ptr<EngineTransaction> transaction_;
    std::optional<Conflict> lost_to_;
    CommitNumber committed_ = 0;
    bool has_written_ = false;
    std::uint64_t forks_ = sync::forks();  // in a forked child it has no owner
    TransactionLife* next_ = nullptr;      // in its thread's list
    sync::Word thread_{};                  // its owner; 0: not begun
    sync::Word state_{};                   // a Stage
    sync::Word holders_{};                 // its maker, and the list
};

[[noreturn]] void throw_transaction_active(const char* what);

}  // namespace tfdb::store
