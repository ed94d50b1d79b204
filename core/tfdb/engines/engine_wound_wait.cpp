#include "tfdb/engines/engine_control.hpp"
#include "tfdb/engines/engines.hpp"
#include "tfdb/engines/wound_wait.hpp"

namespace tfdb::store {

std::unique_ptr<Control> make_wound_wait(Reads::Impl& impl) {
    return std::make_unique<EngineControl<txn::WoundWaitSession<StoreMemory>>>(impl);
}

}  // namespace tfdb::store
