#include "tfdb/engines/silo.hpp"

#include "tfdb/engines/engine_of.hpp"

template class tfdb::store::EngineOf<tfdb::txn::SiloSession<tfdb::StoreMemory>>;
