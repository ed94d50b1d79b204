// Waits for answers and commits: woken by the commit that touched a frame they depend on.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "tfdb/base/interruption.hpp"
#include "tfdb/store/feed_notes.hpp"
#include "tfdb/store/path_frames.hpp"
#include "tfdb/store/question.hpp"
#include "tfdb/store/wait_end.hpp"
#include "tfdb/sync/fork.hpp"
#include "tfdb/sync/wait_group.hpp"

namespace tfdb::store {

/// The remaining time of a wait, which a signal may end.
/// Threads: one. Guarantee: none.
class Deadline {
public:
    /// None: unlimited.
    explicit Deadline(std::optional<std::int64_t> longest_ns);
    [[nodiscard]] std::int64_t left() const;
    [[nodiscard]] static bool heeds_signals() { return Interruption::current() != nullptr; }
    static void signalled() { interruption_point(); }

private:
    std::int64_t until_ = std::numeric_limits<std::int64_t>::max();
};

/// The waits and watches of one process on one store. The leading thread reads the change feed and
/// repeats the question of each wait whose path a commit touched or whose missing frame it created.
/// For a watch it wakes the threads. `Store` is another class in interleaving walks.
/// Threads: any. Guarantee: `wait`, `sleep` and `ended` block; the other calls block only each
/// other. Each wait ends once, with a `WaitEnd`.
template <class Store>
class BasicWaits {
    using WaitGroup = typename Store::WaitGroup;
    using Word = typename Store::Word;
    using Locked = typename WaitGroup::Locked;
    struct Look;
    struct Sleeper;

public:
    /// `commit_event`: notified after each commit.
    BasicWaits(const Store& store, Word& commit_event)
        : store_(store), forks_(sync::forks()), group_(commit_event) {}
    BasicWaits(const BasicWaits&) = delete;
    BasicWaits& operator=(const BasicWaits&) = delete;

    /// The process of the waiting threads: see `sync::forks`.
    [[nodiscard]] std::uint64_t forks() const { return forks_; }

    /// One wait, for an answer or for a commit; or a watch, which continues after it was touched.
    /// Threads: as Waits. Guarantee: none.
    struct Wait {
        explicit Wait(const Word& of_watch) : closed(&of_watch) {}
        explicit Wait(const Question& asked) : question(asked) {}
        explicit Wait(CommitNumber commit) : after(commit) {}

        /// Copies the names, because the wait outlives its caller's.
        void keep_names() {
            FrameRef* const frames[] = {&question.target, &question.source, &question.fixed};
            for (std::size_t i = 0; i < names.size(); ++i) {
                if (frames[i]->name.data() == nullptr)
                    continue;
                names[i] = frames[i]->name;
                frames[i]->name = names[i];
            }
        }

        Question question{};
        std::optional<CommitNumber> after{};  // instead of the question
        std::array<std::string, 3> names{};
        std::vector<Look> looks{};  // each frame once
        std::uint64_t touched = 0;  // the last round that found it touched
        Sleeper* sleepers = nullptr;
        std::uint64_t number = 0;  // of a begun wait
        WaitEnd how = WaitEnd::kTimedOut;
        const Word* closed = nullptr;  // the watch's; null: not a watch
        // A watch: no commit after the first number touched its looks, up to the second; none: up
        // to the newest commit checked.
        CommitNumber quiet_after = 0;
        std::optional<CommitNumber> quiet_until{};
        std::uint64_t wakeups = 0;  // how often it was touched or its looks changed
    };

    /// Waits until the question has an answer.
    [[nodiscard]] WaitEnd wait(const Question& question, Deadline deadline) {
        Wait asked(question);
        return wait(asked, deadline);
    }
    /// Waits for a commit after this one.
    [[nodiscard]] WaitEnd wait(CommitNumber after, Deadline deadline) {
        Wait asked(after);
        return wait(asked, deadline);
    }

    /// Non-blocking form; `ended` reports completion. Returns the wait's number; 0: the answer
    /// already exists.
    [[nodiscard]] std::uint64_t begin(const Question& question) {
        auto asked = std::make_unique<Wait>(question);
        asked->keep_names();
        return begin(std::move(asked));
    }
    [[nodiscard]] std::uint64_t begin(CommitNumber after) {
        return begin(std::make_unique<Wait>(after));
    }
    /// Cancels the wait. False: it had already ended.
    bool cancel(std::uint64_t number) {
        const Locked locked(group_);
        const auto found = begun_.find(number);
        if (found == begun_.end())
            return false;
        remove(*found->second);
        begun_.erase(found);
        return true;
    }
    /// Waits until some begun waits end, and takes them, in the order of their begin. Empty: all
    /// were cancelled, or the deadline passed. After the deadline the call does not block.
    [[nodiscard]] std::vector<EndedWait> ended(Deadline deadline) {
        const Locked locked(group_);
        stay_until_ended(deadline);
        std::vector<EndedWait> taken = ended_;
        ended_.clear();
        std::sort(taken.begin(), taken.end(),
                  [](const EndedWait& a, const EndedWait& b) { return a.number < b.number; });
        return taken;
    }
    /// The same without taking them. Only one thread at a time waits in these two.
    void await_ended(Deadline deadline) {
        const Locked locked(group_);
        stay_until_ended(deadline);
    }

    struct Looked {
        // No commit after the first number, up to the second, touched its looks.
        CommitNumber quiet_after = 0;
        CommitNumber quiet_until = 0;
        std::uint64_t wakeups = 0;    // for `sleep`
        CommitNumber last = kNewest;  // see `last`
    };
    /// Sets the frames that a watch looks at: sorted, without duplicates; kBirths and kCommits are
    /// allowed. If they differ from before, its threads wake as if they had been touched.
    [[nodiscard]] Looked look_at(Wait& watch, const std::vector<FrameId>& frames) {
        const Locked locked(group_);
        if (watch.closed->load_acquire() != 0)
            return {};
        begin_looking();
        Looked looked{watch.quiet_after, watch.quiet_until.value_or(seen_), watch.wakeups, last_};
        if (enter(watch, frames)) {
            looked = {0, 0, ++watch.wakeups, last_};
            wake(watch, WaitEnd::kCame);
            group_.notify();
            watch.quiet_after = seen_;
        } else if (watch.quiet_until) {
            watch.quiet_after = seen_;
        }
        watch.quiet_until.reset();
        return looked;
    }
    /// Waits until one of them is touched; returns at once if that happened since that `look_at`.
    [[nodiscard]] WaitEnd sleep(Wait& watch, std::uint64_t wakeups, Deadline deadline) {
        const Locked locked(group_);
        // Without looks: it is closed, or a stop ended it and waits may begin again.
        if (watch.wakeups != wakeups || watch.closed->load_acquire() != 0 ||
            (watch.looks.empty() && !closed_))
            return WaitEnd::kCame;
        if (closed_)
            return *closed_;
        Sleeper me(watch);
        group_.wait(
            me.waiter, [this] { look(); }, deadline);
        return me.how;
    }
    /// The watch looks at no frame any more, and its threads wake as if it had been touched.
    void leave(Wait& watch) noexcept {
        const Locked locked(group_);
        remove(watch);
        wake(watch, WaitEnd::kCame);
        group_.notify();
    }

    /// The last commit that waits and watches report. After the store's removal: the newest one at
    /// the time when this process noticed it, so that followers end although others still write.
    [[nodiscard]] CommitNumber last() {
        const Locked locked(group_);
        heed_removal();
        return last_;
    }

    /// Ends all current and future waits, as kClosed or kStopped.
    void close(WaitEnd how) {
        const Locked locked(group_);
        look();  // earlier commits count
        end_all(how);
        if (ends_waiter_ != nullptr)
            group_.end(*ends_waiter_);
        group_.notify();
    }
    /// Allows new waits after kStopped.
    void reopen() {
        const Locked locked(group_);
        if (closed_ == WaitEnd::kStopped)
            closed_.reset();
    }

private:
    /// A wait's dependence on a frame, an entry in the frame's list.
    struct Look {
        FrameId frame;
        Wait* wait;
        Look* next = nullptr;
        Look** from = nullptr;  // the pointer to this one
    };
    /// A waiting thread. Threads: as Waits. Guarantee: in the wait's list for its lifetime.
    struct Sleeper {
        explicit Sleeper(Wait& slept_for) : wait(slept_for), next(slept_for.sleepers) {
            wait.sleepers = this;
        }
        ~Sleeper() {
            Sleeper** from = &wait.sleepers;
            while (*from != this)
                from = &(*from)->next;
            *from = next;
        }
        Sleeper(const Sleeper&) = delete;
        Sleeper& operator=(const Sleeper&) = delete;

        Wait& wait;
        Sleeper* next;
        typename WaitGroup::Waiter waiter{};
        WaitEnd how = WaitEnd::kTimedOut;
    };

    [[nodiscard]] WaitEnd wait(Wait& wait, Deadline deadline) {
        const Locked locked(group_);
        if (!add(wait))
            return wait.how;
        try {
            Sleeper me(wait);
            group_.wait(
                me.waiter, [this] { look(); }, deadline);
        } catch (...) {
            remove(wait);
            throw;
        }
        remove(wait);
        return wait.how;
    }
    [[nodiscard]] std::uint64_t begin(std::unique_ptr<Wait> wait) {
        const Locked locked(group_);
        // Reserves space for all ends, so that ending a wait does not allocate.
        if (const std::size_t ends = ended_.size() + begun_.size() + 1; ends > ended_.capacity())
            ended_.reserve(2 * ends);
        Wait& begun = *wait;
        begun.number = ++last_number_;
        begun_.emplace(begun.number, std::move(wait));
        try {
            if (add(begun))
                return begun.number;
        } catch (...) {
            begun_.erase(begun.number);
            throw;
        }
        if (begun.how == WaitEnd::kCame) {
            begun_.erase(begun.number);
            return 0;
        }
        const std::uint64_t number = begun.number;
        end(begun, begun.how);
        return number;
    }
    void stay_until_ended(Deadline deadline) {
        look();
        if (!ended_.empty() || closed_ || deadline.left() <= 0)
            return;
        typename WaitGroup::Waiter me;
        ends_waiter_ = &me;
        try {
            group_.wait(
                me, [this] { look(); }, deadline);
        } catch (...) {
            ends_waiter_ = nullptr;
            throw;
        }
        ends_waiter_ = nullptr;
    }

    /// False: it has already ended, with `how`.
    bool add(Wait& wait) {
        begin_looking();
        if (is_answered(wait))
            wait.how = WaitEnd::kCame;
        else if (closed_)
            wait.how = *closed_;
        else
            (void)enter(wait, frames_of(wait));
        return !wait.looks.empty();
    }
    void begin_looking() {
        heed_removal();
        if (looks_.empty())
            seen_ = store_.committed();
    }
    void heed_removal() {
        if (store_.removed() && last_ == kNewest)
            look();
    }
    void remove(Wait& wait) noexcept {
        unlink(wait.looks);
        wait.looks.clear();
    }
    /// All or nothing if it throws. False: it already looks at these frames.
    bool enter(Wait& wait, const std::vector<FrameId>& frames) {
        const auto is_of = [](const Look& look, FrameId frame) { return look.frame == frame; };
        if (std::equal(wait.looks.begin(), wait.looks.end(), frames.begin(), frames.end(), is_of))
            return false;
        std::vector<Look> looks;
        try {
            for (const FrameId frame : frames) {
                looks_.try_emplace(frame, nullptr);
                looks.push_back({frame, &wait});
            }
        } catch (...) {
            forget(frames);
            throw;
        }
        for (Look& look : looks) {
            Look*& first = looks_.find(look.frame)->second;
            look.next = first;
            look.from = &first;
            if (first != nullptr)
                first->from = &look.next;
            first = &look;
        }
        wait.looks.swap(looks);
        unlink(looks);
        return true;
    }
    /// Forgets those of these frames on which no wait depends.
    void forget(const std::vector<FrameId>& frames) noexcept {
        for (const FrameId frame : frames) {
            const auto found = looks_.find(frame);
            if (found != looks_.end() && found->second == nullptr)
                looks_.erase(found);
        }
    }
    void unlink(std::vector<Look>& looks) noexcept {
        for (Look& look : looks) {
            *look.from = look.next;
            if (look.next != nullptr)
                look.next->from = look.from;
            else if (const auto found = looks_.find(look.frame); found->second == nullptr)
                looks_.erase(found);
        }
    }
    void wake(Wait& wait, WaitEnd how) noexcept {
        for (Sleeper* sleeper = wait.sleepers; sleeper != nullptr; sleeper = sleeper->next) {
            if (sleeper->waiter.ended())
                continue;
            sleeper->how = how;
            group_.end(sleeper->waiter);
        }
    }
    void end(Wait& wait, WaitEnd how) noexcept {
        remove(wait);
        wait.how = how;
        wake(wait, how);
        if (wait.number == 0)
            return;
        ended_.push_back({wait.number, how});
        begun_.erase(wait.number);
        if (ends_waiter_ != nullptr)
            group_.end(*ends_waiter_);
    }
    /// Ends all current and future waits. A later call changes how only to a stronger end.
    void end_all(WaitEnd how) noexcept {
        closed_ = std::min(closed_.value_or(how), how);
        while (!looks_.empty())
            end(*looks_.begin()->second->wait, how);
    }
    bool is_answered(Wait& wait) {
        if (wait.after)
            return std::min(store_.committed(), last_) > *wait.after;
        Failure failure;
        const Question& question = wait.question;
        if (!ask(store_, kNewest, wait.question, answer_, failure))
            return false;
        return question.kind != Question::kCommonTime || !question.stamp ||
               answer_.stamp >= *question.stamp;
    }
    /// After a failed question: the frames that must change before the answer can change. They are
    /// the frames up to both roots, because any of their edges may decide. If a frame had several
    /// parents, every commit may matter. The commit that gives a root a parent touches it.
    [[nodiscard]] std::vector<FrameId> frames_of(const Wait& wait) const {
        constexpr int kTries = 4;
        if (wait.after)
            return {kCommits};
        const Question& question = wait.question;
        std::vector<FrameId> frames;
        bool whole = false;
        for (int i = 0; i < kTries && !whole; ++i) {
            frames.clear();
            const auto view = store_.view(store_.committed());
            const auto add = [&](const FrameRef& frame) {
                Chain chain;
                if (frame.handle.id >= store_.frames.count())
                    chain.frames.push_back(kBirths);
                else if (!climb(view, frame.handle.id, chain))
                    return false;
                else if (chain.sure < chain.frames.size())
                    chain.frames.push_back(kCommits);
                frames.insert(frames.end(), chain.frames.begin(), chain.frames.end());
                return true;
            };
            whole = add(question.target) && add(question.source) &&
                    (question.kind != Question::kFull || add(question.fixed));
        }
        if (!whole)
            frames.push_back(kCommits);
        std::sort(frames.begin(), frames.end());
        frames.erase(std::unique(frames.begin(), frames.end()), frames.end());
        return frames;
    }

    /// Checks the commits since the last look.
    void look() {
        const bool removed = store_.removed();
        const CommitNumber newest = store_.committed();
        if (newest != seen_ && !looks_.empty()) {
            collect_touched(newest);
            for (Wait* const wait : touched_) {
                if (wait->closed != nullptr) {
                    if (!wait->quiet_until)
                        wait->quiet_until = seen_;
                    ++wait->wakeups;
                    wake(*wait, WaitEnd::kCame);
                } else if (is_answered(*wait)) {
                    end(*wait, WaitEnd::kCame);
                } else {
                    (void)enter(*wait, frames_of(*wait));
                }
            }
        }
        // Last: after an exception the next look starts here again.
        seen_ = newest;
        if (removed && last_ == kNewest) {
            last_ = newest;
            end_all(WaitEnd::kRemoved);
        }
    }
    void collect_touched(CommitNumber newest) {
        touched_.clear();
        ++round_;
        const auto collect = [this](const Look* look) {
            for (; look != nullptr; look = look->next) {
                if (look->wait->touched == round_)
                    continue;
                look->wait->touched = round_;
                touched_.push_back(look->wait);
            }
        };
        if (!notes_.read(store_, seen_ + 1, newest)) {
            for (const auto& [frame, first] : looks_)
                collect(first);
            return;
        }
        for (const FrameId frame : noted_frames(newest)) {
            if (const auto found = looks_.find(frame); found != looks_.end())
                collect(found->second);
        }
    }
    /// The frames in the notes, each once, and the special ids for more.
    const std::vector<FrameId>& noted_frames(CommitNumber newest) {
        using txn::FeedNote;
        noted_.assign(1, kCommits);
        for (CommitNumber commit = seen_ + 1; commit <= newest; ++commit) {
            notes_.for_each(commit, [this](std::uint64_t note, const std::string& /*name*/) {
                if ((FeedNote::what(note) & FeedNote::kMade) != 0)
                    noted_.push_back(kBirths);
                noted_.push_back(FeedNote::id(note));
            });
        }
        std::sort(noted_.begin(), noted_.end());
        noted_.erase(std::unique(noted_.begin(), noted_.end()), noted_.end());
        return noted_;
    }

    const Store& store_;
    std::uint64_t forks_;
    WaitGroup group_;
    // All of these require the group's lock.
    std::unordered_map<FrameId, Look*> looks_;  // the first wait of each frame; no list is empty
    CommitNumber seen_ = 0;                     // changes up to this commit have been checked
    CommitNumber last_ = kNewest;               // see `last`
    std::optional<WaitEnd> closed_{};           // how every wait ends from now on
    std::uint64_t last_number_ = 0;
    std::unordered_map<std::uint64_t, std::unique_ptr<Wait>> begun_;
    std::vector<EndedWait> ended_;
    typename WaitGroup::Waiter* ends_waiter_ = nullptr;  // the thread that waits for ends, or null
    FeedNotes notes_;
    std::vector<FrameId> noted_;
    std::vector<Wait*> touched_;
    std::uint64_t round_ = 0;
    Answer answer_;
};

extern template class BasicWaits<Store>;

/// Throws NotSupported, TransactionActive, Forked.
[[nodiscard]] Waits& waits_of(const Store& store);
[[noreturn]] void raise_ended_wait(const Store& store, WaitEnd end);

}  // namespace tfdb::store
