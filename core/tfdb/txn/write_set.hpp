// The writes of a transaction before its commit, kept as the state that they produce.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <unordered_map>
#include <unordered_set>
#include <vector>

#include "tfdb/base/types.hpp"
#include "tfdb/history/layout.hpp"
#include "tfdb/txn/frame_places.hpp"

namespace tfdb::txn {

/// The commit number of a transaction's samples before its commit.
inline constexpr CommitNumber kOwnCommit = kMaxCommit - 1;
/// The generation of frames created by a transaction: no slot has it.
inline constexpr std::uint32_t kOwnGeneration = kNoFrame + 1;

/// Samples, new frames and removed frames of one transaction. Frames that it creates have their own
/// ids, from kNoFrame - 1 downward.
/// Threads: one. Guarantee: the order of the calls matters only as far as it changes the result.
template <class Memory>
class WriteSet {
public:
    struct Sample {
        clock::StampNs stamp = 0;  // or kStaticStamp
        FrameId parent = kNoFrame;
        std::array<std::uint64_t, Memory::kPayloadWords> payload{};
        std::uint32_t authority = 0;  // index into `authorities`
    };
    /// Samples of one edge. Late samples are sorted in on the first read.
    /// Threads: one. Guarantee: each stamp once, with the last sample put.
    class Samples {
    public:
        void clear() {
            all_.clear();
            sorted_ = 0;
        }
        [[nodiscard]] bool empty() const { return all_.empty(); }
        [[nodiscard]] const Sample& newest() const { return all_[newest_]; }
        /// True if the sample is now the newest.
        bool put(const Sample& sample) {
            const bool last = empty() || sample.stamp >= newest().stamp;
            const bool sorted = last && sorted_ == all_.size();
            if (sorted && !empty() && sample.stamp == newest().stamp) {
                all_.back() = sample;
                return true;
            }
            all_.push_back(sample);
            sorted_ += sorted ? 1 : 0;
            newest_ = last ? all_.size() - 1 : newest_;
            return last;
        }
        /// In stamp order.
        [[nodiscard]] const std::vector<Sample>& in_order() const {
            if (sorted_ != all_.size())
                sort();
            return all_;
        }
        [[nodiscard]] std::size_t size() const { return all_.size(); }

    private:
        void sort() const {
            const auto earlier = [](const Sample& a, const Sample& b) { return a.stamp < b.stamp; };
            const auto late = all_.begin() + static_cast<std::ptrdiff_t>(sorted_);
            std::stable_sort(late, all_.end(), earlier);
            std::inplace_merge(all_.begin(), late, all_.end(), earlier);
            std::size_t kept = 0;
            for (std::size_t i = 0; i < all_.size(); ++i) {
                if (i + 1 == all_.size() || all_[i + 1].stamp != all_[i].stamp)
                    all_[kept++] = all_[i];
            }
            all_.resize(kept);
            sorted_ = kept;
            newest_ = kept - 1;
        }

        mutable std::vector<Sample> all_;
        mutable std::size_t sorted_ = 0;  // number of sorted samples
        mutable std::size_t newest_ = 0;
    };
    struct Edge {
        FrameId child = kNoFrame;
        bool is_static = false;
        bool mixed = false;           // several parents, including the store's own
        std::uint32_t depth = 0;      // hint: depth of the newest sample's parent plus one
        std::uint32_t authority = 0;  // of the last write, regardless of its stamp
        Samples samples;              // a static edge has one sample

        [[nodiscard]] const Sample& newest() const { return samples.newest(); }
    };

    void clear() {
        for (Edge& edge : std::span(edges_).first(written_)) {
            most_samples_ = std::max(most_samples_, edge.samples.size());
            edge.samples.clear();
        }
        written_ = 0;
        places_.clear();
        naming_.clear();
        made_.clear();
        names_.clear();
        removed_.clear();
        authorities_.clear();
        cleared_ = false;
    }
    /// Whether it is worth keeping for the next transaction.
    [[nodiscard]] bool is_small() const {
        return edges_.size() <= kMostKept && most_samples_ <= kMostKept &&
               names_.bucket_count() <= kMostKept && removed_.bucket_count() <= kMostKept;
    }

    [[nodiscard]] bool empty() const {
        return written_ == 0 && made_.empty() && removed_.empty() && !cleared_;
    }

    [[nodiscard]] bool is_own(FrameId id) const {
        return id < kNoFrame && place_of(id) < made_.size();
    }
    [[nodiscard]] bool is_removed(FrameId id) const { return removed_.contains(id); }
    /// The frame of that name created by this transaction, or kNoFrame.
    [[nodiscard]] FrameId find(std::string_view name) const {
        const auto found = names_.find(std::string(name));
        return found == names_.end() ? kNoFrame : found->second;
    }
    [[nodiscard]] const std::string& name(FrameId own) const { return made_[place_of(own)]; }
    /// Names of the frames that this transaction created and did not remove.
    [[nodiscard]] std::vector<std::string> names() const {
        std::vector<std::string> names;
        for (const auto& [name, id] : names_)
            names.push_back(name);
        return names;
    }
    /// The id of the next frame.
    [[nodiscard]] FrameId next_id() const {
        return kNoFrame - 1 - static_cast<FrameId>(made_.size());
    }
    FrameId make(std::string_view name) {
        const FrameId id = next_id();
        made_.emplace_back(name);
        names_.insert_or_assign(std::string(name), id);
        return id;
    }

    /// Drops the frame and all writes to it.
    void remove(FrameId id) {
        removed_.insert(id);
        if (is_own(id))
            names_.erase(made_[place_of(id)]);
        const std::uint32_t place = places_.find(id);
        if (place != FramePlaces::kNone)
            drop(edges_[place]);
    }

    /// Drops all moving samples: the store's, and those written so far.
    void clear_moving() {
        cleared_ = true;
        for (Edge& edge : std::span(edges_).first(written_)) {
            if (edge.child != kNoFrame && !edge.is_static)
                drop(edge);
        }
        std::erase_if(naming_, [this](const Naming& n) { return edge(n.second) == nullptr; });
    }
    /// Whether the store's moving samples are dropped.
    [[nodiscard]] bool cleared() const { return cleared_; }

    /// The transaction's writes to an edge; null if there are none.
    [[nodiscard]] const Edge* edge(FrameId child) const {
        const std::uint32_t place = places_.find(child);
        return place == FramePlaces::kNone ? nullptr : &edges_[place];
    }
    /// `base`: the parent in the store, or kNoFrame; `depth`: hint of the sample's parent.
    void put(FrameId child, const Sample& sample, FrameId base, std::uint32_t depth) {
        std::uint32_t place = places_.find(child);
        if (place == FramePlaces::kNone)
            place = add_edge(child);
        Edge& edge = edges_[place];
        edge.is_static = sample.stamp == history::kStaticStamp;
        edge.authority = sample.authority;
        edge.mixed |= base != kNoFrame && base != sample.parent;
        edge.mixed |= !edge.samples.empty() && edge.newest().parent != sample.parent;
        if (edge.samples.put(sample))
            edge.depth = depth + 1;
        const Naming naming{sample.parent, child};
        if (naming_.empty() || naming_.back() != naming)
            naming_.push_back(naming);
    }
    /// Frames with an own sample, possibly not the newest, that names the parent; may contain
    /// duplicates.
    [[nodiscard]] std::vector<FrameId> naming(FrameId parent) {
        if (!std::is_sorted(naming_.begin(), naming_.end()))
            std::sort(naming_.begin(), naming_.end());
        std::vector<FrameId> children;
        auto at = std::lower_bound(naming_.begin(), naming_.end(), Naming{parent, 0});
        for (; at != naming_.end() && at->first == parent; ++at)
            children.push_back(at->second);
        return children;
    }

    std::uint32_t authority(std::string_view name) {
        if (authorities_.empty() || authorities_.back() != name)
            authorities_.emplace_back(name);
        return static_cast<std::uint32_t>(authorities_.size() - 1);
    }
    [[nodiscard]] const std::string& authority_name(std::uint32_t place) const {
        return authorities_[place];
    }
    /// The last writer of an edge.
    [[nodiscard]] const std::string& author_of(const Edge& edge) const {
        return authority_name(edge.authority);
    }

    /// In the order of their first samples; `child` is kNoFrame if the frame was removed since, or
    /// its samples were cleared.
    [[nodiscard]] std::span<const Edge> edges() const { return {edges_.data(), written_}; }
    [[nodiscard]] std::size_t made() const { return made_.size(); }
    [[nodiscard]] const std::unordered_set<FrameId>& removed() const { return removed_; }
    [[nodiscard]] static FrameId own_id(std::size_t place) {
        return kNoFrame - 1 - static_cast<FrameId>(place);
    }
    [[nodiscard]] static std::size_t place_of(FrameId own) { return kNoFrame - 1 - own; }

private:
    static constexpr std::size_t kMostKept = 256;
    /// A parent, and a child with a sample that names it.
    using Naming = std::pair<FrameId, FrameId>;

    void drop(Edge& edge) {
        places_.set(edge.child, FramePlaces::kNone);
        most_samples_ = std::max(most_samples_, edge.samples.size());
        edge.samples.clear();
        edge.child = kNoFrame;
    }
    std::uint32_t add_edge(FrameId child) {
        if (written_ == edges_.size())
            edges_.emplace_back();
        Edge& edge = edges_[written_];
        edge.child = child;
        edge.mixed = false;
        edge.depth = 0;
        places_.set(child, static_cast<std::uint32_t>(written_));
        return static_cast<std::uint32_t>(written_++);
    }

    std::vector<Edge> edges_;  // entries beyond `written_` are kept for reuse
    std::size_t written_ = 0;
    std::size_t most_samples_ = 0;  // maximum of any edge so far
    FramePlaces places_;            // positions of the edges
    std::vector<Naming> naming_;
    std::vector<std::string> made_;  // names, by position
    std::unordered_map<std::string, FrameId> names_;
    std::unordered_set<FrameId> removed_;
    std::vector<std::string> authorities_;
    bool cleared_ = false;
};

}  // namespace tfdb::txn
