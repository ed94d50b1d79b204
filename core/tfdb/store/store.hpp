// The common state of a Buffer and its Snapshots, and the views of their reads.
#pragma once

#include <array>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "tfdb/base/interruption.hpp"
#include "tfdb/graph/frames.hpp"
#include "tfdb/graph/names.hpp"
#include "tfdb/graph/pins.hpp"
#include "tfdb/lookup/lookup.hpp"
#include "tfdb/memory/region.hpp"
#include "tfdb/memory/shared_file.hpp"
#include "tfdb/store/authorities.hpp"
#include "tfdb/store/buffer.hpp"
#include "tfdb/store/engine.hpp"
#include "tfdb/store/lifespans.hpp"
#include "tfdb/store/positions.hpp"
#include "tfdb/store/transaction_life.hpp"
#include "tfdb/store/writer_lock.hpp"
#include "tfdb/sync/fork.hpp"
#include "tfdb/sync/published.hpp"
#include "tfdb/sync/wait_group.hpp"
#include "tfdb/txn/commit.hpp"
#include "tfdb/txn/snapshot_view.hpp"

namespace tfdb {

using StoreMemory = memory::Region;
using StoreView = txn::SnapshotView<StoreMemory>;
using StoreEdge = history::EdgeView<StoreMemory>;
using StoreCommit = txn::Commit<StoreMemory>;
using StoreFeed = txn::Feed<StoreMemory>;

namespace store {

template <class Store>
class BasicWaits;
struct Store;
using Waits = BasicWaits<Store>;

/// The region that holds the forest, and the data of this process's writers.
/// Threads: reads any; `scratch`, `items` and `samples` only under `lock`.
/// Guarantee: lives as long as the Buffer or any Snapshot of it.
struct Store final : history::Readers, WriterLock::Repairs, sync::ForkWatcher {
    using Word = sync::Word;
    using WaitGroup = sync::WaitGroup;

    explicit Store(const BufferOptions& options);
    /// A store shared by processes. Throws CorruptStore.
    explicit Store(memory::SharedFile file);
    ~Store() override;

    /// A number for this program's layout of a store's region.
    [[nodiscard]] static std::uint64_t layout();
    /// The forest in a region, created if missing. Throws CapacityExceeded, CorruptStore.
    [[nodiscard]] static graph::Frames<StoreMemory> forest_in(StoreMemory& memory,
                                                              const BufferOptions& options);

    [[nodiscard]] sync::Word& word(graph::StoreWord w) const { return frames.store_word(w); }
    [[nodiscard]] CommitNumber committed() const { return word(graph::kCommit).load_acquire(); }
    [[nodiscard]] StoreView view(CommitNumber commit) const { return {frames, commit, history}; }

    /// Of held states and reads in progress. If these keep as much memory as allowed, the newest
    /// commit or epoch instead.
    [[nodiscard]] CommitNumber oldest_read() override;
    [[nodiscard]] std::uint64_t begin_epoch() override;
    [[nodiscard]] std::uint64_t next_epoch() override {
        // Blocks must be retired before this: other processes may begin epochs meanwhile.
        sync::fence_full();
        return word(graph::kEpoch).load_relaxed() + 1;
    }
    void held(std::uint64_t bytes) override { word(graph::kHeldBytes).fetch_add(bytes); }
    /// Call after the death of a process that held the commit lock.
    void repair() noexcept override;
    [[nodiscard]] bool must_sweep(std::uint64_t deaths, bool died_in_memory) const;
    /// Frees blocks that deaths lost. It drops older held states, and reads that began before this
    /// epoch restart. The epoch began after everything was retired.
    void sweep(std::uint64_t epoch);
    /// Returns unused memory to the system; the caller holds the commit lock and is the only
    /// writer. False: it did nothing, because an older state is held or a repeatedly overtaken read
    /// is in progress.
    bool compact();
    /// Whether data that no new read needs exceed the limit.
    [[nodiscard]] bool keeps_too_much() const;
    /// Starts a commit, of a writer of this store or of a source by its number. The caller holds
    /// the commit lock; no other writer is active.
    [[nodiscard]] StoreCommit start_commit() {
        return {frames, scratch, history, *this, 0, local()};
    }
    [[nodiscard]] StoreCommit start_commit_of(std::uint64_t source) {
        return {frames, scratch, history, *this, 0, source};
    }
    /// The same for samples of one authority. Throws CapacityExceeded.
    [[nodiscard]] StoreCommit start_commit(std::string_view authority);
    /// `author`: a result of `author_number`.
    void set_author(FrameId id, std::uint64_t author) {
        auto& word = frames.word(id, history::kAuthority);
        if (word.load_relaxed() != author)
            word.store_relaxed(author);
    }
    [[nodiscard]] std::uint64_t author_number(std::string_view name) {
        return authorities.id(name);
    }
    /// The source number of a commit by a writer of this store: see txn::Commit.
    [[nodiscard]] std::uint64_t local() const {
        return positions.empty() ? history::SourceWord::kNoSources : 0;
    }
    /// The only source that may write the samples of a frame's edge.
    [[nodiscard]] std::optional<std::string> writer_of(FrameId id) const {
        if (positions.empty()) [[likely]]
            return std::nullopt;
        const std::uint64_t word = frames.word(id, history::kSource).load_relaxed();
        return owner(history::SourceWord::writer(word));
    }
    /// The only source that may remove a frame: it created the frame, or wrote its samples.
    [[nodiscard]] std::optional<std::string> remover_of(FrameId id) const;
    /// Throws ReadOnly if the commit changes a source's data.
    void check_writable(const StoreCommit& commit) const;
    [[nodiscard]] history::Readers& readers() { return *this; }
    [[nodiscard]] std::string author_name(std::uint64_t number) const;
    /// The last writer of the frame.
    [[nodiscard]] std::string author(FrameId id) const;
    /// The epoch that numbers its commits.
    [[nodiscard]] Epoch epoch() const;

    /// Throws Forked if the store is an orphan: this process was forked while a thread was active
    /// in the store. That thread does not exist here, so its locks stay taken.
    void check_not_orphaned() const {
        if ((fork_state() & kOrphan) != 0) [[unlikely]]
            throw_orphaned();
    }

    struct Item {
        FrameId child;
        FrameId parent;
        std::size_t index;
    };
    static constexpr std::uint64_t kOrphan = 1;
    static constexpr std::uint64_t kNamesLost = 2;  // a thread was using the authorities' names
    static constexpr unsigned kForksShift = 2;

    /// As Positions::owner; empty for 0.
    [[nodiscard]] std::optional<std::string> owner(std::uint64_t number) const {
        return number == 0 ? std::nullopt : positions.owner(number);
    }

    /// A setting of the clock: time, start, speed, and mode.
    using ClockWords = sync::Published<4>;
    static constexpr std::uint64_t kSystemClock = 0;
    static constexpr std::uint64_t kRunningClock = 1;
    static constexpr std::uint64_t kPausedClock = 2;
    static_assert(ClockWords::kWords == memory::Control::kClockWords);

    /// Flags of this process's copy after a fork. The first caller sets them: no thread has taken a
    /// lock here before.
    [[nodiscard]] std::uint64_t fork_state() const {
        const std::uint64_t home = home_process.load_acquire();
        return home >> kForksShift == sync::forks() ? home : check_locks_at_fork(home);
    }
    std::uint64_t check_locks_at_fork(std::uint64_t home) const;
    Store(std::unique_ptr<memory::SharedFile> file, const BufferOptions& options);
    void join();
    void note_reads();
    /// A forked child takes a slot of its own for its pins.
    void forked() noexcept override;
    /// Of this process, created on first use.
    [[nodiscard]] Waits& waits() const;
    /// Whether the store was removed, according to its control file.
    [[nodiscard]] bool removed() const { return has_control() && shared->control->removed(); }
    [[nodiscard]] bool has_control() const {
        return shared != nullptr && shared->control != nullptr;
    }
    [[nodiscard]] CommitNumber oldest_pinned(const graph::Pins<StoreMemory>& mine, unsigned first,
                                             CommitNumber newest) const;
    [[noreturn]] void throw_orphaned() const;

    std::unique_ptr<memory::SharedFile> shared;  // null: a private store
    // For a process whose pins writers cannot see.
    std::unique_ptr<std::array<sync::Word, 2 * graph::kPinWords>> unseen_pins;
    mutable sync::Word own_commit_event{};  // of a private store
    sync::Word& commit_event;               // notified after each commit
    std::array<sync::Word, memory::Control::kClockWords> own_clock_words{};
    sync::Word own_clock_event{};
    sync::Word* clock_words;  // the control file's, if there is one
    sync::Word& clock_event;
    mutable sync::Word waits_ended{};  // 1: this process has ended its waits for ever
    StoreMemory memory;
    graph::Frames<StoreMemory> frames;
    StampNs history;
    sync::Pointer<const Lifespans> lifespans;  // null: none are enforced
    std::size_t snapshot_memory;
    Concurrency concurrency;
    graph::Names<StoreMemory> names;
    graph::Pins<StoreMemory> held_pins;  // of states
    graph::Pins<StoreMemory> read_pins;  // of epochs, by overtaken reads
    sync::Word process_lock{};           // of a shared store: serialises this process's threads
    mutable WriterLock lock;
    txn::CommitScratch scratch;
    std::vector<Item> items;
    std::vector<history::NewSample<StoreMemory>> samples;  // of one edge
    std::vector<std::size_t> members;                      // their indices in the batch
    mutable Authorities authorities;
    Positions positions;
    mutable sync::Word lapped_reads{};
    mutable sync::Word pinned_reads{};
    sync::Word aborts{};                // of transactions, including conflicts
    sync::Word conflicts{};             // transactions aborted by a conflict
    mutable sync::Word home_process{};  // forks, and the flags above
    sync::Word ages{};                  // number of transactions: the age of the next one
    mutable sync::Pointer<Waits> waits_here;
    std::vector<std::unique_ptr<const Lifespans>>
        lifespans_so_far;            // concurrent reads may use any of them
    std::unique_ptr<Engine> engine;  // null: the default engine
};

/// Exclusive use of the store: holds the commit lock, and in engines with parallel operations
/// excludes all of them.
/// Threads: one. Guarantee: blocks until earlier operations have ended. The wait for the lock can
/// be interrupted as that lock's; work under it cannot.
class Alone {
public:
    explicit Alone(const Store& store) : store_(store), guard_(store.lock) {
        if (store.engine != nullptr)
            store.engine->keep_out();
    }
    ~Alone() {
        if (store_.engine != nullptr)
            store_.engine->let_in();
    }
    Alone(const Alone&) = delete;
    Alone& operator=(const Alone&) = delete;

private:
    const Store& store_;
    const std::lock_guard<WriterLock> guard_;
    const NotInterrupted not_interrupted_;
};

/// Throws TransactionActive if this thread has a transaction open: it would deadlock with itself,
/// or see its own uncommitted writes. Throws Forked.
inline void check_not_in_transaction(const Store& store) {
    store.check_not_orphaned();
    if (TransactionLife::any(store, false))
        throw_transaction_active("use the transaction's methods, or end it first");
}
/// The same, but only a transaction that runs alone is refused.
inline void check_not_alone_in_transaction(const Store& store) {
    store.check_not_orphaned();
    if (TransactionLife::any(store, true))
        throw_transaction_active("it runs alone: end it first");
}

/// Call before a thread takes exclusive use: with an open transaction of its own it would deadlock.
/// Throws TransactionActive, Forked.
inline void check_may_wait(const Store& store) {
    if (store.engine != nullptr)
        check_not_in_transaction(store);
    else
        check_not_alone_in_transaction(store);
}

/// Reads that begin during its lifetime are not overtaken, and the newest state stays unchanged.
/// Threads: one. Guarantee: wait-free.
class ReadPin {
public:
    explicit ReadPin(const Store& store) : state_(store.held_pins), epoch_(store.read_pins) {}

private:
    graph::Pin<StoreMemory> state_;
    graph::Pin<StoreMemory> epoch_;
};

/// kLapped if a missing frame may be one whose slot was reused since. Successful lookups need no
/// check; listings and errors do.
template <class AnyStore>
[[nodiscard]] lookup::Outcome unless_reused(const AnyStore& store, CommitNumber commit,
                                            lookup::Outcome outcome) {
    sync::fence_acquire();
    return commit < store.word(graph::kRecycleFloor).load_relaxed() ? lookup::Outcome::kLapped
                                                                    : outcome;
}

/// Asks the newest state, or the held one, of the default engine.
[[nodiscard]] bool ask(const Store& store, CommitNumber held, Question& question, Answer& answer,
                       Failure& failure);

/// Repeats an overtaken read: a few times, then with pins that keep its state, unless held states
/// keep as much memory as allowed. kLapped: the held commit's samples are gone.
[[nodiscard]] lookup::Outcome read_again(const Store& store, CommitNumber held,
                                         const std::function<lookup::Outcome()>& once);

/// Runs `attempt(view)` on the newest view, or on the held one, until no writer overtakes it; as
/// `read_again`. `held`: a snapshot's commit, or kNewest.
template <class Attempt>
lookup::Outcome read_committed(const Store& store, CommitNumber held, Attempt attempt) {
    const auto once = [&] {
        const CommitNumber commit = held == kNewest ? store.committed() : held;
        const lookup::Outcome outcome = attempt(store.view(commit));
        return outcome == lookup::Outcome::kFailed ? unless_reused(store, commit, outcome)
                                                   : outcome;
    };
    const lookup::Outcome outcome = once();
    if (outcome != lookup::Outcome::kLapped) [[likely]]
        return outcome;
    return read_again(store, held, std::cref(once));
}

/// Throws the error of an unreadable state: SnapshotTooOld, or CorruptStore for a frozen store,
/// which has no writers. `held`: as in `read_committed`.
[[noreturn]] void throw_unreadable(const Store& store, CommitNumber held);

/// As `read_committed`, but returns false for kFailed and throws for kLapped. Engines that guard
/// frames may have numbered commits in progress: there a read of the newest state runs alone from
/// the start.
template <class Attempt>
bool read(const Store& store, CommitNumber held, Attempt attempt) {
    lookup::Outcome outcome{};
    if (held != kNewest || store.engine == nullptr) [[likely]] {
        outcome = read_committed(store, held, attempt);
    } else {
        check_may_wait(store);
        const Alone alone(store);
        outcome = attempt(store.view(store.committed()));
    }
    if (outcome == lookup::Outcome::kLapped)
        throw_unreadable(store, held);
    return outcome == lookup::Outcome::kOk;
}

/// "(removed)" if the slot was reused since.
[[nodiscard]] inline std::string name_of_frame(const Store& store, FrameId id,
                                               std::uint32_t generation) {
    if (id < store.frames.count()) {
        std::string name = store.names.name(id);
        sync::fence_acquire();
        if (store.frames.generation(id) == generation)
            return name;
    }
    return "(removed)";
}

/// "12.345678901 s"
std::string seconds(StampNs stamp);

}  // namespace store

}  // namespace tfdb
