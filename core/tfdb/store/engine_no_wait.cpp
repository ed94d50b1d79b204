#include "tfdb/store/engine_control.hpp"
#include "tfdb/store/engines.hpp"
#include "tfdb/txn/no_wait.hpp"

namespace tfdb::store {

std::unique_ptr<Control> make_no_wait(Reads::Impl& impl) {
    return std::make_unique<EngineControl<txn::NoWaitSession<StoreMemory>>>(impl);
}

}  // namespace tfdb::store
