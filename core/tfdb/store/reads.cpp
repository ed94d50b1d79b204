// Lookups of a Buffer or a Snapshot, each from one state.
#include "tfdb/memory/file.hpp"
#include "tfdb/store/freshness.hpp"
#include "tfdb/store/question_resolver.hpp"
#include "tfdb/store/store.hpp"

namespace tfdb {

using lookup::Outcome;

namespace store {

void throw_unreadable(const Store& store, CommitNumber held) {
    const CommitNumber newest = store.committed();
    ErrorDetail detail;
    if (store.shared != nullptr && store.shared->frozen) {
        detail.path = store.shared->path;
        detail.reason = "damaged";
        throw CorruptStore("the frozen store " + memory::named(store.shared->path) +
                               " is damaged: its data contradict each other; freeze the recording "
                               "again",
                           std::move(detail));
    }
    if (held == kNewest) {
        detail.commit = newest;
        throw SnapshotTooOld("commit " + std::to_string(newest) +
                                 " was overwritten repeatedly while it was read: writers "
                                 "are faster than this reader, or the store's file is damaged; "
                                 "hold a snapshot, or create the store again",
                             std::move(detail));
    }
    detail.commit = held;
    throw SnapshotTooOld("snapshot " + std::to_string(held) +
                             " can no longer be read: its samples were overwritten (the store is "
                             "at commit " +
                             std::to_string(newest) +
                             "); take a new snapshot, or raise snapshot_memory",
                         std::move(detail));
}

bool ask(const Store& store, CommitNumber held, Question& question, Answer& answer,
         Failure& failure) {
    const Outcome outcome = read_committed(store, held, [&](const StoreView& view) {
        const auto find = [&](std::string_view name) {
            return store.names.find(name, view.commit());
        };
        const auto name_of = [&](FrameId id) { return store.names.name(id); };
        const Outcome found = QuestionResolver(view, find, question).answer(answer, failure);
        return unless_stale(store, view, name_of, question, found, failure);
    });
    if (outcome == Outcome::kLapped) {
        failure = Failure{};
        failure.code = ErrorCode::kSnapshotTooOld;
        failure.commit = held;
    }
    return outcome == Outcome::kOk;
}

}  // namespace store

CommitNumber StoreReader::commit() const {
    return held_ == store::kNewest ? store_->committed() : held_;
}

bool StoreReader::is_current(FrameHandle handle) const noexcept {
    return handle.id < store_->frames.count() &&
           store_->frames.generation(handle.id) == handle.generation;
}

bool StoreReader::find_frame(std::string_view name, FrameHandle& out) const {
    // Only commits that run alone create and remove frames, so this needs no engine.
    const auto attempt = [&](const StoreView& view) {
        out.id = store_->names.find(name, view.commit());
        if (out.id == kNoFrame)
            return Outcome::kFailed;
        out.generation = view.generation(out.id);
        // The slot may have been reused between the two reads.
        return view.alive(out.id) ? Outcome::kOk : Outcome::kLapped;
    };
    const Outcome outcome = store::read_committed(*store_, held_, attempt);
    if (outcome == Outcome::kLapped)
        store::throw_unreadable(*store_, held_);
    return outcome == Outcome::kOk;
}

bool StoreReader::ask(Question& question, Answer& answer, Failure& failure) const {
    if (held_ == store::kNewest && store_->engine != nullptr) [[unlikely]] {
        store::check_not_in_transaction(*store_);
        return store_->engine->read(question, answer, failure) == Outcome::kOk;
    }
    return store::ask(*store_, held_, question, answer, failure);
}

}  // namespace tfdb
