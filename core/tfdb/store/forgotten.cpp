#include "tfdb/store/forgotten.hpp"

#include <algorithm>

namespace tfdb {

void Forgotten::stored(std::string_view child, clock::StampNs stamp) {
    auto edge = edges_.find(child);
    if (edge == edges_.end())
        edge = edges_.try_emplace(std::string(child)).first;
    Stamps& stamps = edge->second;
    if (stamps.empty() || stamp > stamps.back()) {
        stamps.push_back(stamp);
    } else if (const auto place = std::lower_bound(stamps.begin(), stamps.end(), stamp);
               *place != stamp) {
        stamps.insert(place, stamp);
    }
    for (; stamps.front() < stamps.back() - history_; stamps.pop_front())
        ++count_;
}

}  // namespace tfdb
