// What the sessions of one store share, in the engines that guard frames.
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

/// Sizes of what sessions share. Tests that walk every interleaving specialise them to be tiny.
template <class Memory>
struct SyncTuning {
    static constexpr unsigned kSlots = 62;
    static constexpr int kSpins = 100;
    // So no operation starves: after at most 32 attempts, each of which sleeps at most 64 times for
    // a frame, an operation asks to be alone, urgently. It then waits for what is under way, and
    // for others that ask urgently.
    static constexpr int kAttemptsBeforeAlone = 32;
    static constexpr int kWaitsBeforeRetry = 64;
    static constexpr bool kAwaitsChange = true;  // of a lock that was refused, before the retry
};

/// Which sessions wait for a refused lock in two-phase locking.
enum class LockRule : std::uint8_t { kNoWait, kWaitDie, kWoundWait };

/// How a session is to be begun.
struct SessionOptions {
    unsigned priority = 0;
    std::uint64_t age = 0;  // of the attempt that lost; 0: a new one
    unsigned slot = sync::preferred_slot();
};

/// What a session notes of a frame that it reads.
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

/// The gate, the commit lock and the event that frames' locks are waited for with.
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

    /// The number of a commit that appends; the thread that takes it holds the frames that it
    /// writes.
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
