#include "tfdb/store/arrivals.hpp"

namespace tfdb {

Arrivals::Arrivals(bool with_store) {
    BufferOptions options;
    options.history_ns = std::nullopt;
    if (with_store)
        store_.emplace(options);
}

void Arrivals::validate(std::span<const wire::TransformView> members, bool is_static) {
    is_kept_.assign(members.size(), true);
    if (store_)
        return validate_by_store(members, is_static);
    for (std::size_t i = 0; i < members.size(); ++i) {
        const EdgeSurvey::Verdict verdict = survey_.add(members[i], is_static);
        is_kept_[i] = verdict == EdgeSurvey::Verdict::kStored;
        if (verdict == EdgeSurvey::Verdict::kStaticConflict)
            ++conflicts_[{std::string(members[i].child), is_static}];
    }
}

void Arrivals::validate_by_store(std::span<const wire::TransformView> members, bool is_static) {
    const WriteResult result =
        store_->write({.transforms = members, .is_static = is_static, .partial = true});
    for (const RefusedMember& each : result.refused) {
        is_kept_[each.index] = false;
        if (each.code == ErrorCode::kStaticConflict)
            ++conflicts_[{std::string(members[each.index].child), is_static}];
    }
}

void Arrivals::append(const wire::TransformView& member, const Message& message,
                      std::int64_t publisher) {
    auto at = columns_.find(member.child);
    if (at == columns_.end())
        at = columns_.try_emplace(std::string(member.child)).first;
    Columns& columns = at->second;
    columns.stamps.push_back(member.stamp);
    columns.received.push_back(message.received);
    columns.poses.push_back(member.pose);
    columns.parents.push_back(id(member.parent));
    columns.publishers.push_back(publisher);
    columns.is_static.push_back(message.is_static ? 1 : 0);
}

std::int64_t Arrivals::id(std::string_view name) {
    auto at = ids_.find(name);
    if (at == ids_.end()) {
        at = ids_.try_emplace(std::string(name), static_cast<std::int64_t>(names_.size())).first;
        names_.emplace_back(name);
    }
    return at->second;
}

}  // namespace tfdb
