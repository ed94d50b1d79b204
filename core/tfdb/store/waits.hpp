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
#include "tfdb/store/feed_notes.hpp"
#include "tfdb/store/question.hpp"
#include "tfdb/store/wait_end.hpp"
#include "tfdb/sync/wait_group.hpp"

namespace tfdb::store {

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

/// The waits and watches of one process on one store. The leading thread reads the change feed and
/// repeats the question of each wait whose path a commit touched, or whose missing frame it made;
/// of a watch it wakes the threads.
/// Threads: any. Guarantee: `wait`, `sleep` and `ended` block, the others only against each other.
/// Each wait ends once, with a `WaitEnd`.
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

    /// What a watch looks at.
    struct Wait;
    /// `closed`: not 0 once it is closed.
    [[nodiscard]] static std::shared_ptr<Wait> new_watch(const sync::Word& closed);
    struct Looked {
        // The commits after the first, to the second, touched nothing.
        CommitNumber quiet_after = 0;
        CommitNumber quiet_until = 0;
        std::uint64_t news = 0;  // for `sleep`
    };
    /// Has a watch look at these frames from now on: sorted, each once; they may be kBirths and
    /// kCommits. If they are others than before, its threads wake as if they had been touched.
    [[nodiscard]] Looked look_at(Wait& watch, const std::vector<FrameId>& frames);
    /// Waits until one of them is touched; does not wait if that was so since that `look_at`.
    [[nodiscard]] WaitEnd sleep(Wait& watch, std::uint64_t news, Patience patience);
    /// The watch looks at nothing any more, and its threads wake as if it had been touched.
    void leave(Wait& watch) noexcept;

    /// All waits end now, and so do those that come: as kClosed or kStopped. The first kClosed
    /// stays.
    void close(WaitEnd how);
    /// Waits may begin again after kStopped.
    void reopen();

private:
    struct Look;
    struct Sleeper;
    using WaitGroup = sync::WaitGroup;

    [[nodiscard]] WaitEnd wait(Wait& wait, Patience patience);
    [[nodiscard]] std::uint64_t begin(std::unique_ptr<Wait> wait);
    [[nodiscard]] bool is_answered(Wait& wait);
    bool add(Wait& wait);
    void remove(Wait& wait) noexcept;
    bool enter(Wait& wait, const std::vector<FrameId>& frames);
    void begin_looking();
    void forget(const std::vector<FrameId>& frames) noexcept;
    void unlink(std::vector<Look>& looks) noexcept;
    void wake(Wait& wait, WaitEnd how) noexcept;
    void end(Wait& wait, WaitEnd how) noexcept;
    void end_all(WaitEnd how) noexcept;
    void stay_until_ended(Patience patience);
    void look();
    void collect_touched(CommitNumber newest);
    const std::vector<FrameId>& noted_frames(CommitNumber newest);
    [[nodiscard]] std::vector<FrameId> frames_of(const Wait& wait) const;

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
    FeedNotes notes_;
    std::vector<FrameId> noted_;
    std::vector<Wait*> touched_;
    std::uint64_t round_ = 0;
    Answer answer_;
};

/// Throws NotSupported, TransactionActive, Forked.
[[nodiscard]] Waits& waits_of(const Store& store);
[[noreturn]] void raise_ended_wait(const Store& store, WaitEnd end);

}  // namespace tfdb::store
