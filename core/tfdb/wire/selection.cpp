#include "tfdb/wire/selection.hpp"

#include <algorithm>
#include <utility>

namespace tfdb::wire {

void StampRange::include(clock::StampNs stamp) {
    first = std::min(first, stamp);
    last = std::max(last, stamp);
}

Selection::Selection(Choose choose, StampRange window)
    : choose_(std::move(choose)), window_(window) {}

void Selection::apply(std::uint32_t rule, bool is_static, std::vector<TransformView>& members) {
    const auto is_out = [&](TransformView& member) { return !keeps(rule, is_static, member); };
    left_out_ += std::erase_if(members, is_out);
}

bool Selection::keeps(std::uint32_t rule, bool is_static, TransformView& member) {
    Edge& edge = this->edge({rule, member.parent, member.child});
    if (!edge.names)
        return false;
    if (!is_static && clock::is_stamp(member.stamp)) {
        if (!window_.has(member.stamp)) {
            if (!outside_)
                outside_ = StampRange{member.stamp, member.stamp};
            outside_->include(member.stamp);
            return false;
        }
        ++moving_;
    }
    edge.is_kept = true;
    member.parent = edge.names->parent;
    member.child = edge.names->child;
    return true;
}

std::vector<Selection::KeptEdge> Selection::kept() const {
    std::vector<KeptEdge> found;
    for (const auto& [key, edge] : edges_) {
        if (edge.is_kept)
            found.push_back({key.rule, key.parent, key.child});
    }
    return found;
}

Selection::Edge& Selection::edge(const KeptEdge& key) {
    const auto known = edges_.find(key);
    if (known != edges_.end())
        return known->second;
    Edge made{choose_(key.rule, key.parent, key.child)};
    Key owned{key.rule, std::string(key.parent), std::string(key.child)};
    return edges_.emplace(std::move(owned), std::move(made)).first->second;
}

std::size_t Selection::Hash::operator()(const KeptEdge& key) const {
    const std::hash<std::string_view> hash;
    return (hash(key.child) * 31 + hash(key.parent)) * 31 + key.rule;
}

std::size_t Selection::Hash::operator()(const Key& key) const {
    return (*this)(KeptEdge{key.rule, key.parent, key.child});
}

}  // namespace tfdb::wire
