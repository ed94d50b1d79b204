#include "tfdb/store/lifespans.hpp"

#include <algorithm>
#include <memory>

#include "tfdb/store/store.hpp"

namespace tfdb {

bool store::matches(std::string_view pattern, std::string_view name) {
    std::size_t in_pattern = 0;
    std::size_t in_name = 0;
    std::size_t star = std::string_view::npos;
    std::size_t behind_star = 0;  // where the name continues after the text matched by the star
    while (in_name < name.size()) {
        if (in_pattern < pattern.size() && pattern[in_pattern] == '*') {
            star = in_pattern++;
            behind_star = in_name;
        } else if (in_pattern < pattern.size() && pattern[in_pattern] == name[in_name]) {
            ++in_pattern;
            ++in_name;
        } else if (star != std::string_view::npos) {
            in_pattern = star + 1;
            in_name = ++behind_star;
        } else {
            return false;
        }
    }
    return pattern.find_first_not_of('*', in_pattern) == std::string_view::npos;
}

store::Lifespans::Lifespans(std::span<const Lifespan> all) : all_(all.begin(), all.end()) {
    for (std::size_t i = 0; i < all_.size(); ++i) {
        const std::string& child = all_[i].child;
        auto& places = child.find('*') == std::string::npos ? by_child_[child] : patterns_;
        places.push_back(i);
    }
}

const Lifespan* store::Lifespans::of(std::string_view parent, std::string_view child) const {
    std::size_t first = all_.size();
    if (const auto found = by_child_.find(std::string(child)); found != by_child_.end()) {
        for (const std::size_t i : found->second) {
            if (matches(all_[i].parent, parent)) {
                first = i;
                break;
            }
        }
    }
    for (const std::size_t i : patterns_) {
        if (i >= first)
            break;
        if (matches(all_[i].child, child) && matches(all_[i].parent, parent))
            first = i;
    }
    return first < all_.size() ? &all_[first] : nullptr;
}

bool store::Lifespans::same_as(std::span<const Lifespan> all) const {
    return std::ranges::equal(all_, all);
}

void Buffer::enforce(std::span<const Lifespan> lifespans) {
    const store::Lifespans* chosen = nullptr;
    // Lifespans are kept for the life of the store: they may be in use, and programs tend to repeat
    // them.
    auto& so_far = store_->lifespans_so_far;
    if (!lifespans.empty()) {
        const auto known = std::ranges::find_if(
            so_far, [&](const auto& each) { return each->same_as(lifespans); });
        chosen = known != so_far.end()
                     ? known->get()
                     : so_far.emplace_back(std::make_unique<store::Lifespans>(lifespans)).get();
    }
    store_->lifespans.store_release(chosen);
}

}  // namespace tfdb
