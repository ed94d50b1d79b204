// Which engine a transaction runs in.
#include "tfdb/store/attempt.hpp"

#include "tfdb/store/attempt_of.hpp"
#include "tfdb/txn/snapshot_session.hpp"

namespace tfdb::store {

std::unique_ptr<Attempt> make_attempt(Reads::Impl& impl, const TransactionOptions& options) {
    if (impl.control != nullptr)
        return impl.control->attempt(options);
    using Session = txn::SnapshotSession<StoreMemory, sync::CommitLock>;
    return std::make_unique<AttemptOf<Session>>(impl, options.alone, impl.frames, impl.lock,
                                                impl.history, options.priority > 0);
}

}  // namespace tfdb::store
