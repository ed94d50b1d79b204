// Sources whose commits a store applies: their positions, and the change of their home.
#pragma once

#include <cstdint>

#include "tfdb/store/store.hpp"

namespace tfdb::store {

/// Throws if commits of other stores cannot be applied.
void check_applies(const Store& store);

/// Assigns the frames and samples of this store's writers to the source of that number. Under the
/// commit lock.
void adopt(Store& store, std::uint64_t source);

}  // namespace tfdb::store
