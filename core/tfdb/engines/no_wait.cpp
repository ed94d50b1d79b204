#include "tfdb/engines/no_wait.hpp"

#include "tfdb/engines/engine_of.hpp"

template class tfdb::store::EngineOf<tfdb::txn::NoWaitSession<tfdb::StoreMemory>>;
