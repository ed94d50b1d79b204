// An attempt over any engine: its session, what was read and what was written.
#pragma once

#include <algorithm>
#include <utility>
#include <vector>

#include "tfdb/store/attempt.hpp"
#include "tfdb/store/attempt_errors.hpp"
#include "tfdb/store/validate.hpp"
#include "tfdb/store/writes.hpp"
#include "tfdb/txn/child_index.hpp"
#include "tfdb/txn/settle.hpp"
#include "tfdb/txn/transaction_view.hpp"

namespace tfdb::store {

/// What txn::settle needs of the store.
/// Threads: whoever is alone. Guarantee: as Impl's.
class CommitTools {
public:
    explicit CommitTools(Reads::Impl& impl) : impl_(impl) {}
    [[nodiscard]] StoreCommit start_commit() { return impl_.start_commit(); }
    [[nodiscard]] const graph::Frames<StoreMemory>& frames() const { return impl_.frames; }
    [[nodiscard]] StampNs history() const { return impl_.history; }
    void set_author(FrameId id, std::string_view authority) {
        impl_.frames.word(id, history::kAuthority).store_relaxed(impl_.authorities.id(authority));
    }

private:
    Reads::Impl& impl_;
};

/// A transaction in an engine's session.
/// Threads: one. Guarantee: strictly serializable where the session isolates.
template <txn::Session S>
class AttemptOf final : public Attempt {
public:
    /// `session`: what S is made from.
    template <class... Args>
    AttemptOf(Reads::Impl& impl, bool alone, Args&&... session)
        : impl_(impl), recording_(!alone), session_(std::forward<Args>(session)...) {
        session_.begin(alone ? txn::Mode::kAlone : txn::Mode::kBesideOthers);
    }

    [[nodiscard]] bool ask(const Question& question, Answer& answer, Failure& failure) override {
        const Outcome outcome = steadily([&](const View& view) {
            const Outcome found = answer_of(view, question, answer, failure);
            return found == Outcome::kFailed ? unless_reused(impl_, view.commit(), found) : found;
        });
        answer.commit = failure.commit = session_.read_as_of();
        return outcome == Outcome::kOk;
    }
    [[nodiscard]] bool has_frame(std::string_view name) override { return find(name) != kNoFrame; }
    [[nodiscard]] CommitNumber read_as_of() override { return session_.read_as_of(); }
    [[nodiscard]] std::string frame_name(FrameId id, std::uint32_t generation) const override {
        if (writes_.is_own(id) && generation == txn::kOwnGeneration)
            return writes_.name(id);
        if (id < impl_.frames.count()) {
            std::string name = impl_.names.name(id);
            sync::fence_acquire();
            if (impl_.frames.generation(id) == generation)
                return name;
        }
        return "(removed)";
    }
    [[nodiscard]] std::string frame_name(FrameId id) const override {
        if (id == kNoFrame)
            return {};
        return writes_.is_own(id) ? writes_.name(id) : impl_.names.name(id);
    }

    void write(std::span<const TransformView> batch, bool is_static,
               std::string_view authority) override {
        check(batch, is_static, authority);
        typename Writes::Sample own;
        own.authority = writes_.authority(authority);
        history::NewSample<StoreMemory> sample;
        for (const TransformView& transform : batch) {
            const FrameId parent = find_or_make(transform.parent);
            const FrameId child = find_or_make(transform.child);
            fill_sample(impl_, transform, parent, is_static, sample);
            own.stamp = sample.stamp;
            own.parent = parent;
            own.payload = sample.payload;
            const std::uint64_t known =
                writes_.is_own(child) ? history::Topology::kRoot : impl_.frames.topology(child);
            writes_.put(child, own, history::Topology::parent(known),
                        history::Topology::depth(view().topology(parent)));
        }
    }

    void remove_frame(std::string_view name, bool recursive) override {
        const FrameId id = find(name);
        if (id == kNoFrame)
            throw_frame_unknown(name);
        std::vector<FrameId> gone{id};
        for (std::size_t i = 0; i < gone.size(); ++i) {
            const std::vector<FrameId> children = children_of(gone[i]);
            if (!children.empty() && !recursive)
                throw_frame_in_use(name, children, names());
            gone.insert(gone.end(), children.begin(), children.end());
        }
        for (const FrameId frame : gone)
            writes_.remove(frame);
    }

    CommitNumber commit() override {
        CommitTools tools(impl_);
        const txn::Settled settled = txn::settle(session_, reads_, writes_, tools);
        if (settled.kind == txn::Settled::kCycle)
            throw_cycle_of(settled, writes_.authority_name(settled.authority), names());
        if (settled.kind == txn::Settled::kConflict) {
            if (settled.conflict)
                throw_conflict(settled.conflict, settled.commit, names());
            lose("another one came first");
        }
        return settled.commit;
    }
    void rollback() noexcept override { session_.end(false); }

private:
    using Outcome = lookup::Outcome;
    using View = txn::TransactionView<S>;
    using Writes = txn::WriteSet<StoreMemory>;
    static_assert(std::is_same_v<typename S::Memory, StoreMemory>);

    [[nodiscard]] View view() {
        return {session_.view(), impl_.names, impl_.history, writes_,
                recording_ ? &reads_ : nullptr};
    }
    [[nodiscard]] NameOf names() const {
        return [this](FrameId id) { return frame_name(id); };
    }
    [[noreturn]] void lose(std::string_view reason) {
        const CommitNumber since = session_.read_as_of();
        session_.end(false);
        throw_lost(reason, since);
    }

    /// Runs `attempt(view)` until no writer overtakes it.
    template <class Body>
    Outcome steadily(Body attempt) {
        Outcome outcome = Outcome::kLapped;
        for (int i = 0; i < kTriesBeforeLock && outcome == Outcome::kLapped; ++i)
            outcome = attempt(view());
        if constexpr (requires { session_.undisturbed([] {}); }) {
            if (outcome == Outcome::kLapped)
                session_.undisturbed([&] { outcome = attempt(view()); });
        }
        if (outcome == Outcome::kLapped)
            lose("what it reads was overwritten meanwhile");
        if (!session_.confirm())
            lose("what it has read has changed");
        return outcome;
    }

    [[nodiscard]] Outcome answer_of(const View& view, const Question& question, Answer& answer,
                                    Failure& failure) {
        const FrameId target = view.find(question.target);
        const FrameId source = view.find(question.source);
        switch (question.kind) {
            case Question::kAt:
                return lookup::lookup(view, target, source, question.stamp, question.policy, answer,
                                      failure);
            case Question::kLatest:
                return lookup::lookup_latest(view, target, source, question.max_age, question.now,
                                             answer, failure);
            case Question::kCommonTime:
                break;
        }
        return lookup::latest_common_time(view, target, source, answer, answer.stamp, failure);
    }

    [[nodiscard]] FrameId find(std::string_view name) {
        FrameId id = kNoFrame;
        (void)steadily([&](const View& view) {
            id = view.find(name);
            return id == kNoFrame ? unless_reused(impl_, view.commit(), Outcome::kOk)
                                  : Outcome::kOk;
        });
        return id;
    }
    [[nodiscard]] FrameId find_or_make(std::string_view name) {
        const FrameId found = find(name);
        return found != kNoFrame ? found : writes_.make(name);
    }

    /// Judges every member. Throws the first one's error, with all that are refused in it.
    void check(std::span<const TransformView> batch, bool is_static, std::string_view authority) {
        Refusals refusals;
        std::size_t unknown = 0;
        for (std::size_t i = 0; i < batch.size(); ++i) {
            const TransformView& transform = batch[i];
            Fault fault = fault_alone(transform, i, is_static, authority);
            const FrameId parent = find(transform.parent);
            const FrameId child = find(transform.child);
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
    /// New frames have ids from the top downward, until they meet those of the store.
    void check_room(std::size_t unknown) {
        if (unknown != 0 && writes_.made() + unknown + impl_.frames.count() > kMaxFrames)
            throw CapacityExceeded("a transaction cannot make so many frames: there is room for " +
                                   std::to_string(kMaxFrames) + " in all");
    }

    /// As fault_of_edge, of the edge as this transaction sees it.
    [[nodiscard]] Fault fault_of_own_edge(FrameId child, const TransformView& transform,
                                          std::size_t index, bool is_static,
                                          std::string_view authority) {
        bool written = false;
        bool was_static = false;
        StampNs newest = history::kNoStamp;
        (void)steadily([&](const View& view) {
            typename View::Edge edge;
            if (!view.open(child, edge))
                return Outcome::kLapped;
            written = edge.has_samples();
            was_static = edge.holds_static();
            if (!was_static && !edge.peek_newest(newest))
                return Outcome::kLapped;
            if (!edge.confirm(edge.lo()))
                return Outcome::kLapped;
            if (!written)
                edge.note_all();
            else if (!is_static)
                edge.note_used(transform.stamp);
            return Outcome::kOk;
        });
        if (written && was_static != is_static)
            return static_conflict(transform, index, is_static, authority);
        if (written && !is_static && transform.stamp < newest - impl_.history)
            return too_old(transform, index, newest, impl_.history, authority);
        return std::nullopt;
    }

    /// Those whose newest parent is the frame, as this transaction sees it.
    [[nodiscard]] std::vector<FrameId> children_of(FrameId id) {
        std::vector<FrameId> children = writes_.naming(id);
        if (!writes_.is_own(id)) {
            const std::vector<FrameId> stored = stored_children(id);
            children.insert(children.end(), stored.begin(), stored.end());
        }
        std::sort(children.begin(), children.end());
        children.erase(std::unique(children.begin(), children.end()), children.end());
        std::erase_if(children, [&](FrameId child) {
            return writes_.is_removed(child) ||
                   (writes_.edge(child) != nullptr && newest_parent(child) != id);
        });
        return children;
    }
    [[nodiscard]] FrameId newest_parent(FrameId child) {
        FrameId parent = kNoFrame;
        const Policy newest{lookup::PolicyKind::kLatest, lookup::kNoLimit};
        (void)steadily([&](const View& view) {
            return lookup::exact_parent(view, child, 0, newest, lookup::Edges::kAll, parent);
        });
        return parent;
    }
    /// By the store alone. That a frame has no children now is checked again at the end.
    [[nodiscard]] std::vector<FrameId> stored_children(FrameId id) {
        std::vector<FrameId> children;
        if (impl_.frames.word(id, history::kChildren).load_relaxed() != 0) {
            if (!indexed_ && !index_.build(impl_.view(session_.view().commit())))
                lose("what it reads was overwritten meanwhile");
            indexed_ = true;
            index_.append_children(id, children);
        }
        if (recording_)
            reads_.note_children(id, children);
        return children;
    }

    Reads::Impl& impl_;
    bool recording_;
    S session_;
    txn::ReadSet reads_;
    Writes writes_;
    txn::ChildIndex index_;  // of the state that is read
    bool indexed_ = false;
};

}  // namespace tfdb::store
