#include "tfdb/store/transaction_life.hpp"

#include <string>

#include "tfdb/store/engine_transaction.hpp"
#include "tfdb/store/store.hpp"

namespace tfdb::store {

namespace {

/// Rolls back open transactions when its thread ends.
/// Threads: its own. Guarantee: waits only for a thread that is ending a transaction.
struct ThreadEnd {
    ~ThreadEnd() { TransactionLife::end_thread(); }
};

constexpr std::uint64_t word_of(Transaction::Stage stage) {
    return static_cast<std::uint64_t>(stage);
}

/// A flag besides the stage of an open one: it waits to be committed. Only an exception from an
/// interruption of the wait, in its own thread, may end it.
constexpr std::uint64_t kCommitting = 1 << 9;
constexpr std::uint64_t kBeingCommitted = word_of(Transaction::Stage::kOpen) | kCommitting;

bool is_open(std::uint64_t state) {
    return (state & ~kCommitting) == word_of(Transaction::Stage::kOpen);
}

}  // namespace

TransactionLife::TransactionLife(std::shared_ptr<Store> store, const TransactionOptions& options)
    : which_(store.get()), store_(std::move(store)), options_(options) {
    if (options.priority > TransactionOptions::kMaxPriority) {
        throw InvalidArgument("priority must be from 0 to 7, got " +
                              std::to_string(options.priority));
    }
    if (options.age >> TransactionOptions::kAgeBits != 0) {
        throw InvalidArgument("age must come from `age()` of an earlier attempt, got " +
                              std::to_string(options.age));
    }
    state_.store_relaxed(word_of(Stage::kNotBegun));
    holders_.store_relaxed(1);
}

TransactionLife::~TransactionLife() = default;

void TransactionLife::begin() {
    std::uint64_t none = 0;
    if (!thread_.compare_exchange(none, this_thread())) {
        check_thread();
        if (stage() == Stage::kOpen)
            throw TransactionActive("the transaction is open already; a transaction begins once");
        throw_ended();
    }
    try {
        check_not_in_transaction(*store_);
        TransactionOptions options = options_;
        if (options.age == 0)
            options.age = store_->ages.fetch_add(1) + 1;
        transaction_ = make_transaction(*store_, options);
        // The interruption of the wait may have begun another one.
        if (find(*store_, false)) {
            transaction_->rollback();
            transaction_.reset();
            check_not_in_transaction(*store_);
        }
        options_.age = options.age;
    } catch (...) {
        thread_.store_release(0);
        throw;
    }
    static thread_local const ThreadEnd end;
    (void)end;
    sweep();
    holders_.store_relaxed(2);
    next_ = std::exchange(head, this);
    state_.store_release(word_of(Stage::kOpen));
}

Transaction::Stage TransactionLife::stage() const noexcept {
    return static_cast<Stage>(state_.load_acquire() & (kEnding - 1));
}

void TransactionLife::check_thread() const {
    const std::uint64_t thread = thread_.load_acquire();
    if (thread != 0 && thread != this_thread()) {
        throw WrongThread(
            "a transaction belongs to the thread that began it: begin one in this thread with "
            "Buffer.transaction(), or hand the work over to the other one");
    }
}

void TransactionLife::check() const {
    if (forks_ != sync::forks())
        throw Forked("a transaction belongs to the process that began it");
    check_thread();
    const std::uint64_t state = state_.load_acquire();
    if (state == kBeingCommitted)
        throw TransactionActive("the transaction is being committed: only an exception ends that");
    if (state != word_of(Stage::kOpen))
        throw_ended();
}

void TransactionLife::throw_ended() const {
    ErrorDetail detail;
    std::string how = "the transaction has ended: it ";
    std::string next = "; begin a new one with Buffer.transaction()";
    switch (stage()) {
        case Stage::kNotBegun:
            how = "the transaction has not begun: use it in a `with` statement, or begin() it";
            next.clear();
            detail.reason = "not begun";
            break;
        case Stage::kOpen:
        case Stage::kAborted:
            how += "was aborted, nothing was stored";
            detail.reason = "aborted";
            break;
        case Stage::kCommitted:
            how += "was committed, the store was then at commit " + std::to_string(committed_);
            detail.reason = "committed";
            break;
        case Stage::kLost:
            how += "conflicted with another commit, nothing was stored";
            next += ", or let Buffer.run() do it";
            detail.reason = "lost";
            break;
        case Stage::kRefused:
            how += "was refused at its commit, nothing was stored";
            detail.reason = "refused";
    }
    const std::string message = how + next;
    throw TransactionClosed(message, std::move(detail));
}

CommitNumber TransactionLife::commit() {
    check();
    try {
        committed_ = call([this](EngineTransaction& transaction) {
            state_.store_relaxed(kBeingCommitted);
            try {
                const CommitNumber read = transaction.read_as_of();
                const CommitNumber number = transaction.commit();
                has_written_ = number > read;
                state_.store_relaxed(word_of(Stage::kOpen));
                return number;
            } catch (...) {
                state_.store_relaxed(word_of(Stage::kOpen));
                throw;
            }
        });
    } catch (...) {
        end(Stage::kRefused);  // unless a conflict aborted it
        throw;
    }
    end(Stage::kCommitted);
    return committed_;
}

void TransactionLife::end(Stage how) noexcept {
    std::uint64_t found = word_of(Stage::kOpen);
    if (forks_ != sync::forks()) {
        // Its thread may be missing in this process: its locks in this copy stay.
        if (state_.load_relaxed() != found && state_.load_relaxed() < kEnding)
            return;
        (void)store_->fork_state();
        (void)transaction_.release();
        state_.store_relaxed(word_of(how));
        return;
    }
    if (!state_.compare_exchange(found, word_of(how) | kEnding)) {
        for (; found != kBeingCommitted && found >= kEnding; found = state_.load_acquire())
            sync::spin_pause();
        return;
    }
    if (how == Stage::kLost)
        store_->conflicts.fetch_add(1);
    if (how != Stage::kCommitted)
        store_->aborts.fetch_add(1);
    transaction_->rollback();
    const bool mine = thread_.load_relaxed() == this_thread();
    state_.store_release(word_of(how));
    // In another thread's list it stays until that thread sweeps its list.
    if (mine)
        sweep();
}

void TransactionLife::release() noexcept {
    end(Stage::kAborted);
    transaction_.reset();
    store_.reset();
    drop();
}

void TransactionLife::drop() noexcept {
    if (holders_.fetch_add(~std::uint64_t{0}) == 1)
        delete this;
}

/// Removes ended transactions from this thread's list.
void TransactionLife::sweep() noexcept {
    for (TransactionLife** at = &head; *at != nullptr;) {
        TransactionLife* const entry = *at;
        if (is_open(entry->state_.load_acquire())) {
            at = &entry->next_;
            continue;
        }
        *at = entry->next_;
        entry->drop();
    }
}

void TransactionLife::end_thread() noexcept {
    while (head != nullptr) {
        TransactionLife* const entry = std::exchange(head, head->next_);
        if (entry->forks_ == sync::forks())
            entry->end(Stage::kAborted);
        entry->drop();
    }
}

std::uint64_t TransactionLife::this_thread() noexcept {
    static sync::Word threads{};
    static thread_local const std::uint64_t mine = threads.fetch_add(1) + 1;
    return mine;
}

bool TransactionLife::find(const Store& store, bool alone) noexcept {
    sweep();
    bool any = false;
    for (const TransactionLife* at = head; at != nullptr; at = at->next_) {
        any |= at->which_ == &store && at->forks_ == sync::forks() &&
               is_open(at->state_.load_acquire()) && (at->options_.alone || !alone);
    }
    return any;
}

void throw_transaction_active(const char* what) {
    throw TransactionActive(std::string("this thread has an open transaction on the store: ") +
                            what);
}

}  // namespace tfdb::store
