#include "tfdb/store/engine_control.hpp"
#include "tfdb/store/engines.hpp"
#include "tfdb/txn/wound_wait.hpp"

namespace tfdb::store {

std::unique_ptr<Control> make_wound_wait(Reads::Impl& impl) {
    return std::make_unique<EngineControl<txn::WoundWaitSession<StoreMemory>>>(impl);
}

}  // namespace tfdb::store
