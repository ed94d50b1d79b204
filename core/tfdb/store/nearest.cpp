#include "tfdb/store/nearest.hpp"

#include <algorithm>
#include <cstdlib>
#include <numeric>
#include <utility>

#include "tfdb/store/validate.hpp"

namespace tfdb {
namespace {

constexpr FrameId kMostFrames = 2000;
constexpr std::size_t kMostShown = 3;
/// A message cuts longer names, which makes them ambiguous.
constexpr std::size_t kLongest = 64;

char lower(char c) {
    return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
}

/// Optimal string alignment distance: the number of letters to insert, remove, replace or swap with
/// the next one.
std::size_t distance(std::string_view one, std::string_view other) {
    std::vector<std::size_t> row(other.size() + 1);
    std::vector<std::size_t> last = row;
    std::vector<std::size_t> before = row;
    const auto same = [&](std::size_t i, std::size_t j) {
        return lower(one[i]) == lower(other[j]);
    };
    std::iota(row.begin(), row.end(), std::size_t{0});
    for (std::size_t i = 0; i < one.size(); ++i) {
        std::swap(before, last);
        std::swap(last, row);
        row[0] = i + 1;
        for (std::size_t j = 0; j < other.size(); ++j) {
            row[j + 1] = std::min({last[j] + (same(i, j) ? 0 : 1), row[j] + 1, last[j + 1] + 1});
            if (i > 0 && j > 0 && same(i, j - 1) && same(i - 1, j))
                row[j + 1] = std::min(row[j + 1], before[j - 1] + 1);
        }
    }
    return row.back();
}

bool is_prefixed(std::string_view longer, std::string_view name) {
    return longer.size() > name.size() && longer.substr(longer.size() - name.size()) == name &&
           longer[longer.size() - name.size() - 1] == '/';
}

/// The distance of two names; more than `most` if they are not near.
std::size_t distance_of(std::string_view name, std::string_view other, std::size_t most) {
    if (is_prefixed(other, name) || is_prefixed(name, other))
        return 1;
    const std::size_t longer = std::max(name.size(), other.size());
    const std::size_t shorter = std::min(name.size(), other.size());
    return longer - shorter > most ? most + 1 : distance(name, other);
}

}  // namespace

std::vector<std::string> store::nearest(std::string_view name, std::vector<std::string> known) {
    std::vector<std::pair<std::size_t, std::string>> found;
    if (name.empty() || name.size() > kLongest)
        return {};
    const std::size_t most = std::max<std::size_t>(1, name.size() / 3);
    for (std::string& other : known) {
        if (other.size() > kLongest)
            continue;
        const std::size_t far = distance_of(name, other, most);
        if (far <= most)
            found.emplace_back(far, std::move(other));
    }
    std::sort(found.begin(), found.end());
    found.resize(std::min(found.size(), kMostShown));
    std::vector<std::string> names;
    for (auto& [far, other] : found)
        names.push_back(std::move(other));
    return names;
}

std::string store::did_you_mean(const Store& store, CommitNumber commit, std::string_view name,
                                const std::unordered_set<FrameId>& removed,
                                std::vector<std::string> made) {
    const auto view = store.view(commit);
    if (view.frame_count() + made.size() > kMostFrames)
        return {};
    std::vector<std::string> known = std::move(made);
    for (FrameId id = 0; id < view.frame_count(); ++id) {
        std::string other(store.names.name(id));
        sync::fence_acquire();
        if (view.alive(id) &&
            // otherwise its slot may have been reused before its name was read
            !removed.contains(id))
            known.push_back(std::move(other));
    }
    std::string text;
    for (const std::string& other : nearest(name, std::move(known)))
        text += (text.empty() ? "; did you mean " : " or ") + quoted(other);
    return text.empty() ? text : text + "?";
}

}  // namespace tfdb
