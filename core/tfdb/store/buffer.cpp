#include "tfdb/store/buffer.hpp"

#include <algorithm>
#include <array>
#include <string>

#include "tfdb/store/store.hpp"
#include "tfdb/store/validate.hpp"

namespace tfdb {

store::Store::Store(const BufferOptions& options)
    : memory(options.memory_limit.value_or(StoreMemory::kNoLimit)),
      history(options.history_ns.value_or(history::kForever)),
      snapshot_memory(options.snapshot_memory),
      concurrency(options.concurrency),
      frames(memory, memory.allocate(graph::kStoreBytes),
             memory.allocate_sparse(graph::Frames<StoreMemory>::bytes(options.max_frames)),
             options.max_frames),
      names(frames),
      held_pins(frames, graph::kHeldPins),
      read_pins(frames, graph::kReadPins),
      lock(frames.store_word(graph::kCommitLock)),
      engine(store::make_engine(*this)) {
    sync::watch_forks();
    home_process.store_relaxed(sync::forks() << kForksShift);
    // Whoever writes beside others would have to note it beside them.
    if (concurrency == Concurrency::kSnapshot || concurrency == Concurrency::kGiant)
        StoreFeed::put_into(frames, memory.allocate_sparse(StoreFeed::kBytes));
}

store::Store::~Store() = default;

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
    throw Forked(
        "this process was forked while a thread of its parent was at work in the store: here it " +
            std::string(engine == nullptr ? "can be read, but not written to"
                                          : "can be used no more") +
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
    const std::size_t held = word(graph::kHeldBytes).load_relaxed() +
                             memory.retired_bytes(memory::Line::kEnded) +
                             (replaced > kKept ? replaced - kKept : 0);
    return held > snapshot_memory;
}

CommitNumber store::Store::oldest_read() {
    const CommitNumber newest = committed();
    auto& given_up = word(graph::kGivenUp);
    if (keeps_too_much())
        given_up.store_relaxed(newest);
    return std::max<CommitNumber>(held_pins.oldest(newest), given_up.load_relaxed());
}

std::uint64_t store::Store::begin_epoch() {
    const std::uint64_t epoch = word(graph::kEpoch).fetch_add(1) + 1;
    return keeps_too_much() ? epoch : read_pins.oldest(epoch);
}

namespace {

BufferOptions checked(const BufferOptions& options) {
    if (options.history_ns &&
        (*options.history_ns <= 0 || *options.history_ns > history::kForever)) {
        throw InvalidArgument("history must be positive, or none to keep everything");
    }
    if (options.max_frames == 0 || options.max_frames > kMaxFrames) {
        throw InvalidArgument("max_frames must lie between 1 and " + std::to_string(kMaxFrames));
    }
    return options;
}

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
    throw InvalidArgument("there is no concurrency " + store::quoted(name) + ": known are " +
                          known);
}

Buffer::Buffer(const BufferOptions& options)
    : Reads(std::make_shared<store::Store>(checked(options)), kFresh) {}

void Buffer::check_not_in_transaction() const {
    store::check_not_in_transaction(*store_);
}

Snapshot Buffer::snapshot() const {
    if (store_->engine != nullptr) {
        // Alone, for then every commit up to this one has been applied in full.
        store::check_not_in_transaction(*store_);
        const store::Alone alone(*store_);
        const unsigned pin = store_->held_pins.take();
        return {store_, store_->committed(), pin};
    }
    const unsigned pin = store_->held_pins.take();
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
    const store::Alone alone(*store_);
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
    : Reads(std::move(store), held), pin_(pin) {}

Snapshot::Snapshot(Snapshot&& other) noexcept
    : Reads(std::move(other.store_), other.held_), pin_(other.pin_) {}

Snapshot::~Snapshot() {
    if (store_)
        store_->held_pins.drop(pin_);
}

}  // namespace tfdb
