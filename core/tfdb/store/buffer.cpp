#include "tfdb/store/buffer.hpp"

#include <algorithm>
#include <array>
#include <new>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "tfdb/memory/frozen_file.hpp"
#include "tfdb/store/freeze.hpp"
#include "tfdb/store/store.hpp"
#include "tfdb/store/validate.hpp"
#include "tfdb/txn/repair.hpp"

namespace tfdb {

graph::Frames<StoreMemory> store::Store::forest_in(StoreMemory& memory,
                                                   const BufferOptions& options) {
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
        // Whoever writes beside others would have to note it beside them.
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

std::uint64_t store::Store::layout() {
    using Sizes = history::Tuning<StoreMemory>;
    constexpr std::uint64_t kVersion = 2;
    std::uint64_t layout = kVersion;
    for (const std::uint64_t part :
         {std::uint64_t{history::kHeaderWords}, std::uint64_t{graph::kStoreWords},
          std::uint64_t{StoreMemory::kPayloadWords}, std::uint64_t{memory::kSizeClasses},
          std::uint64_t{Sizes::kFullLog2}, std::uint64_t{Sizes::kLargestLog2},
          std::uint64_t{Sizes::kFanLog2}})
        layout = layout * 4099 + part;
    return layout;
}

store::Store::Store(const BufferOptions& options) : Store(nullptr, options) {}

store::Store::Store(memory::SharedFile file)
    : Store(std::make_unique<memory::SharedFile>(std::move(file)), {}) {}

store::Store::Store(std::unique_ptr<memory::SharedFile> file, const BufferOptions& options)
    : shared(std::move(file)),
      bell(shared == nullptr || shared->control == nullptr ? own_bell : shared->control->bell()),
      memory(shared == nullptr ? memory::Mapping::reserve() : std::move(shared->data),
             options.memory_limit.value_or(StoreMemory::kNoLimit)),
      frames(forest_in(memory, options)),
      history(history::as_stamp(word(graph::kHistory).load_relaxed())),
      snapshot_memory(word(graph::kSnapshotMemory).load_relaxed()),
      concurrency(options.concurrency),
      names(frames),
      held_pins(frames, graph::kHeldPins),
      read_pins(frames, graph::kReadPins),
      lock(shared == nullptr ? word(graph::kCommitLock) : process_lock, bell, shared.get(), *this),
      engine(store::make_engine(*this)) {
    sync::watch_forks();
    home_process.store_relaxed(sync::forks() << kForksShift);
    if (shared != nullptr)
        join();
}

/// Says to writers where to see what this process reads.
void store::Store::join() {
    note_reads();
    authorities.share(memory, word(graph::kAuthorities));
    sync::tell_of_forks(*this);
}

void store::Store::forked() noexcept {
    if (shared->control != nullptr && shared->control->take_own_slot())
        note_reads();
}

void store::Store::note_reads() {
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

store::Store::~Store() {
    if (shared != nullptr)
        sync::tell_no_more(*this);
    delete waits_here.load_acquire();
}

store::Waits& store::Store::waits() const {
    Waits* found = waits_here.load_acquire();
    // A child leaves those of its parent as they are: their threads are not here.
    if (found != nullptr && found->forks() == sync::forks())
        return *found;
    auto made = std::make_unique<Waits>(*this, bell);
    return waits_here.compare_exchange(found, made.get()) ? *made.release() : *found;
}

std::uint64_t store::Store::look_around(std::uint64_t home) const {
    std::uint64_t judged = sync::forks() << kForksShift;
    if (lock.in_use() || authorities.in_use() || (engine != nullptr && engine->in_use()))
        judged |= kOrphan;
    if (authorities.in_use())
        judged |= kNamesLost;
    // Who comes second takes what the first one has seen.
    return home_process.compare_exchange(home, judged) ? judged : home;
}

void store::Store::throw_orphaned() const {
    ErrorDetail detail;
    detail.reason = "forked";
    throw Forked("this process was forked while a thread of its parent used the store: this copy " +
                     std::string(engine == nullptr ? "can be read, but not written to"
                                                   : "cannot be used any more") +
                     "; make a Buffer in this process, or fork while no thread uses the store",
                 std::move(detail));
}

std::string store::Store::author(FrameId id) const {
    if ((whereabouts() & kNamesLost) != 0)
        throw_orphaned();
    for (;;) {
        // What has no name any more has been replaced.
        auto name = authorities.name(frames.word(id, history::kAuthority).load_acquire());
        if (name)
            return *std::move(name);
    }
}

void store::Store::forget_authorities() {
    std::vector<std::uint64_t> ids;
    for (FrameId id = 0; id < frames.count(); ++id) {
        const std::uint64_t author = frames.word(id, history::kAuthority).load_relaxed();
        if (author != 0 && (ids.empty() || ids.back() != author))
            ids.push_back(author);
    }
    authorities.keep_only(std::move(ids), frames.count() / kFramesPerSpareName);
}

StoreCommit store::Store::start_commit() {
    if (authorities.crowded())
        forget_authorities();
    return {frames, scratch, history, *this};
}

bool store::Store::keeps_too_much() const {
    constexpr std::size_t kKept = history::Tuning<StoreMemory>::kKept;
    const std::size_t replaced = memory.retired_bytes(memory::Line::kReplaced);
    // Deaths may leave it below zero.
    const auto noted = static_cast<std::int64_t>(word(graph::kHeldBytes).load_relaxed());
    const std::size_t held = static_cast<std::size_t>(std::max<std::int64_t>(noted, 0)) +
                             memory.retired_bytes(memory::Line::kEnded) +
                             (replaced > kKept ? replaced - kKept : 0);
    return held > snapshot_memory;
}

/// Of all processes: `first`, which words of their slots to look at.
CommitNumber store::Store::oldest_pinned(const graph::Pins<StoreMemory>& mine, unsigned first,
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

CommitNumber store::Store::oldest_read() {
    const CommitNumber newest = committed();
    auto& given_up = word(graph::kGivenUp);
    if (keeps_too_much())
        given_up.store_relaxed(newest);
    return std::max<CommitNumber>(oldest_pinned(held_pins, 0, newest), given_up.load_relaxed());
}

std::uint64_t store::Store::begin_epoch() {
    const std::uint64_t epoch = word(graph::kEpoch).fetch_add(1) + 1;
    return keeps_too_much() ? epoch : oldest_pinned(read_pins, graph::kPinWords, epoch);
}

/// Whether it is time to look for the blocks that deaths left unused. As many deaths leave few; to
/// look for them takes longer than all the rest, and costs the older states that are held.
bool store::Store::must_sweep(std::uint64_t deaths, bool died_in_memory) const {
    constexpr std::uint64_t kDeathsBetweenSweeps = 64;
    const bool many = deaths >= kDeathsBetweenSweeps;
    const bool is_short = memory.is_short();
    if (!many && !is_short && !died_in_memory)
        return false;
    const CommitNumber newest = committed();
    return (many && is_short) || oldest_pinned(held_pins, 0, newest) >= newest;
}

void store::Store::repair() noexcept {
    sync::Word& deaths = shared->control->deaths();
    const bool died_in_memory = memory.repair();
    txn::Repair<StoreMemory>(frames, history, *this).run();
    const std::uint64_t died = deaths.load_relaxed() + 1;
    if (must_sweep(died - shared->control->swept_deaths().load_relaxed(), died_in_memory)) {
        try {
            sweep(word(graph::kEpoch).fetch_add(1) + 1);
            shared->control->swept_deaths().store_relaxed(died);
        } catch (const std::bad_alloc&) {
            // Nothing was freed: one of the next deaths asks again.
        }
    }
    deaths.store_relaxed(died);
}

void store::Store::sweep(std::uint64_t epoch) {
    std::vector<StoreMemory::Block> in_use;
    const auto visit = [&](Offset offset, std::size_t bytes) { in_use.push_back({offset, bytes}); };
    std::uint64_t held = 0;
    visit(StoreMemory::root(), graph::kStoreBytes);
    names.visit_blocks(visit);
    authorities.visit_blocks(visit);
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

bool store::Store::compact() {
    const CommitNumber newest = committed();
    if (oldest_pinned(held_pins, 0, newest) < newest)
        return false;
    {
        StoreCommit commit = start_commit();
        commit.empty_removed();
        commit.evict_all();
    }
    // Behind all that was taken out of use: a read that is pinned from now on is not overtaken.
    const std::uint64_t epoch = word(graph::kEpoch).fetch_add(1) + 1;
    if (oldest_pinned(read_pins, graph::kPinWords, epoch) < epoch)
        return false;
    sweep(epoch);
    memory.give_back();
    return true;
}

namespace {

BufferOptions checked(const BufferOptions& options) {
    if (options.history_ns &&
        (*options.history_ns <= 0 || *options.history_ns > history::kForever)) {
        throw InvalidArgument("history must be positive, or None to keep everything");
    }
    if (options.max_frames == 0 || options.max_frames > kMaxFrames) {
        throw InvalidArgument("max_frames must lie between 1 and " + std::to_string(kMaxFrames));
    }
    return options;
}

constexpr std::size_t kPage = 4096;
constexpr std::size_t kLeastSize = std::size_t{8} << 20;
constexpr std::size_t kLargestSize = std::size_t{1} << 40;

constexpr std::array<std::string_view, kConcurrencies> kConcurrencyNames = {
    "snapshot", "giant", "fine", "2pl-no-wait", "2pl-wait-die", "2pl-wound-wait", "silo"};

}  // namespace

std::string_view concurrency_name(Concurrency concurrency) {
    return kConcurrencyNames[static_cast<std::size_t>(concurrency)];
}

Concurrency concurrency_of(std::string_view name) {
    std::string known;
    for (std::size_t i = 0; i < kConcurrencies; ++i) {
        if (kConcurrencyNames[i] == name)
            return static_cast<Concurrency>(i);
        known += (i == 0 ? "" : ", ") + std::string(kConcurrencyNames[i]);
    }
    throw InvalidArgument("unknown concurrency " + store::quoted(name) + ": known are " + known);
}

Buffer::Buffer(const BufferOptions& options)
    : Reads(std::make_shared<store::Store>(checked(options)), kFresh) {}

Buffer::Buffer(std::shared_ptr<store::Store> store) : Reads(std::move(store), kFresh) {}

void Buffer::create(const std::string& path, const ShareOptions& share,
                    const BufferOptions& options) {
    if (options.concurrency != Concurrency::kSnapshot || options.memory_limit) {
        throw InvalidArgument(
            "a shared store has the concurrency \"snapshot\" and is limited by its size");
    }
    const std::size_t table =
        graph::Frames<StoreMemory>::bytes(checked(options).max_frames) + kLeastSize;
    if (share.size < table || share.size > kLargestSize) {
        throw InvalidArgument("a store for " + std::to_string(options.max_frames) +
                              " frames needs a size between " + std::to_string(table) + " and " +
                              std::to_string(kLargestSize) + " bytes");
    }
    memory::NewSharedFile file(path, memory::round_up(share.size, kPage), share.mode, share.group);
    {
        StoreMemory memory(file.map());
        (void)store::Store::forest_in(memory, options);
    }
    file.publish(store::Store::layout());
}

Buffer Buffer::open(const std::string& path, bool writable, std::int64_t lock_timeout_ns) {
    memory::SharedFile file = memory::open_shared(path, writable, store::Store::layout());
    file.lock_timeout_ns = lock_timeout_ns;
    return Buffer(std::make_shared<store::Store>(std::move(file)));
}

Buffer Buffer::open_frozen(const std::string& path, bool verify) {
    return Buffer(
        std::make_shared<store::Store>(memory::open_frozen(path, store::Store::layout(), verify)));
}

void Buffer::freeze(const std::string& path, std::string_view origin, bool in_place) const {
    snapshot().freeze(path, origin, in_place);
}

std::optional<FrozenUse> Buffer::frozen() const {
    if (store_->shared == nullptr || !store_->shared->frozen)
        return std::nullopt;
    return FrozenUse{store_->shared->path, store_->memory.capacity(), store::origin(*store_)};
}

void Buffer::unlink(const std::string& path) {
    memory::unlink_shared(path);
}

std::optional<SharedUse> Buffer::shared() const {
    if (store_->shared == nullptr || store_->shared->frozen)
        return std::nullopt;
    SharedUse use;
    use.path = store_->shared->path;
    use.writable = store_->shared->writable;
    use.lock_timeout_ns = store_->shared->lock_timeout_ns;
    use.size = store_->memory.capacity();
    if (store_->shared->control != nullptr) {
        use.repairs = store_->shared->control->deaths().load_relaxed();
        use.processes = store_->shared->control->count_processes();
    }
    return use;
}

void Buffer::check_not_in_transaction() const {
    store::check_not_in_transaction(*store_);
}

Snapshot Buffer::snapshot() const {
    if (store_->engine != nullptr) {
        // Alone, for then every commit up to this one has been applied in full.
        store::check_not_in_transaction(*store_);
        const store::Alone alone(*store_);
        const unsigned pin = store_->held_pins.take(store_->committed());
        return {store_, store_->committed(), pin};
    }
    const unsigned pin = store_->held_pins.take(store_->committed());
    return {store_, store_->committed(), pin};
}

CommitNumber Buffer::clear() {
    store::check_not_in_transaction(*store_);
    const store::Alone alone(*store_);
    StoreCommit commit = store_->start_commit();
    const StoreView view = store_->view(store_->committed());
    for (FrameId id = 0; id < store_->frames.count(); ++id) {
        const history::EdgeSegments<StoreMemory> edge(store_->memory, store_->frames.header(id));
        if (!view.alive(id) || edge.newest() < 0)
            continue;
        if (commit.touch(id))
            continue;
        commit.clear(id);
    }
    return commit.publish();
}

bool Buffer::compact() {
    store::check_not_in_transaction(*store_);
    const store::Alone alone(*store_);
    return store_->compact();
}

std::optional<StampNs> Buffer::history() const {
    if (store_->history == history::kForever)
        return std::nullopt;
    return store_->history;
}

Counters Buffer::counters() const {
    Counters counters;
    counters.commits = commit();
    counters.normalised = store_->word(graph::kNormalised).load_relaxed();
    counters.lapped_reads = store_->lapped_reads.load_relaxed();
    counters.pinned_reads = store_->pinned_reads.load_relaxed();
    counters.aborts = store_->aborts.load_relaxed();
    counters.conflicts = store_->conflicts.load_relaxed();
    if (store_->engine != nullptr)
        store_->engine->add_to(counters);
    return counters;
}

Concurrency Buffer::concurrency() const {
    return store_->concurrency;
}

MemoryUse Buffer::memory() const {
    store::check_may_wait(*store_);
    // Who may not write may not lock: what it counts then may change under its eyes.
    std::optional<store::Alone> alone;
    if (store_->shared == nullptr || store_->shared->writable)
        alone.emplace(*store_);
    MemoryUse use;
    const std::size_t retired = store_->memory.retired_bytes(memory::Line::kReplaced) +
                                store_->memory.retired_bytes(memory::Line::kEnded);
    use.used_bytes = store_->memory.used_bytes() - retired;
    use.free_bytes = store_->memory.free_bytes() + retired;
    use.frames = store_->frames.count();
    use.frame_bytes = store_->frames.bytes(static_cast<std::uint32_t>(use.frames));
    use.authority_bytes = store_->authorities.bytes();
    for (FrameId id = 0; id < store_->frames.count(); ++id) {
        use.samples +=
            history::EdgeSegments<StoreMemory>(store_->memory, store_->frames.header(id)).stored();
    }
    return use;
}

Snapshot::Snapshot(std::shared_ptr<store::Store> store, CommitNumber held, unsigned pin)
    : Reads(std::move(store), held), pin_(pin), forks_(sync::forks()) {}

Snapshot::Snapshot(Snapshot&& other) noexcept
    : Reads(std::move(other.store_), other.held_), pin_(other.pin_), forks_(other.forks_) {}

void Snapshot::freeze(const std::string& path, std::string_view origin, bool in_place) const {
    store::freeze(*store_, held_, path, origin, in_place);
}

Snapshot::~Snapshot() {
    if (store_ && (store_->shared == nullptr || forks_ == sync::forks()))
        store_->held_pins.drop(pin_);
}

}  // namespace tfdb
