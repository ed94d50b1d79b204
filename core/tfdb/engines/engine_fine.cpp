#include "tfdb/engines/engine_control.hpp"
#include "tfdb/engines/engines.hpp"
#include "tfdb/engines/fine.hpp"

namespace tfdb::store {

std::unique_ptr<Control> make_fine(Reads::Impl& impl) {
    return std::make_unique<EngineControl<txn::FineSession<StoreMemory>>>(impl);
}

}  // namespace tfdb::store
