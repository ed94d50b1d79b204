// Creates a transaction in the store's engine.
#include "tfdb/store/engine_transaction.hpp"

#include "tfdb/store/transaction_in.hpp"
#include "tfdb/txn/snapshot_session.hpp"

namespace tfdb::store {

std::unique_ptr<EngineTransaction> make_transaction(Store& store,
                                                    const TransactionOptions& options) {
    if (store.engine != nullptr)
        return store.engine->transaction(options);
    using Session = txn::SnapshotSession<StoreMemory, WriterLock>;
    return std::make_unique<TransactionIn<Session>>(store, options.alone, store.frames, store.lock,
                                                    store.history, options.priority > 0);
}

}  // namespace tfdb::store
