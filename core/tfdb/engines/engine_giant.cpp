#include "tfdb/engines/engine_of.hpp"
#include "tfdb/engines/engines.hpp"
#include "tfdb/engines/giant.hpp"

namespace tfdb::store {

std::unique_ptr<Engine> make_giant(Reads::Impl& impl) {
    return std::make_unique<EngineOf<txn::GiantSession<StoreMemory>>>(impl);
}

}  // namespace tfdb::store
