// Creates a store's engine. All engines are compiled here, so that their common code is compiled
// once.
#include "tfdb/engines/engine_of.hpp"
#include "tfdb/engines/fine.hpp"
#include "tfdb/engines/giant.hpp"
#include "tfdb/engines/silo.hpp"
#include "tfdb/engines/two_phase.hpp"

namespace tfdb::store {

std::unique_ptr<Engine> make_engine(store::Store& store) {
    using TwoPhase = EngineOf<txn::TwoPhaseSession<StoreMemory>>;
    switch (store.concurrency) {
        case Concurrency::kSnapshot:
            break;
        case Concurrency::kGiant:
            return std::make_unique<EngineOf<txn::GiantSession<StoreMemory>>>(store);
        case Concurrency::kFine:
            return std::make_unique<EngineOf<txn::FineSession<StoreMemory>>>(store);
        case Concurrency::kNoWait:
            return std::make_unique<TwoPhase>(store, txn::LockRule::kNoWait);
        case Concurrency::kWaitDie:
            return std::make_unique<TwoPhase>(store, txn::LockRule::kWaitDie);
        case Concurrency::kWoundWait:
            return std::make_unique<TwoPhase>(store, txn::LockRule::kWoundWait);
        case Concurrency::kSilo:
            return std::make_unique<EngineOf<txn::SiloSession<StoreMemory>>>(store);
    }
    return nullptr;
}

}  // namespace tfdb::store
