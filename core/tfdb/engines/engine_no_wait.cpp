#include "tfdb/engines/engine_control.hpp"
#include "tfdb/engines/engines.hpp"
#include "tfdb/engines/no_wait.hpp"

namespace tfdb::store {

std::unique_ptr<Control> make_no_wait(Reads::Impl& impl) {
    return std::make_unique<EngineControl<txn::NoWaitSession<StoreMemory>>>(impl);
}

}  // namespace tfdb::store
