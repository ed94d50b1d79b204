// A transaction in an engine's session, with frame names and typed errors.
#pragma once

#include <algorithm>
#include <type_traits>
#include <unordered_set>
#include <utility>
#include <vector>

#include "tfdb/store/collect.hpp"
#include "tfdb/store/engine_transaction.hpp"
#include "tfdb/store/freshness.hpp"
#include "tfdb/store/nearest.hpp"
#include "tfdb/store/path_stamps.hpp"
#include "tfdb/store/question_resolver.hpp"
#include "tfdb/store/raise.hpp"
#include "tfdb/store/validate.hpp"
#include "tfdb/store/velocity.hpp"
#include "tfdb/store/writes.hpp"
#include "tfdb/txn/commit_transaction.hpp"
#include "tfdb/txn/workspace.hpp"

namespace tfdb::store {

/// A transaction in an engine's session.
/// Threads: one. Guarantee: strictly serializable where the session isolates.
template <txn::Session S>
class TransactionIn final : public EngineTransaction, private txn::Workspace<S> {
public:
    /// `session`: arguments of S.
    template <class... Args>
    TransactionIn(Store& store, bool alone, Args&&... session)
        : Workspace(store.frames, store.history,
                    alone ? txn::Mode::kAlone : txn::Mode::kBesideOthers,
                    std::forward<Args>(session)...),
          store_(store) {}

    [[nodiscard]] bool ask(Question& question, Answer& answer, Failure& failure) override {
        const bool found = answered(failure, [&](const View& view) {
            const auto find = [&](std::string_view name) { return view.find(name); };
            const Outcome outcome = QuestionResolver(view, find, question).answer(answer, failure);
            return unless_stale(store_, view, names(), question, outcome, failure);
        });
        answer.commit = failure.commit;
        return found;
    }
    [[nodiscard]] bool has_frame(std::string_view name) override { return find(name) != kNoFrame; }
    [[nodiscard]] std::optional<std::string> parent_of(std::string_view name,
                                                       std::optional<StampNs> stamp) override {
        std::optional<std::string> found;
        read_frame(name, [&](const View& view, FrameId id) {
            FrameId parent = kNoFrame;
            const Outcome read = lookup::parent_at(view, id, stamp, parent);
            found.reset();
            if (parent == kNoFrame)
                return this->unless_reused(view, read);
            found = frame_name(parent);
            // Its slot may have been reused before its name was read.
            StoreMemory::fence_acquire();
            return view.alive(parent) ? read : Outcome::kLapped;
        });
        return found;
    }
    [[nodiscard]] bool velocity(const VelocityQuestion& question, Twist& twist, Asked& asked,
                                Failure& failure) override {
        return answered(failure, [&](const View& view) {
            const auto find = [&](std::string_view name) { return view.find(name); };
            const auto judge = [&](FrameId target, FrameId source) {
                return path_unless_stale(store_, view, names(), target, source, failure);
            };
            return velocity_at(view, find, judge, question, twist, asked, failure);
        });
    }
    [[nodiscard]] bool path_stamps(std::string_view target, std::string_view source,
                                   std::optional<StampNs> start, std::optional<StampNs> end,
                                   std::vector<StampNs>& stamps, Failure& failure) override {
        return answered(failure, [&](const View& view) {
            return store::path_stamps(view, view.find(target), view.find(source), start, end,
                                      stamps, failure);
        });
    }
    [[nodiscard]] std::vector<std::string> all_frames() override {
        std::vector<std::string> names;
        for (FrameInfo& info :
             collected([](const View&, FrameId, FrameInfo&) { return Outcome::kOk; }))
            names.push_back(std::move(info.name));
        return names;
    }
    [[nodiscard]] FrameInfo frame_info(std::string_view name) override {
        FrameInfo info;
        read_frame(name, [&](const View& view, FrameId id) { return fill(view, id, info); });
        return info;
    }
    [[nodiscard]] std::vector<FrameInfo> tree(std::optional<StampNs> stamp) override {
        return collected([&](const View& view, FrameId id, FrameInfo& info) {
            const Outcome filled = fill(view, id, info);
            if (filled != Outcome::kOk || !stamp)
                return filled;
            FrameId parent = kNoFrame;
            const Outcome found = lookup::parent_at(view, id, stamp, parent);
            info.parent.reset();
            if (parent != kNoFrame)
                info.parent = frame_name(parent);
            return found;
        });
    }
    [[nodiscard]] Samples samples(std::string_view name) override {
        Samples out;
        read_frame(name, [&](const View& view, FrameId id) {
            out = Samples{};
            Track track;
            const Outcome collected = collect_all(view, id, track);
            out.stamps = std::move(track.stamps);
            if (track.is_static)
                out.stamps.assign(1, history::kNoStamp);
            out.poses = std::move(track.poses);
            for (std::size_t i = 0; i < track.parents.size(); ++i) {
                const bool known = view.alive_since(track.parents[i], track.commits[i]);
                out.parents.push_back(known ? frame_name(track.parents[i]) : std::string());
            }
            return confirmed(view, id, collected);
        });
        return out;
    }
    [[nodiscard]] CommitNumber read_as_of() override { return this->session().read_as_of(); }
    [[nodiscard]] std::string frame_name(FrameId id, std::uint32_t generation) const override {
        if (this->writes().is_own(id) && generation == txn::kOwnGeneration)
            return this->writes().name(id);
        return name_of_frame(store_, id, generation);
    }
    [[nodiscard]] std::string did_you_mean(std::string_view name,
                                           CommitNumber commit) const override {
        return store::did_you_mean(store_, commit, name, this->writes().removed(),
                                   this->writes().names());
    }

    void write(std::span<const TransformView> batch, bool is_static,
               std::string_view authority) override {
        check(batch, is_static, authority);
        typename Workspace::Writes::Sample own;
        own.authority = this->writes().authority(authority);
        history::NewSample<StoreMemory> sample;
        for (std::size_t i = 0; i < batch.size(); ++i) {
            auto [parent, child] = found_[i];
            if (parent == kNoFrame)
                parent = find_or_make(batch[i].parent);
            if (child == kNoFrame)
                child = find_or_make(batch[i].child);
            fill_sample(store_, batch[i], parent, is_static, sample);
            own.stamp = sample.stamp;
            own.parent = parent;
            own.payload = sample.payload;
            this->put(child, own);
        }
    }

    void remove_frames(std::span<const std::string_view> names, bool recursive) override {
        Refusals refusals;
        std::vector<FrameId> gone;
        std::vector<std::size_t> places;  // index in `names` of each removed one
        std::unordered_set<FrameId> seen;
        for (std::size_t i = 0; i < names.size(); ++i) {
            const FrameId id = find(names[i]);
            if (id == kNoFrame) {
                refusals.add(unknown_frame(
                    names[i], i,
                    refusals.empty() ? did_you_mean(names[i], read_as_of()) : std::string()));
            } else if (seen.insert(id).second) {
                gone.push_back(id);
                places.push_back(i);
            }
        }
        std::vector<FrameId> children;
        for (std::size_t i = 0; i < gone.size(); ++i) {
            (void)needed(this->children_of(gone[i], children));
            // Before the commit has validated them, own relations may form a cycle.
            std::erase_if(children, [&](FrameId child) { return seen.contains(child); });
            if (recursive) {
                seen.insert(children.begin(), children.end());
                gone.insert(gone.end(), children.begin(), children.end());
            } else if (!children.empty()) {
                const bool is_own = this->writes().is_own(gone[i]);
                refusals.add(used_frame(names[places[i]], places[i],
                                        is_own ? std::nullopt : store_.remover_of(gone[i]),
                                        names_of(children)));
            }
        }
        if (!refusals.empty())
            refusals.raise(std::to_string(names.size()) + " frames");
        for (const FrameId frame : gone)
            this->writes().remove(frame);
    }

    void clear() override { this->writes().clear_moving(); }

    CommitNumber commit() override {
        const txn::CommitOutcome outcome =
            txn::commit_transaction(this->session(), this->reads(), this->writes(), store_);
        if (outcome.kind == txn::CommitOutcome::kCycle)
            throw_cycle_of(outcome, this->writes().authority_name(outcome.authority), names());
        if (outcome.kind == txn::CommitOutcome::kConflict) {
            if (outcome.conflict)
                throw_conflict(outcome.conflict, outcome.commit, names());
            throw_lost("another transaction committed first", outcome.commit);
        }
        return outcome.commit;
    }
    void rollback() noexcept override { this->session().end(false); }

private:
    using Outcome = lookup::Outcome;
    using Workspace = txn::Workspace<S>;
    using View = typename Workspace::View;
    static_assert(std::is_same_v<typename S::Memory, StoreMemory>);

    [[nodiscard]] std::string frame_name(FrameId id) const {
        if (id == kNoFrame)
            return {};
        return this->writes().is_own(id) ? this->writes().name(id) : store_.names.name(id);
    }
    [[nodiscard]] NameOf names() const {
        return [this](FrameId id) { return frame_name(id); };
    }
    [[nodiscard]] std::vector<std::string> names_of(std::span<const FrameId> frames) const {
        std::vector<std::string> names;
        for (const FrameId frame : frames)
            names.push_back(frame_name(frame));
        return names;
    }
    /// The same, unless the frame's slot may have been reused during the read.
    [[nodiscard]] Outcome confirmed(const View& view, FrameId id, Outcome outcome) const {
        StoreMemory::fence_acquire();
        return view.alive(id) ? this->unless_reused(view, outcome) : Outcome::kLapped;
    }
    /// Fills in the data of a frame, except its name.
    [[nodiscard]] Outcome fill(const View& view, FrameId id, FrameInfo& info) const {
        const auto* const own = this->writes().edge(id);
        info = FrameInfo{};
        if (own != nullptr)
            info.authority = this->writes().author_of(*own);
        else if (!this->writes().is_own(id))
            info.authority = store_.author(id);
        if (!this->writes().is_own(id))
            info.late = store_.frames.word(id, history::kLate).load_relaxed();
        if (own != nullptr) {
            typename View::Edge edge;
            if (!view.open(id, edge))
                return Outcome::kLapped;
            info.late += edge.own_late();
            if (!edge.confirm())
                return Outcome::kLapped;
        }
        Outline outline;
        const Outcome outcome = store::outline(view, id, outline);
        fill_from(outline, info);
        if (outline.parent != kNoFrame && view.alive_since(outline.parent, outline.named))
            info.parent = frame_name(outline.parent);
        info.name = frame_name(id);
        return confirmed(view, id, outcome);
    }
    /// All frames, sorted by name, each with the result of `look(view, id, info)`.
    template <class Look>
    [[nodiscard]] std::vector<FrameInfo> collected(Look look) {
        std::vector<FrameInfo> infos;
        (void)needed(this->for_each_frame([&] { infos.clear(); },
                                          [&](const View& view, FrameId id) {
                                              FrameInfo& info = infos.emplace_back();
                                              const Outcome found = look(view, id, info);
                                              info.name = frame_name(id);
                                              return confirmed(view, id, found);
                                          }));
        std::sort(infos.begin(), infos.end(),
                  [](const FrameInfo& a, const FrameInfo& b) { return a.name < b.name; });
        return infos;
    }
    /// Whether `body(view)` has an answer; sets the commit of `failure`. Throws Conflict.
    template <class Body>
    [[nodiscard]] bool answered(Failure& failure, Body body) {
        const Outcome outcome = needed(this->steadily([&](const View& view) {
            const Outcome found = body(view);
            return found == Outcome::kFailed ? this->unless_reused(view, found) : found;
        }));
        failure.commit = read_as_of();
        return outcome == Outcome::kOk;
    }
    /// Runs `body(view, id)` on the frame of that name. Throws Conflict, UnknownFrame.
    template <class Body>
    void read_frame(std::string_view name, Body body) {
        const Outcome outcome = needed(this->steadily([&](const View& view) {
            const FrameId id = view.find(name);
            return id == kNoFrame ? this->unless_reused(view, Outcome::kFailed) : body(view, id);
        }));
        if (outcome == Outcome::kFailed)
            throw_unknown_frame(name, read_as_of(), did_you_mean(name, read_as_of()));
    }
    /// Throws Conflict if the transaction has a conflict.
    Outcome needed(Outcome outcome) {
        if (outcome == Outcome::kLapped)
            throw_lost("the data that it read were changed or overwritten", read_as_of());
        return outcome;
    }

    [[nodiscard]] FrameId find(std::string_view name) {
        FrameId id = kNoFrame;
        (void)needed(Workspace::find(name, id));
        return id;
    }
    [[nodiscard]] FrameId find_or_make(std::string_view name) {
        const FrameId found = find(name);
        return found != kNoFrame ? found : this->writes().make(name);
    }

    /// Validates every member. Throws the first one's error, which lists all rejected members.
    void check(std::span<const TransformView> batch, bool is_static, std::string_view authority) {
        Refusals refusals;
        std::size_t unknown = 0;
        found_.clear();
        for (std::size_t i = 0; i < batch.size(); ++i) {
            const TransformView& transform = batch[i];
            Fault fault = fault_alone(transform, i, is_static, authority);
            const FrameId parent = find(transform.parent);
            const FrameId child = find(transform.child);
            found_.emplace_back(parent, child);
            if (!fault && (parent == kNoFrame || child == kNoFrame))
                fault = fault_of_names(transform, i, authority);
            if (!fault && child != kNoFrame)
                fault = fault_of_own_edge(child, transform, i, is_static, authority);
            refusals.add(std::move(fault));
            unknown += (parent == kNoFrame ? 1U : 0U) + (child == kNoFrame ? 1U : 0U);
        }
        if (!refusals.empty())
            refusals.raise(std::to_string(batch.size()) + " transforms");
        check_room(unknown);
    }
    /// New frames get ids from the top downward, until they meet those of the store.
    void check_room(std::size_t unknown) {
        if (unknown != 0 && this->writes().made() + unknown + store_.frames.count() > kMaxFrames)
            throw CapacityExceeded("the transaction makes too many frames: a store has at most " +
                                   std::to_string(kMaxFrames));
    }

    /// As fault_of_edge, for the edge as this transaction sees it.
    [[nodiscard]] Fault fault_of_own_edge(FrameId child, const TransformView& transform,
                                          std::size_t index, bool is_static,
                                          std::string_view authority) {
        txn::EdgeKind kind;
        const StampNs stamp = is_static ? history::kStaticStamp : transform.stamp;
        (void)needed(this->look_at(child, stamp, kind));
        if (!kind.written)
            return std::nullopt;
        if (kind.is_static != is_static)
            return static_conflict(transform, index, is_static, authority);
        if (!is_static && transform.stamp < kind.newest - store_.history)
            return too_old(transform, index, kind.newest, store_.history, authority);
        return std::nullopt;
    }

    Store& store_;
    std::vector<std::pair<FrameId, FrameId>> found_;  // parents and children of a batch
};

}  // namespace tfdb::store
