#include "tfdb/store/buffer.hpp"

#include <array>
#include <optional>
#include <string>
#include <utility>

#include "tfdb/memory/frozen_file.hpp"
#include "tfdb/store/freeze.hpp"
#include "tfdb/store/store.hpp"
#include "tfdb/store/validate.hpp"

namespace tfdb {

namespace {

BufferOptions checked(const BufferOptions& options) {
    if (options.history_ns &&
        (*options.history_ns <= 0 || *options.history_ns > history::kForever)) {
        throw InvalidArgument("history must be positive, or None to keep everything");
    }
    if (options.max_frames == 0 || options.max_frames > kMaxFrames) {
        throw InvalidArgument("max_frames must be from 1 to " + std::to_string(kMaxFrames));
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
    throw InvalidArgument("unknown concurrency " + store::quoted(name) + ": valid names are " +
                          known);
}

Buffer::Buffer(const BufferOptions& options)
    : StoreReader(std::make_shared<store::Store>(checked(options)), store::kNewest) {}

Buffer::Buffer(std::shared_ptr<store::Store> store)
    : StoreReader(std::move(store), store::kNewest) {}

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
        // Alone: every commit up to this one has then been applied completely.
        store::check_not_in_transaction(*store_);
        const store::Alone alone(*store_);
        const unsigned pin = store_->held_pins.take(store_->committed());
        return {store_, store_->committed(), pin, sync::forks()};
    }
    const unsigned pin = store_->held_pins.take(store_->committed());
    return {store_, store_->committed(), pin, sync::forks()};
}

CommitNumber Buffer::clear() {
    store::check_not_in_transaction(*store_);
    const store::Alone alone(*store_);
    StoreCommit commit = store_->start_commit();
    commit.clear_moving([&](FrameId id) { return store_->writer_of(id).has_value(); });
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
    // A read-only process cannot lock, so its counts may change during the count.
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

Snapshot::Snapshot(std::shared_ptr<store::Store> store, CommitNumber held, unsigned pin,
                   std::uint64_t forks)
    : StoreReader(std::move(store), held), pin_(pin), forks_(forks) {}

Snapshot::Snapshot(Snapshot&& other) noexcept
    : StoreReader(std::move(other.store_), other.held_), pin_(other.pin_), forks_(other.forks_) {}

/// False for the copy of a shared store's snapshot in a forked child, which uses another slot.
bool Snapshot::is_counted() const {
    return store_->shared == nullptr || forks_ == sync::forks();
}

Snapshot Snapshot::at(CommitNumber commit) const {
    std::optional<store::Alone> alone;
    if (store_->engine != nullptr) {
        // As in Buffer::snapshot.
        store::check_not_in_transaction(*store_);
        alone.emplace(*store_);
    }
    const std::string wanted = "this snapshot cannot open commit " + std::to_string(commit);
    if (commit < held_) {
        throw InvalidArgument(wanted + ": it is of commit " + std::to_string(held_) +
                              ", and protects that one and later ones");
    }
    if (const CommitNumber newest = store_->committed(); commit > newest)
        throw InvalidArgument(wanted + ": the newest is " + std::to_string(newest));
    if (is_counted())
        store_->held_pins.join(pin_);
    return {store_, commit, pin_, forks_};
}

void Snapshot::freeze(const std::string& path, std::string_view origin, bool in_place) const {
    store::freeze(*store_, held_, path, origin, in_place);
}

Snapshot::~Snapshot() {
    if (store_ && is_counted())
        store_->held_pins.drop(pin_);
}

}  // namespace tfdb
