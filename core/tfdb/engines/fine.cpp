#include "tfdb/engines/fine.hpp"

#include "tfdb/engines/engine_of.hpp"

template class tfdb::store::EngineOf<tfdb::txn::FineSession<tfdb::StoreMemory>>;
