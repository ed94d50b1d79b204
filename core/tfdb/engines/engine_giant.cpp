#include "tfdb/engines/engine_control.hpp"
#include "tfdb/engines/engines.hpp"
#include "tfdb/engines/giant.hpp"

namespace tfdb::store {

std::unique_ptr<Control> make_giant(Reads::Impl& impl) {
    return std::make_unique<EngineControl<txn::GiantSession<StoreMemory>>>(impl);
}

}  // namespace tfdb::store
