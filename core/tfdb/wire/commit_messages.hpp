// Commits and states as messages of a recording: TFMessages for every reader of /tf, and the bytes
// of what TFMessages cannot say.
#pragma once

#include <cstddef>
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "tfdb/wire/commit_sample.hpp"

namespace tfdb::wire {

/// The messages of one commit, or of a state.
struct CommitMessages {
    CommitNumber commit = 0;
    std::vector<std::byte> moving;  // a TFMessage as CDR; empty: nothing moves
    std::vector<std::byte> fixed;   // the same, of the static edges
    /// A sample of this commit alone. Empty: `commit_of_messages` makes an equal one.
    std::vector<std::byte> whole;
};

/// What is recorded of a frame.
struct ChosenName {
    std::string name;
    bool keeps_edge = true;  // the edge of which it is the child
};
using ChooseName = std::function<ChosenName(std::string_view)>;

/// The messages of each commit of a sample. Commits of which nothing is left have none. `whole`
/// goes on from the commit before, the first from `since`; of a state it is always there.
/// An empty `choose` keeps all names. Throws what `choose` throws, and InvalidArgument for frames
/// that get the same name.
[[nodiscard]] std::vector<CommitMessages> messages_of_commits(std::span<const std::byte> data,
                                                              CommitNumber since,
                                                              const ChooseName& choose);

/// A sample of one commit that stores the transforms of TFMessages, CDR; empty: none.
/// Throws CorruptMessage; InvalidArgument unless `commit` is later than `since`.
[[nodiscard]] std::vector<std::byte> commit_of_messages(const Epoch& epoch, CommitNumber since,
                                                        CommitNumber commit,
                                                        std::span<const std::byte> moving,
                                                        std::span<const std::byte> fixed);

}  // namespace tfdb::wire
