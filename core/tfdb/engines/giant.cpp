#include "tfdb/engines/giant.hpp"

#include "tfdb/engines/engine_of.hpp"

template class tfdb::store::EngineOf<tfdb::txn::GiantSession<tfdb::StoreMemory>>;
