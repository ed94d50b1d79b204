#include "tfdb/engines/wait_die.hpp"

#include "tfdb/engines/engine_of.hpp"

template class tfdb::store::EngineOf<tfdb::txn::WaitDieSession<tfdb::StoreMemory>>;
