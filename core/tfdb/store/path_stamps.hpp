// The stored stamps of a path, in any view.
#pragma once

#include <algorithm>
#include <iterator>
#include <optional>
#include <vector>

#include "tfdb/base/interruption.hpp"
#include "tfdb/lookup/lookup.hpp"
#include "tfdb/store/collect.hpp"

namespace tfdb::store {

/// As StoreReader::path_stamps, into `stamps`.
template <lookup::View V>
[[nodiscard]] lookup::Outcome path_stamps(const V& view, FrameId target, FrameId source,
                                          std::optional<StampNs> start, std::optional<StampNs> end,
                                          std::vector<StampNs>& stamps, Failure& failure) {
    using lookup::Outcome;
    stamps.clear();
    Answer answer;
    // Walks the newest tree, and keeps the chains in the answer.
    const Outcome walked = lookup::latest_common_path(view, target, source, answer, failure);
    if (walked != Outcome::kOk || target == source)
        return walked;
    StampNs first = start.value_or(0);
    StampNs last = std::min(answer.stamp, end.value_or(answer.stamp));
    std::vector<StampNs> of_edge;
    std::vector<StampNs> merged;
    for (const auto* chain : {&answer.source_chain, &answer.target_chain}) {
        for (std::size_t i = 0; i + 1 < chain->size(); ++i) {
            interruption_point();
            typename V::Edge edge;
            if (!view.open((*chain)[i], edge) || edge.empty())
                return Outcome::kLapped;  // the walk found a parent, so the slot was reused
            if (edge.is_static())
                continue;
            of_edge.clear();
            const bool whole = visit_samples(edge, first, last, [&](const auto& sample) {
                of_edge.push_back(sample.stamp);
                return true;
            });
            // A damaged edge may have a newest sample that a visit does not find.
            if (!whole || !edge.confirm() || of_edge.empty())
                return Outcome::kLapped;
            first = std::max(first, of_edge.front());
            last = std::min(last, of_edge.back());
            // Edges of one publisher mostly have equal stamps.
            if (stamps != of_edge) {
                merged.clear();
                std::ranges::set_union(stamps, of_edge, std::back_inserter(merged));
                stamps.swap(merged);
            }
        }
    }
    std::erase_if(stamps, [&](StampNs s) { return s < first || s > last; });
    return Outcome::kOk;
}

}  // namespace tfdb::store
