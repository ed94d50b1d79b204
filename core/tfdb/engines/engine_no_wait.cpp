#include "tfdb/engines/engine_of.hpp"
#include "tfdb/engines/engines.hpp"
#include "tfdb/engines/no_wait.hpp"

namespace tfdb::store {

std::unique_ptr<Engine> make_no_wait(Reads::Impl& impl) {
    return std::make_unique<EngineOf<txn::NoWaitSession<StoreMemory>>>(impl);
}

}  // namespace tfdb::store
