// The errors of transactions, with the names that people know.
#pragma once

#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "tfdb/store/impl.hpp"
#include "tfdb/txn/settle.hpp"

namespace tfdb::store {

/// Name of a frame by its id, own frames of a transaction included.
using NameOf = std::function<std::string(FrameId)>;

[[noreturn]] void throw_conflict(const txn::ReadConflict& conflict, CommitNumber since,
                                 const NameOf& name);
/// The engine gave the transaction up, or what it reads was overwritten.
[[noreturn]] void throw_lost(std::string_view reason, CommitNumber since);
[[noreturn]] void throw_cycle_of(const txn::Settled& settled, std::string_view authority,
                                 const NameOf& name);

[[noreturn]] void throw_frame_unknown(std::string_view name);
[[noreturn]] void throw_frame_in_use(std::string_view name, std::span<const FrameId> children,
                                     const NameOf& name_of);

/// The typed error of a failed lookup.
[[noreturn]] void raise_failure(const Failure& failure, std::string_view target,
                                std::string_view source, CommitNumber committed,
                                const NameOf& name);

}  // namespace tfdb::store
