#include "tfdb/store/store.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <new>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "tfdb/store/validate.hpp"
#include "tfdb/store/waits.hpp"
#include "tfdb/txn/repair.hpp"

namespace tfdb::store {
namespace {

/// A new store begins its own epoch: later stores have greater numbers.
void begin_life(StoreMemory& memory) {
    const auto word = [&](graph::StoreWord w) -> sync::Word& {
        return memory.word(StoreMemory::root() + 8 * w);
    };
    std::random_device random;
    const auto random_word = [&] { return std::uint64_t{random()} << 32 | random(); };
    const auto now = std::chrono::system_clock::now().time_since_epoch();
    word(graph::kLifeNumber)
        .store_relaxed(static_cast<std::uint64_t>(
            std::chrono::duration_cast<std::chrono::nanoseconds>(now).count()));
    word(graph::kLifeHigh).store_relaxed(random_word());
    word(graph::kLifeLow).store_relaxed(random_word());
}

}  // namespace

graph::Frames<StoreMemory> Store::forest_in(StoreMemory& memory, const BufferOptions& options) {
    const Offset root = StoreMemory::root();
    const auto word = [&](graph::StoreWord w) -> sync::Word& { return memory.word(root + 8 * w); };
    if (memory.is_new()) {
        (void)memory.allocate(graph::kStoreBytes);
        word(graph::kMaxFrameCount).store_relaxed(options.max_frames);
        const Offset block = memory.allocate_sparse(
            StoreFeed::kBytes + graph::Frames<StoreMemory>::bytes(options.max_frames));
        memory.touch(block, StoreFeed::kBytes, true);
        word(graph::kFrameTable).store_relaxed(block + StoreFeed::kBytes);
        word(graph::kHistory)
            .store_relaxed(history::as_word(options.history_ns.value_or(history::kForever)));
        word(graph::kSnapshotMemory).store_relaxed(options.snapshot_memory);
        begin_life(memory);
        // Engines with parallel writers keep no feed.
        if (options.concurrency == Concurrency::kSnapshot ||
            options.concurrency == Concurrency::kGiant)
            StoreFeed::put_into({memory, root, block + StoreFeed::kBytes, options.max_frames},
                                block);
    }
    const std::uint64_t most = word(graph::kMaxFrameCount).load_relaxed();
    const Offset table = word(graph::kFrameTable).load_relaxed();
    const StampNs kept = history::as_stamp(word(graph::kHistory).load_relaxed());
    const Offset feed = word(graph::kFeed).load_relaxed();
    const bool sound = memory.end() > root && most > 0 && most <= kMaxFrames && table > root &&
                       table <= memory.capacity() &&
                       graph::Frames<StoreMemory>::bytes(static_cast<std::uint32_t>(most)) <=
                           memory.capacity() - table &&
                       (feed == 0 || feed + StoreFeed::kBytes == table) &&
                       word(graph::kFrameCount).load_relaxed() <= most && kept > 0;
    if (!sound)
        throw CorruptStore("the store is damaged: its header is invalid");
    return {memory, root, table, static_cast<std::uint32_t>(most)};
}

std::uint64_t Store::layout() {
    using Sizes = history::Tuning<StoreMemory>;
    constexpr std::uint64_t kVersion = 4;
    std::uint64_t layout = kVersion;
    for (const std::uint64_t part :
         {std::uint64_t{history::kHeaderWords}, std::uint64_t{graph::kStoreWords},
          std::uint64_t{StoreMemory::kPayloadWords}, std::uint64_t{memory::kSizeClasses},
          std::uint64_t{Sizes::kFullLog2}, std::uint64_t{Sizes::kLargestLog2},
          std::uint64_t{Sizes::kFanLog2}})
        layout = layout * 4099 + part;
    return layout;
}

Store::Store(const BufferOptions& options) : Store(nullptr, options) {}

Store::Store(memory::SharedFile file)
    : Store(std::make_unique<memory::SharedFile>(std::move(file)), {}) {}

Store::Store(std::unique_ptr<memory::SharedFile> file, const BufferOptions& options)
    : shared(std::move(file)),
      commit_event(has_control() ? shared->control->commit_event() : own_commit_event),
      clock_words(has_control() ? shared->control->clock() : own_clock_words.data()),
      clock_event(has_control() ? shared->control->clock_event() : own_clock_event),
      memory(shared == nullptr ? memory::Mapping::reserve() : std::move(shared->data),
             options.memory_limit.value_or(StoreMemory::kNoLimit)),
      frames(forest_in(memory, options)),
      history(history::as_stamp(word(graph::kHistory).load_relaxed())),
      snapshot_memory(word(graph::kSnapshotMemory).load_relaxed()),
      concurrency(options.concurrency),
      names(frames),
      held_pins(frames, graph::kHeldPins),
      read_pins(frames, graph::kReadPins),
      lock(shared == nullptr ? word(graph::kCommitLock) : process_lock, commit_event, shared.get(),
           *this),
      authorities(memory, word(graph::kAuthorities)),
      positions(memory, word(graph::kPositions), word(graph::kCommit)),
      engine(make_engine(*this)) {
    sync::watch_forks();
    home_process.store_relaxed(sync::forks() << kForksShift);
    if (shared != nullptr)
        join();
}

/// Publishes where writers find this process's pins.
void Store::join() {
    note_reads();
    sync::add_fork_watcher(*this);
}

void Store::forked() noexcept {
    if (shared->control != nullptr && shared->control->take_own_slot())
        note_reads();
}

void Store::note_reads() {
    if (shared->control == nullptr)
        unseen_pins = std::make_unique<std::array<sync::Word, 2 * graph::kPinWords>>();
    sync::Word* const pins = unseen_pins != nullptr ? unseen_pins->data() : shared->control->pins();
    static_assert(memory::Control::kProcessWord == 2 * graph::kPinWords - 1, "pins leave that");
    using Pins = graph::Pins<StoreMemory>;
    Pins::begin(
        [&](unsigned w) -> auto& { return pins[w]; }, committed());
    Pins::begin(
        [&](unsigned w) -> auto& { return pins[graph::kPinWords + w]; },
        word(graph::kEpoch).load_acquire());
    memory.set_pins(pins);
}

Store::~Store() {
    if (shared != nullptr)
        sync::remove_fork_watcher(*this);
    delete waits_here.load_acquire();
}

Waits& Store::waits() const {
    Waits* found = waits_here.load_acquire();
    // A child leaves its parent's waits unchanged: their threads do not exist here.
    if (found != nullptr && found->forks() == sync::forks())
        return *found;
    auto made = std::make_unique<Waits>(*this, commit_event);
    return waits_here.compare_exchange(found, made.get()) ? *made.release() : *found;
}

std::uint64_t Store::check_locks_at_fork(std::uint64_t home) const {
    std::uint64_t judged = sync::forks() << kForksShift;
    if (lock.in_use() || authorities.in_use() || (engine != nullptr && engine->in_use()))
        judged |= kOrphan;
    if (authorities.in_use())
        judged |= kNamesLost;
    // The second thread takes the first one's result.
    return home_process.compare_exchange(home, judged) ? judged : home;
}

void Store::throw_orphaned() const {
    ErrorDetail detail;
    detail.reason = "forked";
    throw Forked("this process was forked while a thread of its parent used the store: this copy " +
                     std::string(engine == nullptr ? "can be read, but not written to"
                                                   : "cannot be used any more") +
                     "; make a Buffer in this process, or fork while no thread uses the store",
                 std::move(detail));
}

std::string Store::author_name(std::uint64_t number) const {
    if ((fork_state() & kNamesLost) != 0)
        throw_orphaned();
    return authorities.name(number);
}

std::string Store::author(FrameId id) const {
    return author_name(frames.word(id, history::kAuthority).load_acquire());
}

Epoch Store::epoch() const {
    return {word(graph::kLifeNumber).load_relaxed(), word(graph::kLifeHigh).load_relaxed(),
            word(graph::kLifeLow).load_relaxed()};
}

StoreCommit Store::start_commit(std::string_view authority) {
    return {frames, scratch, history, *this, authorities.id(authority), local()};
}

std::optional<std::string> Store::remover_of(FrameId id) const {
    if (positions.empty()) [[likely]]
        return std::nullopt;
    const std::uint64_t word = frames.word(id, history::kSource).load_relaxed();
    const bool is_left = (word & history::SourceWord::kLeft) != 0;
    auto found = is_left ? std::nullopt : owner(history::SourceWord::maker(word));
    return found ? found : owner(history::SourceWord::writer(word));
}

void Store::check_writable(const StoreCommit& commit) const {
    if (positions.empty()) [[likely]]
        return;
    commit.for_each_change([&](FrameId id, bool removed) {
        if (const auto source = removed ? remover_of(id) : writer_of(id)) {
            throw read_only_frame(names.name(id), {}, *source);
        }
    });
}

bool Store::keeps_too_much() const {
    constexpr std::size_t kKept = history::Tuning<StoreMemory>::kKept;
    const std::size_t replaced = memory.retired_bytes(memory::Line::kReplaced);
    // Deaths may leave it negative.
    const auto noted = static_cast<std::int64_t>(word(graph::kHeldBytes).load_relaxed());
    const std::size_t held = static_cast<std::size_t>(std::max<std::int64_t>(noted, 0)) +
                             memory.retired_bytes(memory::Line::kEnded) +
                             (replaced > kKept ? replaced - kKept : 0);
    return held > snapshot_memory;
}

/// Over all processes; `first`: the pin words to read in their slots.
CommitNumber Store::oldest_pinned(const graph::Pins<StoreMemory>& mine, unsigned first,
                                  CommitNumber newest) const {
    CommitNumber oldest = mine.oldest(newest);
    if (shared == nullptr) [[likely]]
        return oldest;
    const memory::Control& control = *shared->control;
    for (unsigned i = 0; i < control.slots(); ++i) {
        sync::Word* const words = control.slot(i) + first;
        if (words == control.pins() + first)
            continue;
        const CommitNumber theirs = graph::Pins<StoreMemory>::oldest_of(
            [&](unsigned w) -> auto& { return words[w]; }, newest);
        if (theirs < oldest && !control.free_if_dead(i))
            oldest = theirs;
    }
    return oldest;
}

CommitNumber Store::oldest_read() {
    const CommitNumber newest = committed();
    auto& given_up = word(graph::kGivenUp);
    if (keeps_too_much())
        given_up.store_relaxed(newest);
    return std::max<CommitNumber>(oldest_pinned(held_pins, 0, newest), given_up.load_relaxed());
}

std::uint64_t Store::begin_epoch() {
    const std::uint64_t epoch = word(graph::kEpoch).fetch_add(1) + 1;
    return keeps_too_much() ? epoch : oldest_pinned(read_pins, graph::kPinWords, epoch);
}

/// Whether to sweep for blocks lost by deaths. A few deaths lose few blocks; a sweep takes longer
/// than anything else, and drops older held states.
bool Store::must_sweep(std::uint64_t deaths, bool died_in_memory) const {
    constexpr std::uint64_t kDeathsBetweenSweeps = 64;
    const bool many = deaths >= kDeathsBetweenSweeps;
    const bool is_short = memory.is_short();
    if (!many && !is_short && !died_in_memory)
        return false;
    const CommitNumber newest = committed();
    return (many && is_short) || oldest_pinned(held_pins, 0, newest) >= newest;
}

void Store::repair() noexcept {
    sync::Word& deaths = shared->control->deaths();
    const bool died_in_memory = memory.repair();
    txn::Repair<StoreMemory>(frames, history, *this).run();
    positions.repair();
    const CommitNumber newest = committed();
    const std::uint64_t source = positions.empty() ? local() : positions.source_of(newest);
    StoreFeed(frames).visit_newest(newest, [&](std::uint64_t note) {
        const FrameId id = txn::FeedNote::id(note);
        if (id < frames.count() && frames.alive(id, newest))
            txn::set_writer(frames, id, txn::FeedNote::what(note), txn::FeedNote::count(note) != 0,
                            txn::FeedNote::authority(note), source);
    });
    const std::uint64_t died = deaths.load_relaxed() + 1;
    if (must_sweep(died - shared->control->swept_deaths().load_relaxed(), died_in_memory)) {
        try {
            sweep(word(graph::kEpoch).fetch_add(1) + 1);
            shared->control->swept_deaths().store_relaxed(died);
        } catch (const std::bad_alloc&) {
            // Nothing was freed: one of the next deaths tries again
        }
    }
    deaths.store_relaxed(died);
}

void Store::sweep(std::uint64_t epoch) {
    std::vector<StoreMemory::Block> in_use;
    const auto visit = [&](Offset offset, std::size_t bytes) { in_use.push_back({offset, bytes}); };
    std::uint64_t held = 0;
    visit(StoreMemory::root(), graph::kStoreBytes);
    names.visit_blocks(visit);
    authorities.visit_blocks(visit);
    positions.visit_blocks(visit);
    for (FrameId id = 0; id < frames.count(); ++id) {
        history::EdgeSegments<StoreMemory>(memory, frames.header(id))
            .visit_blocks(visit, [&](std::uint64_t bytes) { held += bytes; });
        if (frames.word(id, history::kDied).load_relaxed() != 0)
            held += StoreCommit::kFrameBytes;
    }
    word(graph::kGivenUp).store_relaxed(committed());
    memory.sweep(std::move(in_use), epoch, committed());
    word(graph::kHeldBytes).store_relaxed(held);
}

bool Store::compact() {
    const CommitNumber newest = committed();
    if (oldest_pinned(held_pins, 0, newest) < newest)
        return false;
    {
        StoreCommit commit = start_commit();
        commit.empty_removed();
        commit.evict_all();
    }
    // After everything was retired: a read pinned from now on is not overtaken.
    const std::uint64_t epoch = word(graph::kEpoch).fetch_add(1) + 1;
    if (oldest_pinned(read_pins, graph::kPinWords, epoch) < epoch)
        return false;
    sweep(epoch);
    memory.give_back();
    return true;
}

lookup::Outcome read_again(const Store& store, CommitNumber held,
                           const std::function<lookup::Outcome()>& once) {
    constexpr int kTriesBeforePin = 4;
    constexpr int kTriesShared = 1000;
    lookup::Outcome outcome = lookup::Outcome::kLapped;
    for (int i = 1; i < kTriesBeforePin; ++i) {
        store.lapped_reads.fetch_add(1);
        outcome = once();
        if (outcome != lookup::Outcome::kLapped)
            return outcome;
    }
    store.pinned_reads.fetch_add(1);
    int tries = 0;
    do {
        const ReadPin pin(store);
        outcome = once();
        // Writers do not see the pins of a read-only process, and damaged files never read cleanly.
        if (store.shared != nullptr && ++tries > kTriesShared)
            break;
    } while (outcome == lookup::Outcome::kLapped && held == kNewest);
    return outcome;
}

}  // namespace tfdb::store
