#include "tfdb/engines/wound_wait.hpp"

#include "tfdb/engines/engine_of.hpp"

template class tfdb::store::EngineOf<tfdb::txn::WoundWaitSession<tfdb::StoreMemory>>;
