#include "tfdb/engines/engine_control.hpp"
#include "tfdb/engines/engines.hpp"
#include "tfdb/engines/silo.hpp"

namespace tfdb::store {

std::unique_ptr<Control> make_silo(Reads::Impl& impl) {
    return std::make_unique<EngineControl<txn::SiloSession<StoreMemory>>>(impl);
}

}  // namespace tfdb::store
