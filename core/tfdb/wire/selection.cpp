#include "tfdb/wire/selection.hpp"

#include <algorithm>
#include <utility>

namespace tfdb::wire {

namespace {

/// An unchanged name keeps the '/' before it.
void rename(std::string_view& name, bool& slash, std::string_view to) {
    slash = slash && name == to;
    name = to;
}

}  // namespace

void StampRange::include(clock::StampNs stamp) {
    first = std::min(first, stamp);
    last = std::max(last, stamp);
}

Selection::Selection(Choose choose, StampRange window)
    : choose_(std::move(choose)), window_(window) {}

bool Selection::apply(std::uint32_t rule, bool is_static, std::vector<TransformView>& members) {
    bool changes = false;
    const std::uint64_t left_out = std::erase_if(members, [&](TransformView& member) {
        const Edge* const edge = kept_edge(rule, is_static, member);
        if (edge == nullptr)
            return true;
        changes = changes || edge->is_renamed;
        rename(member.parent, member.slash_before_parent, edge->names->parent);
        rename(member.child, member.slash_before_child, edge->names->child);
        if (shift_ != 0 && !is_static && clock::is_stamp(member.stamp)) {
            member.stamp = clock::saturating_add(member.stamp, shift_);
            changes = true;
        }
        return false;
    });
    left_out_ += left_out;
    return changes || left_out != 0;
}

/// Null: the member is removed.
const Selection::Edge* Selection::kept_edge(std::uint32_t rule, bool is_static,
                                            const TransformView& member) {
    Edge& edge = this->edge({rule, member.parent, member.child});
    if (!edge.names)
        return nullptr;
    if (!is_static && clock::is_stamp(member.stamp)) {
        if (!window_.has(member.stamp)) {
            if (!outside_)
                outside_ = StampRange{member.stamp, member.stamp};
            outside_->include(member.stamp);
            return nullptr;
        }
        ++moving_;
    }
    edge.is_kept = true;
    return &edge;
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
    made.is_renamed =
        made.names && (made.names->parent != key.parent || made.names->child != key.child);
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
