#include "tfdb/engines/two_phase.hpp"

#include "tfdb/engines/engine_of.hpp"

template class tfdb::store::EngineOf<tfdb::txn::TwoPhaseSession<tfdb::StoreMemory>>;
