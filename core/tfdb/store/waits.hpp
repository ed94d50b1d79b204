// Waits for answers and commits: woken by the commit that touched a frame they depend on.
#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <unordered_map>
#include <vector>

#include "tfdb/base/interruption.hpp"
#include "tfdb/store/question.hpp"
#include "tfdb/store/wait_end.hpp"
#include "tfdb/sync/wait_group.hpp"

namespace tfdb::store {

struct Store;

/// How long one waits, and that a signal may end it.
/// Threads: one. Guarantee: none.
class Patience {
public:
    /// None: for ever.
    explicit Patience(std::optional<std::int64_t> longest_ns);
    [[nodiscard]] std::int64_t left() const;
    [[nodiscard]] static bool heeds_signals() { return Interruption::current() != nullptr; }
    static void signalled() { may_end(); }

private:
    std::int64_t until_ = std::numeric_limits<std::int64_t>::max();
};

/// The waits of one process on one store. The leading thread reads the change feed and
/// repeats the question of each wait whose path a commit touched, or whose missing frame it made.
/// Threads: any. Guarantee: `wait` and `ended` block, the others only against each other. Each
/// wait ends once, with a `WaitEnd`.
class Waits {
public:
    /// `commit_event`: notified behind each commit.
    Waits(const Store& store, sync::Word& commit_event);
    ~Waits();
    Waits(const Waits&) = delete;
    Waits& operator=(const Waits&) = delete;

    /// The process of the waiting threads: see `sync::forks`.
    [[nodiscard]] std::uint64_t forks() const { return forks_; }

    /// Waits until the question has an answer.
    [[nodiscard]] WaitEnd wait(const Question& question, Patience patience);
    /// Waits for a commit after this one.
    [[nodiscard]] WaitEnd wait(CommitNumber after, Patience patience);

    /// Non-blocking form; `ended` reports completion. Returns the wait's number; 0: the answer is
    /// there.
    [[nodiscard]] std::uint64_t begin(const Question& question);
    [[nodiscard]] std::uint64_t begin(CommitNumber after);
    /// Cancels the wait. False: it had already ended.
    bool cancel(std::uint64_t number);
    /// Waits for some of those to end, and takes them, as they were begun. None: they were all
    /// cancelled, or the patience was at an end. Without patience the call does not block.
    [[nodiscard]] std::vector<EndedWait> ended(Patience patience);
    /// The same, but takes none. One thread at a time waits in these two.
    void await_ended(Patience patience);

    /// All waits end now, and so do those that come: as kClosed or kStopped. The first kClosed
    /// stays.
    void close(WaitEnd how);
    /// Waits may begin again after kStopped.
    void reopen();

private:
    struct Wait;
    struct Look;
    using WaitGroup = sync::WaitGroup;
    // What a wait looks at beside frames. No frame has these numbers.
    static constexpr FrameId kBirths = kNoFrame;       // frames that are not there yet
    static constexpr FrameId kCommits = kNoFrame + 1;  // every commit

    [[nodiscard]] WaitEnd wait(Wait& wait, Patience patience);
    [[nodiscard]] std::uint64_t begin(std::unique_ptr<Wait> wait);
    [[nodiscard]] bool is_answered(Wait& wait);
    bool add(Wait& wait);
    void remove(Wait& wait) noexcept;
    void look_at(Wait& wait, const std::vector<FrameId>& frames);
    void forget(const std::vector<FrameId>& frames) noexcept;
    void unlink(std::vector<Look>& looks) noexcept;
    void end(Wait& wait, WaitEnd how) noexcept;
    void end_all(WaitEnd how) noexcept;
    void stay_until_ended(Patience patience);
    void look();
    void collect_touched(CommitNumber newest);
    const std::vector<FrameId>& noted_frames();
    [[nodiscard]] std::vector<FrameId> frames_of(const Wait& wait) const;
    void climb(FrameId from, std::vector<FrameId>& frames) const;
    [[nodiscard]] std::uint64_t removals() const;

    const Store& store_;
    std::uint64_t forks_;
    WaitGroup group_;
    // All of these: the group is locked.
    std::unordered_map<FrameId, Look*> looks_;  // the first wait of each frame; none is empty
    CommitNumber seen_ = 0;                     // what was changed until then has been looked at
    std::uint64_t seen_removals_ = 0;
    std::optional<WaitEnd> closed_{};  // how every wait ends from now on
    std::uint64_t last_number_ = 0;
    std::unordered_map<std::uint64_t, std::unique_ptr<Wait>> begun_;
    std::vector<EndedWait> ended_;
    WaitGroup::Waiter* teller_ = nullptr;  // the thread that waits for ends, or null
    std::vector<std::uint64_t> words_;     // of the feed
    std::vector<std::size_t> ends_;
    std::vector<FrameId> noted_;
    std::vector<Wait*> touched_;
    std::uint64_t round_ = 0;
    Answer answer_;
};

[[noreturn]] void raise_ended_wait(const Store& store, WaitEnd end);

}  // namespace tfdb::store
