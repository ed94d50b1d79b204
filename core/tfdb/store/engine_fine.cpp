#include "tfdb/store/engine_control.hpp"
#include "tfdb/store/engines.hpp"
#include "tfdb/txn/fine.hpp"

namespace tfdb::store {

std::unique_ptr<Control> make_fine(Reads::Impl& impl) {
    return std::make_unique<EngineControl<txn::FineSession<StoreMemory>>>(impl);
}

}  // namespace tfdb::store
