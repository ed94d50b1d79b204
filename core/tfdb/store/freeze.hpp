// One committed state into a file: a frozen store.
#pragma once

#include <string>
#include <string_view>

#include "tfdb/store/store.hpp"

namespace tfdb::store {

/// Writes what state `held`, of which a snapshot is held, shows. Throws SnapshotTooOld,
/// CapacityExceeded, NoSuchStore, StoreExists, ReadOnly; nothing is then left of the file.
void freeze(const Store& store, CommitNumber held, const std::string& path, std::string_view origin,
            bool in_place);

/// The text that a frozen store was given.
[[nodiscard]] std::string origin(const Store& store);

}  // namespace tfdb::store
