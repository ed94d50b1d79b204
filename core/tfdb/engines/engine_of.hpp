// The engine of a store, built from its session type.
#pragma once

#include <algorithm>
#include <mutex>

#include "tfdb/engines/retry.hpp"
#include "tfdb/store/freshness.hpp"
#include "tfdb/store/question_resolver.hpp"
#include "tfdb/store/transaction_in.hpp"
#include "tfdb/store/writes.hpp"

namespace tfdb::store {

/// Lookups and batches in sessions of one kind.
/// Threads: any. Guarantee: as Engine's.
template <txn::Session S>
class EngineOf final : public Engine {
public:
    explicit EngineOf(store::Store& store, txn::LockRule rule = {})
        : store_(store), shared_(store.frames, store.history, rule) {}

    [[nodiscard]] lookup::Outcome read(Question& question, Answer& answer,
                                       Failure& failure) override {
        S session(shared_, {});
        CommitNumber as_of = 0;
        const lookup::Outcome outcome = txn::read_through(session, as_of, [&](const auto& view) {
            // During the session, names keep their meaning.
            const auto find = [&](std::string_view name) {
                return store_.names.find(name, view.commit());
            };
            const auto name_of = [&](FrameId id) { return store_.names.name(id); };
            const lookup::Outcome found =
                QuestionResolver(view, find, question).answer(answer, failure);
            return unless_stale(store_, view, name_of, question, found, failure);
        });
        answer.commit = as_of;
        failure.commit = as_of;
        return outcome;
    }

    [[nodiscard]] bool write(const Batch& batch, bool wait, CommitNumber& commit) override {
        if (!wait) {
            if constexpr (S::kWritesBesideOthers) {
                return false;  // any frame may be locked, and the gate closed
            } else {
                const std::unique_lock guard(shared_.lock, std::try_to_lock);
                if (guard.owns_lock())
                    commit = commit_batch(store_, batch);
                return guard.owns_lock();
            }
        }
        S session(shared_, {});
        commit = txn::write_through(
            session, [&](CommitNumber& number) { return try_beside(session, batch, number); },
            [&] { return commit_batch(store_, batch); });
        return true;
    }

    [[nodiscard]] std::unique_ptr<EngineTransaction> transaction(
        const TransactionOptions& options) override {
        txn::SessionOptions session;
        session.priority = options.priority;
        session.age = options.age;
        return std::make_unique<TransactionIn<S>>(store_, options.alone, shared_, session);
    }

    void keep_out() override {
        if constexpr (S::kWritesBesideOthers)
            shared_.gate.close();
    }
    void let_in() override {
        if constexpr (S::kWritesBesideOthers)
            shared_.gate.open();
    }
    [[nodiscard]] bool in_use() const override { return shared_.gate.in_use(); }
    void add_to(Counters& counters) const override {
        using sync::SlotCount;
        counters.retries += shared_.gate.total(SlotCount::kRetries);
        counters.lock_waits += shared_.gate.total(SlotCount::kLockWaits);
    }

private:
    using Item = txn::PlainBatch<StoreMemory>::Item;

    [[nodiscard]] txn::Written try_beside([[maybe_unused]] S& session,
                                          [[maybe_unused]] const Batch& batch,
                                          [[maybe_unused]] CommitNumber& number) {
        if constexpr (!S::kWritesBesideOthers) {
            return txn::Written::kNotPlain;
        } else {
            auto& plain = session.scratch().batch;
            if (!batch.sound() || batch.rules().any() || !fill(batch, plain))
                return txn::Written::kNotPlain;
            const std::uint64_t author = store_.authorities.id(batch.authority());
            return txn::write_beside(session, plain, store_, number, [&](const Item& item) {
                store_.set_author(item.child, author);
                if (item.normalised != 0)
                    store_.word(graph::kNormalised).fetch_add(item.normalised);
            });
        }
    }

    /// Fills in the batch's samples, sorted, the last of each stamp; false if a frame is unknown.
    /// Names keep their meaning while the session is in its slot.
    [[nodiscard]] bool fill(const Batch& batch, txn::PlainBatch<StoreMemory>& plain) {
        plain.order.clear();
        plain.items.clear();
        plain.frames.clear();
        for (std::size_t i = 0; i < batch.size(); ++i) {
            const FrameId parent = store_.names.find(batch[i].parent, txn::kSeesAll);
            const FrameId child = store_.names.find(batch[i].child, txn::kSeesAll);
            if (parent == kNoFrame || child == kNoFrame)
                return false;
            plain.order.push_back({child, parent, i});
        }
        const auto before = [&](const auto& a, const auto& b) {
            if (a.child != b.child)
                return a.child < b.child;
            const StampNs at_a = batch.is_static() ? 0 : batch[a.index].stamp;
            const StampNs at_b = batch.is_static() ? 0 : batch[b.index].stamp;
            return at_a != at_b ? at_a < at_b : a.index < b.index;
        };
        if (!std::is_sorted(plain.order.begin(), plain.order.end(), before))
            std::sort(plain.order.begin(), plain.order.end(), before);
        for (const auto& at : plain.order) {
            const bool is_new =
                plain.items.empty() || plain.items.back().child != at.child ||
                (!batch.is_static() && plain.items.back().sample.stamp != batch[at.index].stamp);
            Item& item = is_new ? plain.items.emplace_back() : plain.items.back();
            item.child = at.child;
            const bool normalised =
                fill_from(batch[at.index], at.parent, batch.is_static(), item.sample);
            item.normalised += normalised ? 1U : 0U;
            if (plain.frames.empty() || plain.frames.back() != at.child)
                plain.frames.push_back(at.child);
        }
        return true;
    }

    store::Store& store_;
    txn::SharedState<StoreMemory> shared_;
};

}  // namespace tfdb::store
