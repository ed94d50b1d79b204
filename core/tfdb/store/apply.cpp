// Applies commits and states of other stores: see docs/wire.md.
#include <algorithm>
#include <bit>
#include <iterator>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "tfdb/store/apply_order.hpp"
#include "tfdb/store/collect.hpp"
#include "tfdb/store/sources.hpp"
#include "tfdb/store/writes.hpp"
#include "tfdb/txn/frame_places.hpp"
#include "tfdb/wire/commit_sample.hpp"

namespace tfdb::store {
namespace {

using history::SourceWord;
using wire::CommitSample;

}  // namespace

/// Applies samples of one source; their frames stay known from one sample to the next.
/// Threads: one at a time. Guarantee: each commit is one commit here, all or nothing.
class Applying {
public:
    Applying(Store& store, const ApplyOptions& options)
        : store_(store),
          source_name_(options.source),
          prefix_(options.prefix),
          shared_(options.shared.begin(), options.shared.end()) {
        if (!shared_.empty())
            shared_choice_ = std::uint64_t{wire::digest_of(options.shared)} << kSharedShift;
    }

    Position apply(std::span<const std::byte> data);
    [[nodiscard]] LostParents take_lost() { return std::exchange(lost_, {}); }

    /// Threads: any. Empty if no commit of the source was applied yet.
    [[nodiscard]] std::optional<Position> position() {
        if (record() == 0)
            record_.store_relaxed(store_.positions.search(source_name_));
        if (record() == 0)
            return std::nullopt;
        return store_.positions.position(record());
    }

private:
    /// A name of the sample, and its frame here, in the newest commit that had it.
    struct Name {
        std::string there;  // at the source: without prefix
        std::string here;   // in this store; empty: not checked
        FrameId id = kNoFrame;
        CommitNumber born = 0;
    };

    /// Prepares for the commits of a sample, which must outlive them.
    void start(const CommitSample& sample) {
        sample_ = &sample;
        choice_ = sample.choice | shared_choice_;
        authors_.clear();
        const std::size_t count = sample.names.size();
        names_.resize(count);
        for (std::size_t i = 0; i < count; ++i) {
            if (names_[i].there != sample.names[i] || names_[i].here.empty())
                set_name(i);
        }
        for (const std::string_view authority : sample.authorities) {
            if (authority.size() > kMaxNameBytes || !is_text(authority))
                throw InvalidName("authority " + quoted(authority) + " of source " +
                                  quoted(source_name_) +
                                  " is not valid: it has at most 1024 bytes of UTF-8");
        }
        for (std::size_t i = 0; i < sample.rows.size(); ++i)
            check_numbers(i);
    }
    void set_name(std::size_t i) {
        const std::string_view name = sample_->names[i];
        names_[i].here.clear();  // until it is valid
        std::string here = is_shared(name) ? std::string(name) : prefix_ + std::string(name);
        const char* fault = name_fault(here);
        if (fault == nullptr && !is_text(here))
            fault = "is not UTF-8";
        if (fault != nullptr) {
            ErrorDetail detail;
            detail.frame = here;
            detail.reason = fault;
            throw InvalidName("frame " + quoted(here) + " of source " + quoted(source_name_) + " " +
                                  fault + kNameRule,
                              std::move(detail));
        }
        names_[i] = {std::string(name), std::move(here)};
    }

    /// Empty if no commit of the source was applied yet. Under the commit lock.
    [[nodiscard]] std::optional<Position> checked_position() {
        if (is_checked_)
            return store_.positions.position(record());
        record_.store_relaxed(store_.positions.find(source_name_));
        if (record() == 0)
            return std::nullopt;
        if (const std::string prefix = store_.positions.prefix(record()); prefix != prefix_) {
            throw InvalidArgument("source " + quoted(source_name_) + " was applied with prefix " +
                                  quoted(prefix) + ", not " + quoted(prefix_));
        }
        is_checked_ = true;
        return store_.positions.position(record());
    }
    [[nodiscard]] Positions::Record record() const { return record_.load_relaxed(); }

    /// Applies one commit of the sample; the position then is `until`.
    void commit(const CommitSample::Commit& commit, CommitNumber until) {
        if (record() == 0)
            record_.store_relaxed(store_.positions.make(source_name_, prefix_));
        source_ = store_.positions.number(record());
        ids_.assign(names_.size(), kNoFrame);
        gone_.assign(names_.size(), kNoFrame);
        cleared_.clear();
        removed_.clear();
        written_.clear();
        found_.clear();
        left_.clear();
        losing_ = {};
        parents_.reset();
        removed_parent_ = kNoFrame;
        may_be_in_use_ = false;
        const bool is_state = sample_->kind == CommitSample::Kind::kState;
        number_authors();
        StoreCommit made = store_.start_commit_of(source_);
        commit_ = &made;
        if (is_state) {
            // This store was the source's home before.
            if (const auto before = store_.positions.position(record());
                before && before->choice == Positions::kReleased)
                adopt(store_, source_);
            take_away();
        }
        remove(sample_->names_of(commit.removed));
        for (const std::uint32_t name : sample_->names_of(commit.passing))
            pass(name);
        for (const std::uint32_t name : sample_->names_of(commit.made))
            (void)frame(name);
        clear(sample_->names_of(commit.cleared));
        for (const CommitSample::Edge& edge : sample_->edges_of(commit)) {
            store_edge(edge, authors_[edge.authority]);
            if (is_state)
                set_late(edge);
        }
        check_removed();
        break_cycles();
        lost_.local.reserve(lost_.local.size() + losing_.local.size());
        lost_.disputed.reserve(lost_.disputed.size() + losing_.disputed.size());
        made.publish([&] {
            store_.positions.set(record(), sample_->epoch, until, choice_);
            for (const FrameId id : left_)
                set_maker(id, is_written_by_other(id) ? SourceWord::writer(source_word(id))
                                                      : source_ | SourceWord::kLeft);
            for (const FrameId id : found_)
                set_maker(id, source_);
        });
        commit_ = nullptr;
        for (std::size_t i = 0; i < ids_.size(); ++i) {
            if (ids_[i] != kNoFrame) {
                names_[i].id = ids_[i];
                names_[i].born = store_.frames.born(ids_[i]);
            }
        }
        std::move(losing_.local.begin(), losing_.local.end(), std::back_inserter(lost_.local));
        std::move(losing_.disputed.begin(), losing_.disputed.end(),
                  std::back_inserter(lost_.disputed));
    }

    /// Whether a name of the sample gets no prefix.
    [[nodiscard]] bool is_shared(std::string_view name) const {
        return std::find(shared_.begin(), shared_.end(), name) != shared_.end();
    }
    [[nodiscard]] static Pose pose_of(const CommitSample::Row& row) {
        return std::bit_cast<Pose>(row.numbers);
    }
    [[nodiscard]] TransformView view_of(const CommitSample::Edge& edge,
                                        const CommitSample::Row& row) const {
        return {row.parent < names_.size() ? std::string_view(names_[row.parent].here) : "",
                names_[edge.child].here, row.stamp, pose_of(row)};
    }
    [[nodiscard]] const CommitSample::Edge& edge_of(std::size_t row) const {
        const auto behind =
            std::upper_bound(sample_->edges.begin(), sample_->edges.end(), row,
                             [](std::size_t at, const auto& edge) { return at < edge.rows.first; });
        return behind[-1];
    }
    void check_numbers(std::size_t i) const {
        const CommitSample::Row& row = sample_->rows[i];
        const Pose pose = pose_of(row);
        if (is_finite(pose.translation) && is_rotation(pose.rotation) && clock::is_stamp(row.stamp))
            [[likely]]
            return;
        const CommitSample::Edge& edge = edge_of(i);
        TransformView view = view_of(edge, row);
        if (view.parent.empty())
            view.parent = "(removed)";
        if (Fault fault = fault_alone(view, i, edge.is_static, authority_of(edge)))
            throw_fault(std::move(*fault));
    }
    [[noreturn]] static void throw_fault(Error fault) {
        Refusals refusals;
        refusals.add(std::move(fault));
        refusals.raise("a sample");
    }
    [[nodiscard]] std::string_view authority_of(const CommitSample::Edge& edge) const {
        return sample_->authorities[edge.authority];
    }
    /// Call once: numbers are stable.
    void number_authors() {
        while (authors_.size() < sample_->authorities.size())
            authors_.push_back(store_.author_number(sample_->authorities[authors_.size()]));
    }

    [[nodiscard]] FrameId find(std::uint32_t name) {
        if (ids_[name] == kNoFrame)
            ids_[name] = known(name);
        if (ids_[name] == kNoFrame)
            ids_[name] = commit_->find_frame(names_[name].here);
        return ids_[name];
    }
    /// The name's frame in an earlier commit, if it still exists.
    [[nodiscard]] FrameId known(std::uint32_t name) const {
        const auto& [there, here, id, born] = names_[name];
        const bool exists = id != kNoFrame && store_.frames.born(id) == born &&
                            store_.frames.alive(id, store_.committed()) && !removed_.contains(id);
        return exists ? id : kNoFrame;
    }
    [[nodiscard]] FrameId frame(std::uint32_t name) {
        if (ids_[name] == kNoFrame) {
            FrameId id = known(name);
            if (id == kNoFrame)
                id = commit_->frame(names_[name].here);
            ids_[name] = id;
            const std::uint64_t word = source_word(id);
            const bool is_left = (word & SourceWord::kLeft) != 0 || left_.contains(id);
            if (is_left || (SourceWord::maker(word) == 0 && !is_shared(sample_->names[name])))
                found_.push_back(id);
        }
        return ids_[name];
    }
    void set_maker(FrameId id, std::uint64_t maker) {
        sync::Word& word = store_.frames.word(id, history::kSource);
        word.store_relaxed(SourceWord::with_writer(maker, SourceWord::writer(word.load_relaxed())));
    }
    [[nodiscard]] history::EdgeWriter<StoreMemory> edge(FrameId id) const {
        return {store_.memory, store_.frames.header(id)};
    }
    [[nodiscard]] std::uint64_t source_word(FrameId id) const {
        return store_.frames.word(id, history::kSource).load_relaxed();
    }
    /// Whether its samples are the source's.
    [[nodiscard]] bool is_written_here(FrameId id) const {
        return SourceWord::writer(source_word(id)) == source_;
    }
    /// Whether another source stored its samples: it is shared.
    [[nodiscard]] bool is_written_by_other(FrameId id) const {
        const std::uint64_t writer = SourceWord::writer(source_word(id));
        return writer != 0 && writer != source_;
    }
    /// The other source whose prefix the frame has, if it stored the frame's samples.
    [[nodiscard]] std::optional<std::string> other_owner(FrameId id) const {
        auto owner = store_.writer_of(id);
        if (!owner || *owner == source_name_)
            return std::nullopt;
        const std::string prefix = store_.positions.prefix(store_.positions.find(*owner));
        return store_.names.name(id).starts_with(prefix) ? owner : std::nullopt;
    }

    void clear_edge(FrameId id) {
        if (edge(id).has_samples())
            mark_cleared(id);
    }
    /// Includes edges without samples; an edge that is cleared already is not cleared again.
    void mark_cleared(FrameId id, std::uint64_t author = 0) {
        const bool is_first = cleared_.insert(id);
        commit_->set_author(author);
        (void)commit_->touch(id);
        if (is_first)
            commit_->clear(id);
    }
    void clear(std::span<const std::uint32_t> names) {
        for (const std::uint32_t name : names) {
            const FrameId id = find(name);
            if (id != kNoFrame && (is_written_here(id) || !edge(id).has_samples()))
                mark_cleared(id);
        }
    }

    void remove(std::span<const std::uint32_t> names) {
        for (const std::uint32_t name : names) {
            const FrameId id = find(name);
            ids_[name] = kNoFrame;
            gone_[name] = id;
            if (id != kNoFrame)
                remove(id);
        }
    }
    /// A frame created by others, with samples of another source, or with children of others, stays
    /// without its samples of this source. It then belongs to the other source; without one, local
    /// writers may remove it. Of a shared frame, earlier children count too.
    void remove(FrameId id) {
        const bool is_ours = SourceWord::maker(source_word(id)) == source_;
        if (!is_ours || is_written_by_other(id) || has_foreign_child(id) || is_shared_parent(id)) {
            if (is_written_here(id))
                clear_edge(id);
            if (is_ours)
                left_.insert(id);
            return;
        }
        may_be_in_use_ |= store_.frames.word(id, history::kChildren).load_relaxed() != 0;
        commit_->remove(id);
        removed_.insert(id);
    }
    [[nodiscard]] bool has_foreign_child(FrameId id) const {
        if (store_.frames.word(id, history::kChildren).load_relaxed() == 0)
            return false;
        const StoreView view = store_.view(store_.committed());
        for (FrameId child = 0; child < store_.frames.count(); ++child) {
            if (view.alive(child) && !is_written_here(child) && newest_parent(child) == id)
                return true;
        }
        return false;
    }
    /// Whether the frame is shared, and a sample of another writer names it as parent.
    [[nodiscard]] bool is_shared_parent(FrameId id) {
        return !shared_.empty() && is_shared(store_.names.name(id)) &&
               parents_of_others().contains(id);
    }
    [[nodiscard]] FrameId newest_parent(FrameId id) const {
        return txn::newest_parent(store_.frames, id, store_.committed(), store_.history);
    }
    /// Creates and removes a frame that samples of others name.
    void pass(std::uint32_t name) {
        gone_[name] = commit_->find_frame(names_[name].here);
        if (gone_[name] != kNoFrame)
            return;
        gone_[name] = commit_->frame(names_[name].here);
        commit_->remove(gone_[name]);
        removed_.insert(gone_[name]);
    }

    /// The frames that samples of other writers name as parents, at any stamp. Samples that the
    /// commit has removed so far are the source's, so one visit per commit is enough.
    [[nodiscard]] const txn::FrameList& parents_of_others() {
        if (parents_)
            return *parents_;
        parents_.emplace();
        const StoreView view = store_.view(store_.committed());
        for (FrameId id = 0; id < store_.frames.count(); ++id) {
            Track track;
            if (!view.alive(id) || is_written_here(id) ||
                collect_all(view, id, track) != lookup::Outcome::kOk)
                continue;
            for (std::size_t i = 0; i < track.parents.size(); ++i) {
                if (view.alive_since(track.parents[i], track.commits[i]))
                    (void)parents_->insert(track.parents[i]);
            }
        }
        return *parents_;
    }

    /// Prepares for a state: removes the source's frames that the state lacks, and all its samples.
    /// A frame that lost its samples here and never had any in the state is a different frame. But
    /// a local writer may have removed its local parent: so it stays if samples of others name it.
    void take_away() {
        txn::FrameList stays;
        for (std::uint32_t name = 0; name < names_.size(); ++name) {
            const FrameId id = find(name);
            if (id == kNoFrame)
                continue;
            const bool is_bare = name < sample_->edges.size() &&
                                 sample_->edges[name].rows.count == 0 &&
                                 !sample_->edges[name].cleared;
            const bool has_samples = edge(id).has_samples();
            bool goes =
                is_bare && (has_samples ? is_written_here(id)
                                        : (edge(id).topology() & history::Topology::kCleared) != 0);
            if (goes && !has_samples)
                goes = !parents_of_others().contains(id);
            if (!goes)
                stays.insert(id);
        }
        const StoreView view = store_.view(store_.committed());
        std::vector<FrameId> goes;
        for (FrameId id = 0; id < store_.frames.count(); ++id) {
            if (!view.alive(id))
                continue;
            if (!stays.contains(id) && SourceWord::maker(source_word(id)) == source_)
                goes.push_back(id);
            else if (is_written_here(id))
                clear_edge(id);
        }
        for (const FrameId id : goes)
            remove(id);
        ids_.assign(names_.size(), kNoFrame);
    }

    void store_edge(const CommitSample::Edge& edge, std::uint64_t author) {
        const auto rows = sample_->rows_of(edge);
        const FrameId child = frame(edge.child);
        auto writer = this->edge(child);
        if (rows.empty()) {
            if (edge.cleared && !writer.has_samples())
                mark_cleared(child, author);
            return;
        }
        if (!written_.insert(child)) {
            const std::string& name = names_[edge.child].here;
            ErrorDetail detail;
            detail.edge = name;
            detail.reason = "a commit stores the edge twice";
            throw InvalidTransform("a commit stores the edge of frame " + quoted(name) + " twice",
                                   std::move(detail));
        }
        // The source clears an edge before it changes its kind; here another writer has changed it.
        if (writer.has_samples() && !cleared_.contains(child) &&
            (!is_written_here(child) || writer.is_static() != edge.is_static)) {
            if (const auto owner = other_owner(child))
                throw_owned(child, *owner);
            replace(child);
        }
        const StampNs newest = std::max(rows.back().stamp, writer.newest());
        // This store's history may be shorter.
        const auto is_too_old = [&](const CommitSample::Row& row) {
            return !edge.is_static && row.stamp < newest - store_.history;
        };
        if (is_too_old(rows.back()))
            return;  // a touched frame has a sample
        commit_->set_author(author);
        (void)commit_->touch(child);
        auto& samples = store_.samples;
        auto& items = store_.members;
        samples.clear();
        items.clear();
        for (std::size_t i = 0; i < rows.size(); ++i) {
            const CommitSample::Row& row = rows[i];
            if (is_too_old(row))
                continue;
            history::NewSample<StoreMemory> sample;
            sample.stamp = edge.is_static ? history::kStaticStamp : row.stamp;
            sample.parent = parent_of(row, edge);
            fill_payload(pose_of(row), sample);
            samples.push_back(sample);
            items.push_back(edge.rows.first + i);
        }
        if (samples.size() == 1)
            commit_->append(child, samples.front(), items.front());
        else
            commit_->append(child, std::span<const history::NewSample<StoreMemory>>(samples),
                            [&](std::size_t i) { return items[i]; });
    }
    void set_late(const CommitSample::Edge& edge) {
        const FrameId child = ids_[edge.child];
        const auto& late = store_.frames.word(child, history::kLate);
        const bool is_ours =
            !sample_->rows_of(edge).empty() || (edge.cleared && !this->edge(child).has_samples());
        if (!is_ours || late.load_relaxed() == edge.late)
            return;
        (void)commit_->touch(child);
        commit_->set_late(child, edge.late);
    }

    [[nodiscard]] FrameId parent_of(const CommitSample::Row& row, const CommitSample::Edge& edge) {
        if (!row.gone) {
            const FrameId parent = frame(row.parent);
            if (parent == ids_[edge.child])
                throw_fault(cycle_fault(view_of(edge, row), edge.rows.first, edge.is_static,
                                        authority_of(edge)));
            return parent;
        }
        may_be_in_use_ = true;
        if (sample_->kind == CommitSample::Kind::kState)
            return removed_parent();
        if (gone_[row.parent] == kNoFrame)
            gone_[row.parent] = removed_parent();
        return gone_[row.parent];
    }
    /// For samples whose parents were removed long ago: a frame that is created and removed.
    [[nodiscard]] FrameId removed_parent() {
        if (removed_parent_ == kNoFrame) {
            std::string name = "(removed)";
            while (commit_->find_frame(name) != kNoFrame)
                name += '_';
            removed_parent_ = commit_->frame(name);
            commit_->remove(removed_parent_);
            removed_.insert(removed_parent_);
        }
        return removed_parent_;
    }

    /// The frame named by the newest sample, even if the commit removes it.
    [[nodiscard]] FrameId named_parent(const StoreView& view, FrameId id) const {
        StoreEdge edge;
        if (!view.open(id, edge) || edge.empty())
            return kNoFrame;
        const auto slot = edge.read(edge.newest());
        return store_.frames.born(slot.parent) <= slot.commit ? slot.parent : kNoFrame;
    }
    /// Checks that no remaining frame has a removed parent.
    void check_removed() {
        if (!may_be_in_use_)
            return;
        const StoreView view = commit_->view();
        for (FrameId id = 0; id < store_.frames.count(); ++id) {
            if (!view.alive(id))
                continue;
            const FrameId parent = named_parent(view, id);
            if (parent != kNoFrame && removed_.contains(parent))
                throw_fault(frame_in_use(
                    store_.names.name(parent), 0, {store_.names.name(id)},
                    "source " + quoted(source_name_) +
                        " removes it: store another parent of these, or apply a state of the "
                        "source (state_bytes)"));
        }
    }
    /// A cycle loses the least of its edges that the source did not write.
    void break_cycles() {
        txn::Cycle cycle;
        for (;;) {
            FrameId least = kNoFrame;
            const bool found = commit_->cycles().find(cycle, [&](FrameId id) {
                if (weight(id) < weight(least))
                    least = id;
            });
            if (!found)
                return;
            if (least == kNoFrame)
                break;
            replace(least);
        }
        const CommitSample::Edge& edge = edge_of(cycle.item);
        throw_fault(cycle_fault(view_of(edge, sample_->rows[cycle.item]), cycle.item,
                                edge.is_static, authority_of(edge)));
    }
    /// The local parent of a frame of the source is less than one of another frame, and that is
    /// less than a shared edge of another source.
    [[nodiscard]] int weight(FrameId id) const {
        constexpr int kStays = 3;
        if (id == kNoFrame || is_written_here(id) || written_.contains(id))
            return kStays;
        if (store_.writer_of(id))
            return other_owner(id) ? kStays : 2;
        return SourceWord::maker(source_word(id)) == source_ ? 0 : 1;
    }
    void replace(FrameId child) {
        auto& losing = is_written_by_other(child) ? losing_.disputed : losing_.local;
        losing.push_back(store_.names.name(child));
        clear_edge(child);
    }
    [[noreturn]] void throw_owned(FrameId child, const std::string& owner) const {
        const std::string name = store_.names.name(child);
        throw InvalidArgument("frame " + quoted(name) + " comes from source " + quoted(owner) +
                              ": it must not be a shared frame (shared=) of source " +
                              quoted(source_name_));
    }

    Store& store_;
    std::string source_name_;
    std::string prefix_;
    std::vector<std::string> shared_;
    std::uint64_t shared_choice_ = 0;
    sync::Word record_{};
    bool is_checked_ = false;  // the record's prefix is this one
    std::vector<Name> names_;  // of the last sample
    // For the current sample:
    const CommitSample* sample_ = nullptr;
    /// The sample's selection of its source's frames. Samples with another choice belong to another
    /// copy.
    std::uint64_t choice_ = 0;
    std::vector<std::uint64_t> authors_;  // indexed by the sample's authorities
    LostParents lost_;                    // since `take_lost`
    // For the current commit:
    StoreCommit* commit_ = nullptr;
    std::uint64_t source_ = 0;
    std::vector<FrameId> ids_;    // by name
    std::vector<FrameId> gone_;   // by name: frames that the commit removed
    std::vector<FrameId> found_;  // that the source has now, and other writers created
    LostParents losing_;
    std::optional<txn::FrameList> parents_;  // see parents_of_others
    txn::FrameList left_;                    // that the source has no longer, and local writers use
    txn::FrameList cleared_;
    txn::FrameList removed_;
    txn::FrameList written_;
    FrameId removed_parent_ = kNoFrame;
    bool may_be_in_use_ = false;  // remaining frames may use removed ones
};

Position Applying::apply(std::span<const std::byte> data) {
    check_applies(store_);
    const txn::KeptByThread<CommitSample> kept;
    CommitSample& sample = *kept;
    sample.decode(data);
    start(sample);
    std::size_t next = 0;
    for (bool done = false; !done;) {
        const std::lock_guard guard(store_.lock);
        const std::optional<Position> position = checked_position();
        const ApplyOrder order(sample, choice_, source_name_, position);
        order.check();
        const bool goes_on = order.goes_on();
        if (goes_on && sample.last <= position->commit)
            return *position;
        const auto& commits = sample.commits;
        while (next < commits.size() && goes_on && commits[next].number <= position->commit)
            ++next;
        done = next + 1 >= commits.size();
        // The sample lacks commits that did not touch its frames.
        const CommitSample::Commit nothing{};
        commit(next < commits.size() ? commits[next] : nothing,
               done ? sample.last : commits[next + 1].number - 1);
    }
    return {source_name_, sample.epoch, sample.last, choice_, prefix_};
}

}  // namespace tfdb::store

namespace tfdb {

Position Buffer::apply(std::span<const std::byte> data, const ApplyOptions& options) {
    return Applier(*this, options).apply(data);
}

Applier::Applier(Buffer& buffer, const ApplyOptions& options)
    : applying_(std::make_unique<store::Applying>(*buffer.store_, options)) {}

Applier::~Applier() = default;

Position Applier::apply(std::span<const std::byte> data) {
    return applying_->apply(data);
}

LostParents Applier::take_lost() {
    return applying_->take_lost();
}

std::optional<Position> Applier::position() {
    return applying_->position();
}

}  // namespace tfdb
