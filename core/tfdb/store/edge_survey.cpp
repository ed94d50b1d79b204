#include "tfdb/store/edge_survey.hpp"

#include <algorithm>
#include <unordered_set>

#include "tfdb/store/validate.hpp"

namespace tfdb {

void EdgeSurvey::add(std::span<const wire::TransformView> members, bool is_static) {
    for (const wire::TransformView& member : members)
        add(member, is_static);
}

EdgeSurvey::Verdict EdgeSurvey::add(const wire::TransformView& member, bool is_static) {
    if (!store::is_sound({&member, 1}, is_static))
        return Verdict::kRefused;
    const auto known = edges_.find(member.child);
    if (known == edges_.end()) {
        if (!store::has_sound_names(member))
            return Verdict::kRefused;
        Edge edge{std::string(member.parent), is_static, member.stamp, member.stamp};
        edges_.emplace(std::string(member.child), std::move(edge));
        return Verdict::kStored;
    }
    Edge& edge = known->second;
    if (edge.parent != member.parent) {
        if (!store::has_sound_names(member))
            return Verdict::kRefused;
        one_parent_ = one_parent_ && edge.is_static != is_static;
    }
    if (edge.is_static != is_static)
        return Verdict::kStaticConflict;
    edge.first = std::min(edge.first, member.stamp);
    edge.last = std::max(edge.last, member.stamp);
    return Verdict::kStored;
}

bool EdgeSurvey::is_tree() const {
    std::unordered_set<std::string_view> rooted;
    for (const auto& [child, edge] : edges_) {
        std::size_t steps = 0;
        auto at = edges_.find(child);
        for (; at != edges_.end() && !rooted.contains(at->first); ++steps) {
            if (steps > edges_.size())
                return false;
            at = edges_.find(at->second.parent);
        }
        for (at = edges_.find(child); at != edges_.end() && rooted.insert(at->first).second;)
            at = edges_.find(at->second.parent);
    }
    return one_parent_;
}

}  // namespace tfdb
