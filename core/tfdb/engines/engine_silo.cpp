#include "tfdb/engines/engine_of.hpp"
#include "tfdb/engines/engines.hpp"
#include "tfdb/engines/silo.hpp"

namespace tfdb::store {

std::unique_ptr<Engine> make_silo(Reads::Impl& impl) {
    return std::make_unique<EngineOf<txn::SiloSession<StoreMemory>>>(impl);
}

}  // namespace tfdb::store
