// In which engine a transaction runs.
#include "tfdb/store/engine_transaction.hpp"

#include "tfdb/store/transaction_in.hpp"
#include "tfdb/txn/snapshot_session.hpp"

namespace tfdb::store {

std::unique_ptr<EngineTransaction> make_transaction(Reads::Impl& impl,
                                                    const TransactionOptions& options) {
    if (impl.engine != nullptr)
        return impl.engine->transaction(options);
    using Session = txn::SnapshotSession<StoreMemory, sync::CommitLock>;
    return std::make_unique<TransactionIn<Session>>(impl, options.alone, impl.frames, impl.lock,
                                                    impl.history, options.priority > 0);
}

}  // namespace tfdb::store
