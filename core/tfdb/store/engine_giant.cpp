#include "tfdb/store/engine_control.hpp"
#include "tfdb/store/engines.hpp"
#include "tfdb/txn/giant.hpp"

namespace tfdb::store {

std::unique_ptr<Control> make_giant(Reads::Impl& impl) {
    return std::make_unique<EngineControl<txn::GiantSession<StoreMemory>>>(impl);
}

}  // namespace tfdb::store
