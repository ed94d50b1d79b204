// The state that a store's sessions share, in engines that guard frames.
#pragma once

#include <array>
#include <vector>

#include "tfdb/base/error.hpp"
#include "tfdb/engines/event.hpp"
#include "tfdb/engines/gate.hpp"
#include "tfdb/engines/parallel_commit.hpp"
#include "tfdb/graph/frames.hpp"
#include "tfdb/sync/commit_lock.hpp"

namespace tfdb::txn {

/// Sizes of the shared state. Tests that explore every interleaving specialise them to be tiny.
template <class Memory>
struct SyncTuning {
    static constexpr unsigned kSlots = 62;
    static constexpr int kSpins = 100;
    // Prevents starvation: after at most 32 attempts, each with at most 64 sleeps for a frame, an
    // operation urgently requests to be alone. It then waits only for operations in progress and
    // other urgent requests.
    static constexpr int kAttemptsBeforeAlone = 32;
    static constexpr int kWaitsBeforeRetry = 64;
    static constexpr bool kAwaitsChange = true;  // after a refused lock, before the retry
};

/// Which sessions wait for a refused lock in two-phase locking.
enum class LockRule : std::uint8_t { kNoWait, kWaitDie, kWoundWait };

/// Options of a new session.
struct SessionOptions {
    unsigned priority = 0;
    std::uint64_t age = 0;  // of the aborted attempt; 0: a first attempt
    unsigned slot = sync::preferred_slot();
};

/// A session's note about a frame that it reads.
struct NotedVersion {
    FrameId id = kNoFrame;
    std::uint64_t version = 0;
};

/// Lists of each slot's thread, kept so that no operation allocates in steady state.
template <class Memory>
struct alignas(64) SlotScratch {
    std::vector<FrameId> held;
    std::vector<NotedVersion> noted;
    PlainBatch<Memory> batch;
};

/// The gate, the commit lock, and the event for waits for frame locks.
/// Threads: any; a slot's scratch only the thread in the slot.
/// Guarantee: as the parts'.
template <class Memory>
struct SharedState {  // NOLINT(clang-analyzer-optin.performance.Padding): one per store
    using Word = typename Memory::Word;
    using Tuning = SyncTuning<Memory>;
    using Gate = sync::BasicGate<Word, Tuning::kSlots, Tuning::kSpins>;
    using Event = sync::BasicEvent<Word, Tuning::kSpins>;
    using Lock = sync::BasicCommitLock<Word, Tuning::kSpins>;

    SharedState(graph::Frames<Memory> of, clock::StampNs kept, LockRule refused = {})
        : frames(of),
          history(kept),
          rule(refused),
          lock(of.store_word(graph::kCommitLock)),
          event(event_word) {}

    [[nodiscard]] CommitNumber committed() const {
        return frames.store_word(graph::kCommit).load_acquire();
    }

    /// The number of an appending commit. The calling thread must hold the frames that it writes.
    [[nodiscard]] CommitNumber take_ticket() {
        if (committed() >= kSeesAll - Tuning::kSlots) {
            throw CapacityExceeded("the store has used up its commit numbers: start a new one");
        }
        return frames.store_word(graph::kCommit).fetch_add(1) + 1;
    }

    graph::Frames<Memory> frames;
    clock::StampNs history;
    LockRule rule;
    Lock lock;
    Gate gate;
    alignas(64) Word event_word{};
    Event event;
    std::array<SlotScratch<Memory>, Tuning::kSlots> scratch;
};

}  // namespace tfdb::txn
