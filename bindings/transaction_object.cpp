// The life of a transaction that Python holds.
#include <string>

#include "errors.hpp"
#include "transaction.hpp"

namespace tfdb::python {
namespace {

[[noreturn]] void throw_ended(const std::string& message, const char* reason) {
    ErrorDetail detail;
    detail.reason = reason;
    throw TransactionClosed(message, detail);
}

[[noreturn]] void throw_not_open(Stage stage, CommitNumber committed) {
    const std::string again = "; begin a new one with Buffer.transaction()";
    switch (stage) {
        case Stage::kCommitted:
            throw_ended(
                "the transaction has ended: it was committed, the store was then at commit " +
                    std::to_string(committed) + again,
                "committed");
        case Stage::kAborted:
            throw_ended("the transaction has ended: it was aborted and left nothing behind" + again,
                        "aborted");
        case Stage::kLost:
            throw_ended(
                "the transaction has ended: it lost against another commit and left "
                "nothing behind" +
                    again + ", or let Buffer.run() do it",
                "lost");
        case Stage::kRefused:
            throw_ended(
                "the transaction has ended: its commit was refused and left nothing "
                "behind" +
                    again,
                "refused");
        default:
            throw_ended("the transaction has not begun: use it in a `with` statement", "not begun");
    }
}

}  // namespace

/// Threads: its own. Guarantee: wait-free.
struct ThreadLifeEnd {
    std::shared_ptr<ThreadLife> life = std::make_shared<ThreadLife>();
    ThreadLifeEnd() = default;
    ThreadLifeEnd(const ThreadLifeEnd&) = delete;
    ThreadLifeEnd& operator=(const ThreadLifeEnd&) = delete;
    ~ThreadLifeEnd() { life->ended_ = true; }
};

const std::shared_ptr<ThreadLife>& ThreadLife::mine() {
    static thread_local const ThreadLifeEnd here;
    return here.life;
}

TransactionObject::TransactionObject(nb::handle buffer, const TransactionOptions& options)
    : owner(nb::borrow(buffer)), options_(options) {}

TransactionObject::~TransactionObject() {
    // One that nobody can reach any more is aborted by whichever thread frees it.
    finish(Stage::kAborted);
}

/// Makes it this thread's. Two may try at once: beginning may wait without the GIL.
void TransactionObject::claim() {
    const ThreadLife* nobody = nullptr;
    if (thread_.compare_exchange_strong(nobody, ThreadLife::mine().get())) {
        life_ = ThreadLife::mine();
        return;
    }
    check_thread();
    if (stage_ == Stage::kOpen) {
        throw TransactionActive("the transaction is already open: enter its `with` statement once");
    }
    throw_not_open(stage_, committed_);
}

void TransactionObject::begin() {
    claim();
    if (options_.alone) {
        // Before it holds the lock: from now on nobody waits for it with the GIL.
        buffer().reasons.add_wait();
        counted_ = true;
    }
    Buffer& store = buffer().store;
    const TransactionOptions options = options_;
    try {
        std::shared_ptr<Transaction> made;
        {
            const Released released(buffer().reasons.to_wait());
            made = std::make_shared<Transaction>(store, options);
        }
        open_ = std::move(made);
        buffer().reasons.add_transaction();
    } catch (...) {
        finish(Stage::kNotBegun);
        thread_ = nullptr;
        throw;
    }
    options_.age = open_->age();
    stage_ = Stage::kOpen;
}

CommitNumber TransactionObject::commit() {
    const std::shared_ptr<Transaction> transaction = opened();
    try {
        const nb::gil_scoped_release released;
        committed_ = transaction->commit();
    } catch (const Conflict& conflict) {
        lose(conflict);
        throw;
    } catch (const Error& error) {
        finish(Stage::kRefused);
        throw Error(error.code(),
                    std::string(error.what()) + "; the transaction has ended, nothing was stored",
                    error.detail());
    } catch (...) {
        finish(Stage::kRefused);
        throw;
    }
    finish(Stage::kCommitted);
    return committed_;
}

void TransactionObject::abort() {
    check_thread();
    if (stage_ == Stage::kOpen) {
        finish(Stage::kAborted);
    } else if (stage_ != Stage::kAborted && stage_ != Stage::kLost) {
        throw_not_open(stage_, committed_);
    }
}

void TransactionObject::rethrow_if_lost() const {
    if (stage_ == Stage::kLost && conflict_) {
        throw Conflict(*conflict_);
    }
}

void TransactionObject::check_thread() const {
    const ThreadLife* const owner_thread = thread_;
    if (owner_thread != nullptr && owner_thread != ThreadLife::mine().get()) {
        throw WrongThread(
            "a transaction belongs to the thread that began it: begin one in this thread with "
            "Buffer.transaction(), or hand the work over to the other one");
    }
}

std::shared_ptr<Transaction> TransactionObject::opened() const {
    check_thread();
    if (stage_ != Stage::kOpen) {
        throw_not_open(stage_, committed_);
    }
    return open_;
}

void TransactionObject::lose(const Conflict& conflict) {
    conflict_.emplace(conflict);
    finish(Stage::kLost);
}

void TransactionObject::finish(Stage stage) {
    if (open_ != nullptr) {
        open_->abort();
        open_.reset();
        buffer().reasons.end_transaction();
    }
    if (counted_) {
        buffer().reasons.end_wait();
        counted_ = false;
    }
    stage_ = stage;
}

}  // namespace tfdb::python
