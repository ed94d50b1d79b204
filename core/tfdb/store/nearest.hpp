// Which frames may have been meant by a name that no frame has.
#pragma once

#include <string>
#include <string_view>
#include <unordered_set>
#include <vector>

#include "tfdb/store/store.hpp"

namespace tfdb::store {

/// At most three of the names that are near to one, the nearest first: few letters are missing,
/// wrong, swapped or too many, whatever their case, or a prefix such as `robot1/` is.
[[nodiscard]] std::vector<std::string> nearest(std::string_view name,
                                               std::vector<std::string> known);

/// "; did you mean 'base_link'?" of the frames of a commit, without those that are `removed`, and
/// with the names in `made`. Empty where nothing is near, and where there are so many frames that
/// looking would take long: this is for messages of errors.
[[nodiscard]] std::string did_you_mean(const Store& store, CommitNumber commit,
                                       std::string_view name,
                                       const std::unordered_set<FrameId>& removed = {},
                                       std::vector<std::string> made = {});

}  // namespace tfdb::store
