#include "tfdb/engines/engine_of.hpp"
#include "tfdb/engines/engines.hpp"
#include "tfdb/engines/wound_wait.hpp"

namespace tfdb::store {

std::unique_ptr<Engine> make_wound_wait(Reads::Impl& impl) {
    return std::make_unique<EngineOf<txn::WoundWaitSession<StoreMemory>>>(impl);
}

}  // namespace tfdb::store
