// The engine of a Buffer with a concurrency other than `snapshot`.
#pragma once

#include <memory>

#include "tfdb/lookup/view.hpp"
#include "tfdb/store/buffer.hpp"

namespace tfdb {
struct TransactionOptions;
}

namespace tfdb::store {

class EngineTransaction;
class Batch;

/// The engine of one store; a null pointer stands for the default engine.
/// Threads: any; `keep_out` and `let_in` only the holder of the commit lock.
/// Guarantee: that of the engine's session (txn/). Its reads and writes starve no other operation
/// and are not starved: see txn::read_through.
class Engine {
public:
    Engine() = default;
    virtual ~Engine() = default;
    Engine(const Engine&) = delete;
    Engine& operator=(const Engine&) = delete;

    /// kOk or kFailed. Both answers and failures carry the number of the commit that they saw.
    [[nodiscard]] virtual lookup::Outcome read(Question& question, Answer& answer,
                                               Failure& failure) = 0;
    /// Throws as commit_batch. False, and nothing was done, if it might have to wait and `wait` is
    /// false.
    [[nodiscard]] virtual bool write(const Batch& batch, bool wait, CommitNumber& commit) = 0;
    /// Begins a transaction; `options` were checked, and `age` is set.
    [[nodiscard]] virtual std::unique_ptr<EngineTransaction> transaction(
        const TransactionOptions& options) = 0;
    /// From `keep_out` to `let_in` no read or write is in progress.
    virtual void keep_out() = 0;
    virtual void let_in() = 0;
    /// Whether an operation runs besides the holder of the commit lock.
    [[nodiscard]] virtual bool in_use() const = 0;
    virtual void add_to(Counters& counters) const = 0;
};

/// Null for the default engine.
[[nodiscard]] std::unique_ptr<Engine> make_engine(Store& store);

}  // namespace tfdb::store
