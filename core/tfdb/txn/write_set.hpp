// What a transaction has written, kept as the state that it will leave, until its commit.
#pragma once

#include <array>
#include <cstdint>
#include <iterator>
#include <set>
#include <string>
#include <string_view>
#include <unordered_map>
#include <unordered_set>
#include <vector>

#include "tfdb/base/types.hpp"
#include "tfdb/history/layout.hpp"

namespace tfdb::txn {

/// The commit that samples of a transaction seem to have before there is one.
inline constexpr CommitNumber kOwnCommit = kMaxCommit - 1;
/// The generation of a frame that a transaction has made: none that a slot can have.
inline constexpr std::uint32_t kOwnGeneration = kNoFrame + 1;

/// Samples, new frames and removed frames of one transaction. Frames that it makes have ids of its
/// own, from kNoFrame - 1 downward.
/// Threads: one. Guarantee: the order of the calls shows only in what it leaves.
template <class Memory>
class WriteSet {
public:
    struct Sample {
        clock::StampNs stamp = 0;  // or kStaticStamp
        FrameId parent = kNoFrame;
        std::array<std::uint64_t, Memory::kPayloadWords> payload{};
        std::uint32_t authority = 0;  // position among `authorities`
    };
    struct ByStamp {
        using is_transparent = void;
        bool operator()(const Sample& a, const Sample& b) const { return a.stamp < b.stamp; }
        bool operator()(const Sample& a, clock::StampNs b) const { return a.stamp < b; }
        bool operator()(clock::StampNs a, const Sample& b) const { return a < b.stamp; }
    };
    struct Edge {
        FrameId child = kNoFrame;
        bool is_static = false;
        bool mixed = false;                 // several parents, the store's own included
        std::uint32_t depth = 0;            // hint, of the newest sample's parent plus one
        std::set<Sample, ByStamp> samples;  // a static edge has one

        [[nodiscard]] const Sample& newest() const { return *samples.rbegin(); }
    };

    [[nodiscard]] bool empty() const { return edges_.empty() && made_.empty() && removed_.empty(); }

    [[nodiscard]] bool is_own(FrameId id) const {
        return id < kNoFrame && place_of(id) < made_.size();
    }
    [[nodiscard]] bool is_removed(FrameId id) const { return removed_.contains(id); }
    /// The frame of that name that this transaction has made, or kNoFrame.
    [[nodiscard]] FrameId find(std::string_view name) const {
        const auto found = names_.find(std::string(name));
        return found == names_.end() ? kNoFrame : found->second;
    }
    [[nodiscard]] const std::string& name(FrameId own) const { return made_[place_of(own)]; }
    /// The id that the next frame gets.
    [[nodiscard]] FrameId next_id() const {
        return kNoFrame - 1 - static_cast<FrameId>(made_.size());
    }
    FrameId make(std::string_view name) {
        const FrameId id = next_id();
        made_.emplace_back(name);
        names_.insert_or_assign(std::string(name), id);
        return id;
    }

    /// The frame and what was written to it is no more.
    void remove(FrameId id) {
        removed_.insert(id);
        if (is_own(id))
            names_.erase(made_[place_of(id)]);
        const auto place = places_.find(id);
        if (place == places_.end())
            return;
        edges_[place->second].samples.clear();
        edges_[place->second].child = kNoFrame;
        places_.erase(place);
    }

    /// The edge as written by this transaction, null if it was not.
    [[nodiscard]] const Edge* edge(FrameId child) const {
        if (places_.empty())
            return nullptr;
        const auto place = places_.find(child);
        return place == places_.end() ? nullptr : &edges_[place->second];
    }
    /// `base`: the parent that the store knows, or kNoFrame; `depth`: hint of the sample's parent.
    void put(FrameId child, const Sample& sample, FrameId base, std::uint32_t depth) {
        const auto [place, added] = places_.try_emplace(child, edges_.size());
        if (added)
            edges_.push_back({child, false, false, 0, {}});
        Edge& edge = edges_[place->second];
        edge.is_static = sample.stamp == history::kStaticStamp;
        edge.mixed |= base != kNoFrame && base != sample.parent;
        edge.mixed |= !edge.samples.empty() && edge.newest().parent != sample.parent;
        auto at = edge.samples.end();
        if (!edge.samples.empty() && edge.newest().stamp >= sample.stamp)
            at = edge.samples.lower_bound(sample.stamp);
        if (at != edge.samples.end() && at->stamp == sample.stamp)
            at = edge.samples.erase(at);
        at = edge.samples.insert(at, sample);
        if (std::next(at) == edge.samples.end())
            edge.depth = depth + 1;
        std::vector<FrameId>& children = naming_[sample.parent];
        if (children.empty() || children.back() != child)
            children.push_back(child);
    }
    /// Frames with own samples of which one, perhaps an older one, names the parent; some twice.
    [[nodiscard]] std::vector<FrameId> naming(FrameId parent) const {
        const auto found = naming_.find(parent);
        return found == naming_.end() ? std::vector<FrameId>() : found->second;
    }

    std::uint32_t authority(std::string_view name) {
        if (authorities_.empty() || authorities_.back() != name)
            authorities_.emplace_back(name);
        return static_cast<std::uint32_t>(authorities_.size() - 1);
    }
    [[nodiscard]] const std::string& authority_name(std::uint32_t place) const {
        return authorities_[place];
    }
    /// Who wrote an edge's newest sample.
    [[nodiscard]] const std::string& author_of(const Edge& edge) const {
        return authority_name(edge.newest().authority);
    }

    /// In the order of their first samples; `child` is kNoFrame where the frame was removed since.
    [[nodiscard]] const std::vector<Edge>& edges() const { return edges_; }
    [[nodiscard]] std::size_t made() const { return made_.size(); }
    [[nodiscard]] const std::unordered_set<FrameId>& removed() const { return removed_; }
    [[nodiscard]] static FrameId own_id(std::size_t place) {
        return kNoFrame - 1 - static_cast<FrameId>(place);
    }
    [[nodiscard]] static std::size_t place_of(FrameId own) { return kNoFrame - 1 - own; }

private:
    std::vector<Edge> edges_;
    std::unordered_map<FrameId, std::size_t> places_;
    std::unordered_map<FrameId, std::vector<FrameId>> naming_;  // by parent
    std::vector<std::string> made_;                             // names, by place
    std::unordered_map<std::string, FrameId> names_;
    std::unordered_set<FrameId> removed_;
    std::vector<std::string> authorities_;
};

}  // namespace tfdb::txn
