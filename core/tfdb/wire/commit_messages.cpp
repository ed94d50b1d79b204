#include "tfdb/wire/commit_messages.hpp"

#include <algorithm>
#include <bit>
#include <cstdint>
#include <limits>
#include <unordered_map>
#include <utility>

#include "tfdb/wire/tf_message.hpp"

namespace tfdb::wire {
namespace {

using Edge = CommitSample::Edge;
using Row = CommitSample::Row;

constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

/// The kept frames of a sample, by the indices of their names.
/// Threads: one. Guarantee: the names are views that live as long as this.
class Frames {
public:
    Frames(const CommitSample& sample, const ChooseName& choose) : names(sample.names) {
        if (!choose)
            return;
        is_chosen_ = true;
        chosen_.reserve(names.size());
        for (std::string_view& name : names) {
            chosen_.push_back(choose(name));
            name = chosen_.back().name;
        }
        refuse_doubles(sample);
    }
    [[nodiscard]] bool is_chosen() const { return is_chosen_; }
    [[nodiscard]] bool has_edge(std::uint32_t place) const {
        return !is_chosen_ || chosen_[place].keeps_edge;
    }

    std::vector<std::string_view> names;

private:
    /// A sample may list a name twice: for a removed frame, and for a later one.
    void refuse_doubles(const CommitSample& sample) const {
        std::unordered_map<std::string_view, std::string_view> before;
        for (std::size_t place = 0; place < names.size(); ++place) {
            const auto [at, is_new] = before.try_emplace(names[place], sample.names[place]);
            if (!is_new && at->second != sample.names[place])
                throw InvalidArgument("frames '" + std::string(at->second) + "' and '" +
                                      std::string(sample.names[place]) +
                                      "' would have the same name, '" + std::string(names[place]) +
                                      "': rename them to different ones");
        }
    }

    bool is_chosen_ = false;
    std::vector<ChosenName> chosen_;
};

[[nodiscard]] TransformView view_of(const Frames& frames, const Edge& edge, const Row& row) {
    return {frames.names[row.parent], frames.names[edge.child], row.stamp,
            std::bit_cast<geometry::Pose>(row.numbers)};
}

/// Whether a TFMessage can hold the stamp: its seconds have 31 bits.
[[nodiscard]] bool is_representable(const TransformView& view) {
    constexpr clock::StampNs kMost = clock::StampNs{std::numeric_limits<std::int32_t>::max()};
    return view.stamp >= 0 && view.stamp / clock::kNanosPerSecond <= kMost;
}

/// Creates the messages of one commit after another.
/// Threads: one. Guarantee: none.
class Messages {
public:
    Messages(const CommitSample& sample, const Frames& frames) : sample_(sample), frames_(frames) {}

    /// Whether the commit has kept data.
    [[nodiscard]] bool add(const CommitSample::Commit& commit, CommitNumber since) {
        start();
        const auto has_edge = [&](std::uint32_t at) { return frames_.has_edge(at); };
        const auto may_be_parent = [](std::uint32_t) { return true; };
        take(cleared_, commit.cleared, has_edge);
        take(removed_, commit.removed, may_be_parent);
        take(passing_, commit.passing, may_be_parent);
        take(made_, commit.made, has_edge);
        is_full_ = cleared_.empty() && removed_.empty() && passing_.empty();
        order(commit);
        for (const Edge& edge : ordered_)
            add_edge(edge);
        if (edges_.empty() && made_.empty() && is_full_)
            return false;
        encode_transforms(commit.number);
        if (!is_full_ || !are_made_seen())
            encode_whole(commit.number, since);
        return true;
    }
    /// Adds the last sample of each edge.
    void add_state(const CommitSample::Commit& state, std::span<const std::byte> data) {
        start();
        order(state);
        for (const Edge& edge : ordered_)
            add_newest(edge);
        encode_transforms(state.number);
        made.whole = frames_.is_chosen() ? whole_state(state.number)
                                         : std::vector<std::byte>(data.begin(), data.end());
    }

    CommitMessages made;

private:
    struct KeptEdge {
        Edge edge;
        std::size_t first;
        std::size_t count;
    };

    void start() {
        made = {};
        edges_.clear();
        rows_.clear();
        moving_.clear();
        fixed_.clear();
        for (auto* const list : {&cleared_, &removed_, &passing_, &made_})
            list->clear();
    }
    template <class Keep>
    void take(std::vector<std::uint32_t>& list, CommitSample::Range range, Keep keep) {
        for (const std::uint32_t place : sample_.names_of(range)) {
            if (keep(place))
                list.push_back(place);
        }
        std::ranges::sort(list, {}, [&](std::uint32_t at) { return frames_.names[at]; });
    }
    /// Orders the kept edges by names: stores with equal commits then have equal messages.
    void order(const CommitSample::Commit& commit) {
        ordered_.clear();
        for (const Edge& edge : sample_.edges_of(commit)) {
            if (frames_.has_edge(edge.child))
                ordered_.push_back(edge);
        }
        std::ranges::sort(ordered_, {},
                          [&](const Edge& edge) { return frames_.names[edge.child]; });
    }
    void add_edge(const Edge& edge) {
        const std::size_t first = rows_.size();
        for (const Row& row : sample_.rows_of(edge)) {
            rows_.push_back(row);
            is_full_ = say(edge, row) && !row.gone && is_full_;
        }
        is_full_ = is_full_ && edge.authority == 0;
        edges_.push_back({edge, first, rows_.size() - first});
    }
    void add_newest(const Edge& edge) {
        const auto rows = sample_.rows_of(edge);
        if (!rows.empty() && !rows.back().gone)
            (void)say(edge, rows.back());
    }
    /// Adds a sample to its message; false: no message can hold it.
    [[nodiscard]] bool say(const Edge& edge, const Row& row) {
        const TransformView view = view_of(frames_, edge, row);
        if (!is_representable(view))
            return false;
        (edge.is_static ? fixed_ : moving_).push_back(view);
        return true;
    }
    void encode_transforms(CommitNumber commit) {
        made.commit = commit;
        if (!moving_.empty())
            encode_tf_message(moving_, Encoding::kCdr, made.moving);
        if (!fixed_.empty())
            encode_tf_message(fixed_, Encoding::kCdr, made.fixed);
    }
    /// Whether each created frame occurs in a transform.
    [[nodiscard]] bool are_made_seen() const {
        return std::all_of(made_.begin(), made_.end(), [&](std::uint32_t place) {
            const auto is_child = [&](const KeptEdge& kept) { return kept.edge.child == place; };
            const auto is_parent = [&](const Row& row) { return row.parent == place; };
            return std::any_of(edges_.begin(), edges_.end(), is_child) ||
                   std::any_of(rows_.begin(), rows_.end(), is_parent);
        });
    }

    // -- samples of one commit
    // ---------------------------------------------------------------------

    void start_sample() {
        writer_.start();
        places_.assign(frames_.names.size(), kNone);
        authorities_.assign(sample_.authorities.size(), kNone);
    }
    [[nodiscard]] std::uint32_t place(std::uint32_t given) {
        if (places_[given] == kNone)
            places_[given] = writer_.add_name(frames_.names[given]);
        return places_[given];
    }
    void renumber(std::vector<std::uint32_t>& list) {
        for (std::uint32_t& each : list)
            each = place(each);
    }
    [[nodiscard]] std::uint32_t authority(std::uint32_t given) {
        if (given == 0)
            return 0;
        if (authorities_[given] == kNone)
            authorities_[given] = writer_.add_authority(sample_.authorities[given]);
        return authorities_[given];
    }
    void encode_whole(CommitNumber commit, CommitNumber since) {
        start_sample();
        for (auto* const list : {&cleared_, &removed_, &passing_, &made_})
            renumber(*list);
        writer_.start_commit(commit - since, {cleared_, removed_, passing_, made_}, edges_.size());
        for (KeptEdge& kept : edges_) {
            const std::span rows = std::span(rows_).subspan(kept.first, kept.count);
            for (Row& row : rows)
                row.parent = place(row.parent);
            kept.edge.child = place(kept.edge.child);
            kept.edge.authority = authority(kept.edge.authority);
            writer_.add_edge(kept.edge, rows);
        }
        made.whole = writer_.finish(CommitSample::Kind::kCommits, sample_.epoch, 0, since, commit);
    }
    /// Its frames are ordered by name; parents that are not kept follow.
    [[nodiscard]] std::vector<std::byte> whole_state(CommitNumber commit) {
        start_sample();
        for (const Edge& edge : ordered_)
            (void)place(edge.child);
        for (Edge& edge : ordered_) {
            rows_.clear();
            for (const Row& row : sample_.rows_of(edge)) {
                rows_.push_back(row);
                if (!row.gone)
                    rows_.back().parent = place(row.parent);
            }
            edge.child = place(edge.child);
            edge.authority = authority(edge.authority);
            writer_.add_frame(edge, rows_);
        }
        return writer_.finish(CommitSample::Kind::kState, sample_.epoch, 0, commit, commit,
                              ordered_.size());
    }

    const CommitSample& sample_;
    const Frames& frames_;
    bool is_full_ = true;
    std::vector<std::uint32_t> cleared_;
    std::vector<std::uint32_t> removed_;
    std::vector<std::uint32_t> passing_;
    std::vector<std::uint32_t> made_;
    std::vector<Edge> ordered_;
    std::vector<KeptEdge> edges_;
    std::vector<Row> rows_;
    std::vector<TransformView> moving_;
    std::vector<TransformView> fixed_;
    SampleWriter writer_;
    std::vector<std::uint32_t> places_;
    std::vector<std::uint32_t> authorities_;
};

/// The edges of TFMessages, as a sample represents them.
/// Threads: one. Guarantee: the messages' bytes outlive it.
class EdgesOfMessages {
public:
    void add(std::span<const std::byte> message, bool is_static) {
        if (message.empty())
            return;
        std::vector<TransformView> views;
        decode_tf_message(message, Encoding::kCdr, views);
        for (const TransformView& view : views) {
            const std::uint32_t child = place(view.child);
            const auto [at, is_new] = by_child_.try_emplace(child, edges_.size());
            if (is_new)
                edges_.push_back({{.child = child, .is_static = is_static}, {}});
            edges_[at->second].rows.push_back(
                {is_static ? 0 : view.stamp, place(view.parent), false,
                 std::bit_cast<std::array<std::uint64_t, 7>>(view.pose)});
        }
    }
    [[nodiscard]] std::vector<std::byte> finish(const Epoch& epoch, CommitNumber since,
                                                CommitNumber commit) {
        writer_.start_commit(commit - since, {}, edges_.size());
        for (const auto& [edge, rows] : edges_)
            writer_.add_edge(edge, rows);
        return writer_.finish(CommitSample::Kind::kCommits, epoch, 0, since, commit);
    }

private:
    struct EdgeRows {
        Edge edge;
        std::vector<Row> rows;
    };
    [[nodiscard]] std::uint32_t place(std::string_view name) {
        const auto [at, is_new] = names_.try_emplace(name, 0);
        if (is_new)
            at->second = writer_.add_name(name);
        return at->second;
    }

    SampleWriter writer_;
    std::unordered_map<std::string_view, std::uint32_t> names_;
    std::unordered_map<std::uint32_t, std::size_t> by_child_;
    std::vector<EdgeRows> edges_;
};

}  // namespace

std::vector<CommitMessages> messages_of_commits(std::span<const std::byte> data, CommitNumber since,
                                                const ChooseName& choose) {
    CommitSample sample;
    sample.decode(data);
    const Frames frames(sample, choose);
    Messages messages(sample, frames);
    std::vector<CommitMessages> made;
    if (sample.kind == CommitSample::Kind::kState) {
        messages.add_state(sample.commits.front(), data);
        made.push_back(std::move(messages.made));
        return made;
    }
    for (const CommitSample::Commit& commit : sample.commits) {
        if (!messages.add(commit, since))
            continue;
        since = commit.number;
        made.push_back(std::move(messages.made));
    }
    return made;
}

std::vector<std::byte> commit_of_messages(const Epoch& epoch, CommitNumber since,
                                          CommitNumber commit, std::span<const std::byte> moving,
                                          std::span<const std::byte> fixed) {
    if (commit <= since)
        throw InvalidArgument("a commit must be later than " + std::to_string(since) + ", got " +
                              std::to_string(commit));
    EdgesOfMessages edges;
    edges.add(moving, false);
    edges.add(fixed, true);
    return edges.finish(epoch, since, commit);
}

}  // namespace tfdb::wire
