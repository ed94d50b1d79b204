#include "tfdb/store/sources.hpp"

#include <mutex>
#include <string>

#include "tfdb/store/writes.hpp"

namespace tfdb {
namespace {

using history::SourceWord;
using store::Store;

[[nodiscard]] bool has_samples(Store& store, FrameId id) {
    const history::EdgeWriter<StoreMemory> edge(store.memory, store.frames.header(id));
    return edge.has_samples();
}

/// Calls visit(id, word) for all frames, with their history::SourceWord.
template <class Visit>
void for_each_source_word(Store& store, Visit visit) {
    const StoreView view = store.view(store.committed());
    for (FrameId id = 0; id < store.frames.count(); ++id) {
        if (view.alive(id))
            visit(id, store.frames.word(id, history::kSource));
    }
}

/// Whether all frames and samples came from the source.
bool is_only_of(Store& store, std::uint64_t source) {
    bool only = true;
    for_each_source_word(store, [&](FrameId id, const sync::Word& word) {
        const std::uint64_t writer = has_samples(store, id) ? source : 0;
        only = only && word.load_relaxed() == SourceWord::pack(source, writer);
    });
    return only;
}

}  // namespace

void store::adopt(Store& store, std::uint64_t source) {
    for_each_source_word(store, [&](FrameId id, sync::Word& word) {
        const std::uint64_t before = word.load_relaxed();
        const std::uint64_t maker = SourceWord::maker(before);
        const std::uint64_t writer = SourceWord::writer(before);
        const std::uint64_t samples = has_samples(store, id) ? source : 0;
        word.store_relaxed(
            SourceWord::pack(maker == 0 ? source : maker, writer == 0 ? samples : writer));
    });
}

void store::check_applies(const Store& store) {
    if (store.engine != nullptr) {
        throw NotSupported("commits cannot be applied in the engine '" +
                           std::string(concurrency_name(store.concurrency)) +
                           "': only in the default one, 'snapshot'");
    }
    check_not_in_transaction(store);
}

bool Buffer::forget_source(std::string_view source) {
    store::check_applies(*store_);
    const std::lock_guard guard(store_->lock);
    store::Positions& positions = store_->positions;
    const store::Positions::Record record = positions.find(source);
    const auto position = record == 0 ? std::nullopt : positions.position(record);
    if (!position || position->epoch == Epoch{})
        return false;
    store_->start_commit().publish([&] { positions.forget(record); });
    return true;
}

std::optional<HandedOver> Buffer::hand_over(Handover how, const Position& to,
                                            const std::optional<Position>& from) {
    store::check_applies(*store_);
    const std::lock_guard guard(store_->lock);
    store::Positions& positions = store_->positions;
    store::Positions::Record record = positions.find(to.source);
    const auto position = record == 0 ? std::nullopt : positions.position(record);
    const bool was_home = position && position->choice == store::Positions::kReleased;
    if (how == Handover::kAdopt && position && to.epoch < position->epoch)
        return std::nullopt;
    if (from) {
        if (!position || position->epoch != from->epoch || position->commit != from->commit)
            return std::nullopt;
        if (how != Handover::kRelease && was_home != (how == Handover::kAdopt))
            return std::nullopt;
    }
    if (record == 0)
        record = positions.make(to.source, "");
    const std::uint64_t source = positions.number(record);
    StoreCommit commit = store_->start_commit_of(source);
    HandedOver done{commit.number(), true, commit.number() - 1};
    if (!was_home) {
        done.is_whole = is_only_of(*store_, source);
        done.last = position ? position->commit : 0;
    }
    CommitNumber at = to.commit;
    std::uint64_t choice = position ? position->choice : 0;
    if (how == Handover::kRelease) {
        at = done.commit;
        choice = store::Positions::kReleased;
    } else if (how == Handover::kAdopt) {
        at = done.commit - 1;
        choice = 0;
        store::adopt(*store_, source);
    }
    commit.publish([&] { positions.set(record, to.epoch, at, choice); });
    return done;
}

std::vector<Position> Buffer::positions() const {
    return store_->positions.all();
}

Epoch Buffer::epoch() const {
    return store_->epoch();
}

}  // namespace tfdb
