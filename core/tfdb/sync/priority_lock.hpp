// The commit lock with lanes: who has a higher one goes first.
#pragma once

#include "tfdb/sync/commit_lock.hpp"

namespace tfdb::sync {

/// A commit lock that lane 0 takes directly, and lanes 1 to 7 in order of lane, then of arrival.
/// Threads: any may lock; only the holder may unlock.
/// Guarantee: `try_lock` is wait-free, and fails also while a lane above 0 waits. Once a request of
/// lane 7 has its ticket, it waits for the commit in progress, for one commit of each thread that
/// had passed the lanes before, and for those before it in its lane (14 at most). Within lane 0 the
/// lock is not fair, and lanes above 0 may starve it.
template <class Word, int Spins = 100>
class BasicPriorityLock {
public:
    static constexpr unsigned kLanes = 8;

    /// `lanes` starts as zero and belongs to this lock alone, as `word` does.
    BasicPriorityLock(Word& word, Word& lanes) noexcept : lock_(word), lanes_(lanes) {}

    bool try_lock() noexcept { return !waits_above(lanes_.load_relaxed(), 0) && lock_.try_lock(); }

    void lock(unsigned lane = 0) noexcept {
        if (lane == 0) {
            await([](std::uint64_t lanes) { return !waits_above(lanes, 0); });
            lock_.lock();
            return;
        }
        const std::uint64_t ticket = draw(lane);
        await([lane, ticket](std::uint64_t lanes) {
            return serving(lanes, lane) == ticket && !waits_above(lanes, lane);
        });
        lock_.lock();
        call_next(lane);
    }

    void unlock() noexcept { lock_.unlock(); }

    /// Whether somebody holds it, or waits for it in a lane above 0.
    [[nodiscard]] bool in_use() const noexcept {
        return lock_.held() || waits_above(lanes_.load_relaxed(), 0);
    }

private:
    // A lane's byte: the next ticket in its low half, whose turn it is in its high half.
    static constexpr std::uint64_t kHalf = 15;
    static constexpr std::uint64_t kNextTickets = 0x0F0F'0F0F'0F0F'0F0F;

    static constexpr std::uint64_t next_ticket(std::uint64_t lanes, unsigned lane) {
        return lanes >> (8 * lane) & kHalf;
    }
    static constexpr std::uint64_t serving(std::uint64_t lanes, unsigned lane) {
        return lanes >> (8 * lane + 4) & kHalf;
    }
    /// True if a ticket is out in some higher lane.
    static constexpr bool waits_above(std::uint64_t lanes, unsigned lane) {
        return lane + 1 < kLanes && ((lanes ^ lanes >> 4) & kNextTickets) >> (8 * (lane + 1)) != 0;
    }

    template <class Ready>
    void await(Ready ready) noexcept {
        std::uint64_t lanes = lanes_.load_relaxed();
        for (int spin = 0; !ready(lanes); lanes = lanes_.load_relaxed(), ++spin) {
            if (spin < Spins)
                spin_pause();
            else
                lanes_.wait(lanes);
        }
    }

    std::uint64_t draw(unsigned lane) noexcept {
        for (;;) {
            std::uint64_t found = lanes_.load_relaxed();
            const std::uint64_t ticket = next_ticket(found, lane);
            const std::uint64_t after = (ticket + 1) & kHalf;
            if (after == serving(found, lane)) {
                lanes_.wait(found);
                continue;
            }
            const std::uint64_t others = found & ~(kHalf << (8 * lane));
            if (lanes_.compare_exchange(found, others | after << (8 * lane)))
                return ticket;
        }
    }

    void call_next(unsigned lane) noexcept {
        std::uint64_t found = lanes_.load_relaxed();
        for (;;) {
            const std::uint64_t next = (serving(found, lane) + 1) & kHalf;
            const std::uint64_t others = found & ~(kHalf << (8 * lane + 4));
            if (lanes_.compare_exchange(found, others | next << (8 * lane + 4)))
                break;
        }
        lanes_.notify_all();
    }

    BasicCommitLock<Word, Spins> lock_;
    Word& lanes_;
};

using PriorityLock = BasicPriorityLock<Word>;

}  // namespace tfdb::sync
