// The errors of transactions, with frame names.
#pragma once

#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "tfdb/store/store.hpp"
#include "tfdb/txn/commit_transaction.hpp"

namespace tfdb::store {

/// Name of a frame by its id, including own frames of a transaction.
using NameOf = std::function<std::string(FrameId)>;

[[noreturn]] void throw_conflict(const txn::ReadConflict& conflict, CommitNumber since,
                                 const NameOf& name);
/// The engine aborted the transaction, or its state was overwritten.
[[noreturn]] void throw_lost(std::string_view reason, CommitNumber since);
[[noreturn]] void throw_cycle_of(const txn::CommitOutcome& outcome, std::string_view authority,
                                 const NameOf& name);

/// For a read that names one frame; `hint` ends the message.
[[noreturn]] void throw_unknown_frame(std::string_view name, CommitNumber commit,
                                      const std::string& hint);

/// The frame that a lookup did not find.
[[nodiscard]] const FrameRef& unknown_of(const Failure& failure, const Question& question);

/// Name of a frame of a failure.
using NameOfHandle = std::function<std::string(FrameHandle)>;
/// The typed error of a failed lookup that was not overtaken; `hint` ends the message about an
/// unknown frame.
[[noreturn]] void raise_failure(const Failure& failure, const Question& question,
                                const NameOfHandle& name, const std::string& hint);

}  // namespace tfdb::store
