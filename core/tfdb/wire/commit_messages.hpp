// Commits and states as messages of a recording: TFMessages for every reader of /tf, and bytes for
// the data that TFMessages cannot express.
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
    std::vector<std::byte> moving;  // a TFMessage as CDR; empty: no moving transforms
    std::vector<std::byte> fixed;   // the same for the static edges
    /// A sample of this commit alone. Empty: `commit_of_messages` creates an equal one.
    std::vector<std::byte> whole;
};

/// The recorded data of a frame.
struct ChosenName {
    std::string name;
    bool keeps_edge = true;  // the edge whose child it is
};
using ChooseName = std::function<ChosenName(std::string_view)>;

/// The messages of each commit of a sample. Commits without kept data have none. `whole` continues
/// from the previous commit, the first one from `since`; a state always has it. An empty `choose`
/// keeps all names. Throws the exceptions of `choose`, and InvalidArgument for frames that get the
/// same name.
[[nodiscard]] std::vector<CommitMessages> messages_of_commits(std::span<const std::byte> data,
                                                              CommitNumber since,
                                                              const ChooseName& choose);

/// A sample of one commit that stores the transforms of the CDR TFMessages; an empty span: no
/// message. Throws CorruptMessage; InvalidArgument unless `commit` is later than `since`.
[[nodiscard]] std::vector<std::byte> commit_of_messages(const Epoch& epoch, CommitNumber since,
                                                        CommitNumber commit,
                                                        std::span<const std::byte> moving,
                                                        std::span<const std::byte> fixed);

}  // namespace tfdb::wire
