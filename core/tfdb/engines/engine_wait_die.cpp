#include "tfdb/engines/engine_of.hpp"
#include "tfdb/engines/engines.hpp"
#include "tfdb/engines/wait_die.hpp"

namespace tfdb::store {

std::unique_ptr<Engine> make_wait_die(Reads::Impl& impl) {
    return std::make_unique<EngineOf<txn::WaitDieSession<StoreMemory>>>(impl);
}

}  // namespace tfdb::store
