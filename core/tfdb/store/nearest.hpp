// Suggests frames for an unknown name.
#pragma once

#include <string>
#include <string_view>
#include <unordered_set>
#include <vector>

#include "tfdb/store/store.hpp"

namespace tfdb::store {

/// At most three names similar to one, the nearest first. Similar names differ, ignoring case, in a
/// few missing, wrong, swapped or additional letters, or by a prefix such as `robot1/`.
[[nodiscard]] std::vector<std::string> nearest(std::string_view name,
                                               std::vector<std::string> known);

/// "; did you mean 'base_link'?" with the frames of a commit, without `removed`, and with the names
/// in `made`. Empty if no name is near, or if there are so many frames that the search would take
/// long: this is for error messages.
[[nodiscard]] std::string did_you_mean(const Store& store, CommitNumber commit,
                                       std::string_view name,
                                       const std::unordered_set<FrameId>& removed = {},
                                       std::vector<std::string> made = {});

}  // namespace tfdb::store
