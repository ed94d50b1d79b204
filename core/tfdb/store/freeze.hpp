// Writes one committed state into a file: a frozen store.
#pragma once

#include <string>
#include <string_view>

#include "tfdb/store/store.hpp"

namespace tfdb::store {

/// Writes the state `held`, which a snapshot must hold. Throws SnapshotTooOld, CapacityExceeded,
/// NoSuchStore, StoreExists, ReadOnly, and then leaves no file.
void freeze(const Store& store, CommitNumber held, const std::string& path, std::string_view origin,
            bool in_place);

/// The text passed to `freeze`.
[[nodiscard]] std::string origin(const Store& store);

}  // namespace tfdb::store
