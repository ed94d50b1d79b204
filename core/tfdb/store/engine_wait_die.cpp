#include "tfdb/store/engine_control.hpp"
#include "tfdb/store/engines.hpp"
#include "tfdb/txn/wait_die.hpp"

namespace tfdb::store {

std::unique_ptr<Control> make_wait_die(Reads::Impl& impl) {
    return std::make_unique<EngineControl<txn::WaitDieSession<StoreMemory>>>(impl);
}

}  // namespace tfdb::store
