#include "tfdb/engines/engine_of.hpp"
#include "tfdb/engines/engines.hpp"
#include "tfdb/engines/fine.hpp"

namespace tfdb::store {

std::unique_ptr<Engine> make_fine(Reads::Impl& impl) {
    return std::make_unique<EngineOf<txn::FineSession<StoreMemory>>>(impl);
}

}  // namespace tfdb::store
