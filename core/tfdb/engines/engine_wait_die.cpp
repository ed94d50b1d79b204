#include "tfdb/engines/engine_control.hpp"
#include "tfdb/engines/engines.hpp"
#include "tfdb/engines/wait_die.hpp"

namespace tfdb::store {

std::unique_ptr<Control> make_wait_die(Reads::Impl& impl) {
    return std::make_unique<EngineControl<txn::WaitDieSession<StoreMemory>>>(impl);
}

}  // namespace tfdb::store
