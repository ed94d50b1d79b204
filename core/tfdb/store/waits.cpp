#include "tfdb/store/waits.hpp"

#include <algorithm>
#include <array>
#include <utility>

#include "tfdb/base/error.hpp"
#include "tfdb/memory/file.hpp"
#include "tfdb/store/path_frames.hpp"
#include "tfdb/store/store.hpp"
#include "tfdb/store/validate.hpp"
#include "tfdb/sync/event_count.hpp"

namespace tfdb::store {

using txn::FeedNote;

/// A wait's dependence on a frame, in the frame's list.
struct Waits::Look {
    FrameId frame;
    Wait* wait;
    Look* next = nullptr;
    Look** from = nullptr;  // what points to this one
};

/// One wait, for an answer or for a commit; or a watch, which goes on when it was touched.
/// Threads: as Waits. Guarantee: none.
struct Waits::Wait {
    explicit Wait(const sync::Word& of_watch) : closed(&of_watch) {}
    explicit Wait(const Question& asked) : question(asked) {}
    explicit Wait(CommitNumber commit) : after(commit) {}

    /// Names of its own, for it outlives its caller's.
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
    std::uint64_t touched = 0;  // the round that found it touched last
    Sleeper* sleepers = nullptr;
    std::uint64_t number = 0;  // of one that was begun
    WaitEnd how = WaitEnd::kTimedOut;
    const sync::Word* closed = nullptr;  // a watch's; null: it is none
    // A watch: nothing touched its looks after the one commit, until the other; none: to the newest
    // that was looked at.
    CommitNumber quiet_after = 0;
    std::optional<CommitNumber> quiet_until{};
    std::uint64_t news = 0;  // how often it was touched, or got other looks
};

/// A thread that waits. Threads: as Waits. Guarantee: in the wait's list for its lifetime.
struct Waits::Sleeper {
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
    WaitGroup::Waiter waiter{};
    WaitEnd how = WaitEnd::kTimedOut;
};

Patience::Patience(std::optional<std::int64_t> longest_ns) {
    const std::int64_t now = sync::steady_now();
    if (longest_ns && *longest_ns < until_ - now)
        until_ = now + *longest_ns;
}

std::int64_t Patience::left() const {
    constexpr auto kForEver = std::numeric_limits<std::int64_t>::max();
    return until_ == kForEver ? kForEver : until_ - sync::steady_now();
}

Waits::Waits(const Store& store, sync::Word& commit_event)
    : store_(store), forks_(sync::forks()), group_(commit_event) {}

Waits::~Waits() = default;

WaitEnd Waits::wait(const Question& question, Patience patience) {
    Wait wait(question);
    return this->wait(wait, patience);
}

WaitEnd Waits::wait(CommitNumber after, Patience patience) {
    Wait wait(after);
    return this->wait(wait, patience);
}

WaitEnd Waits::wait(Wait& wait, Patience patience) {
    const WaitGroup::Locked locked(group_);
    if (!add(wait))
        return wait.how;
    try {
        Sleeper me(wait);
        group_.wait(
            me.waiter, [this] { look(); }, patience);
    } catch (...) {
        remove(wait);
        throw;
    }
    remove(wait);
    return wait.how;
}

std::uint64_t Waits::begin(const Question& question) {
    auto wait = std::make_unique<Wait>(question);
    wait->keep_names();
    return begin(std::move(wait));
}

std::uint64_t Waits::begin(CommitNumber after) {
    return begin(std::make_unique<Wait>(after));
}

std::uint64_t Waits::begin(std::unique_ptr<Wait> wait) {
    const WaitGroup::Locked locked(group_);
    // Room for all ends, so that ending a wait needs no memory.
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

bool Waits::cancel(std::uint64_t number) {
    const WaitGroup::Locked locked(group_);
    const auto found = begun_.find(number);
    if (found == begun_.end())
        return false;
    remove(*found->second);
    begun_.erase(found);
    return true;
}

void Waits::stay_until_ended(Patience patience) {
    look();
    if (!ended_.empty() || closed_ || patience.left() <= 0)
        return;
    WaitGroup::Waiter me;
    teller_ = &me;
    try {
        group_.wait(
            me, [this] { look(); }, patience);
    } catch (...) {
        teller_ = nullptr;
        throw;
    }
    teller_ = nullptr;
}

void Waits::await_ended(Patience patience) {
    const WaitGroup::Locked locked(group_);
    stay_until_ended(patience);
}

std::vector<EndedWait> Waits::ended(Patience patience) {
    const WaitGroup::Locked locked(group_);
    stay_until_ended(patience);
    std::vector<EndedWait> taken = ended_;
    ended_.clear();
    std::sort(taken.begin(), taken.end(),
              [](const EndedWait& a, const EndedWait& b) { return a.number < b.number; });
    return taken;
}

std::shared_ptr<Waits::Wait> Waits::new_watch(const sync::Word& closed) {
    return std::make_shared<Wait>(closed);
}

Waits::Looked Waits::look_at(Wait& watch, const std::vector<FrameId>& frames) {
    const WaitGroup::Locked locked(group_);
    if (watch.closed->load_acquire() != 0)
        return {};
    begin_looking();
    Looked looked{watch.quiet_after, watch.quiet_until.value_or(seen_), watch.news};
    if (enter(watch, frames)) {
        looked = {0, 0, ++watch.news};
        wake(watch, WaitEnd::kCame);
        group_.tell();
        watch.quiet_after = seen_;
    } else if (watch.quiet_until) {
        watch.quiet_after = seen_;
    }
    watch.quiet_until.reset();
    return looked;
}

WaitEnd Waits::sleep(Wait& watch, std::uint64_t news, Patience patience) {
    const WaitGroup::Locked locked(group_);
    // Without looks: it is closed, or was ended by a stop since when waits may begin again.
    if (watch.news != news || watch.closed->load_acquire() != 0 ||
        (watch.looks.empty() && !closed_))
        return WaitEnd::kCame;
    if (closed_)
        return *closed_;
    Sleeper me(watch);
    group_.wait(
        me.waiter, [this] { look(); }, patience);
    return me.how;
}

void Waits::leave(Wait& watch) noexcept {
    const WaitGroup::Locked locked(group_);
    remove(watch);
    wake(watch, WaitEnd::kCame);
    group_.tell();
}

void Waits::close(WaitEnd how) {
    const WaitGroup::Locked locked(group_);
    look();  // what has come has come
    if (closed_ != WaitEnd::kClosed)
        closed_ = how;
    end_all(how);
    if (teller_ != nullptr)
        group_.end(*teller_);
    group_.tell();
}

void Waits::reopen() {
    const WaitGroup::Locked locked(group_);
    if (closed_ == WaitEnd::kStopped)
        closed_.reset();
}

/// False: it has ended already, with `how`.
bool Waits::add(Wait& wait) {
    begin_looking();
    if (is_answered(wait))
        wait.how = WaitEnd::kCame;
    else if (closed_)
        wait.how = *closed_;
    else
        (void)enter(wait, frames_of(wait));
    return !wait.looks.empty();
}

void Waits::begin_looking() {
    if (!looks_.empty())
        return;
    seen_ = store_.committed();
    seen_removals_ = store_.removals();
}

void Waits::remove(Wait& wait) noexcept {
    unlink(wait.looks);
    wait.looks.clear();
}

/// All or nothing, if it throws. False: it looks at these frames already.
bool Waits::enter(Wait& wait, const std::vector<FrameId>& frames) {
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

/// Of these frames, those that no wait depends on.
void Waits::forget(const std::vector<FrameId>& frames) noexcept {
    for (const FrameId frame : frames) {
        const auto found = looks_.find(frame);
        if (found != looks_.end() && found->second == nullptr)
            looks_.erase(found);
    }
}

void Waits::unlink(std::vector<Look>& looks) noexcept {
    for (Look& look : looks) {
        *look.from = look.next;
        if (look.next != nullptr)
            look.next->from = look.from;
        else if (const auto found = looks_.find(look.frame); found->second == nullptr)
            looks_.erase(found);
    }
}

void Waits::wake(Wait& wait, WaitEnd how) noexcept {
    for (Sleeper* sleeper = wait.sleepers; sleeper != nullptr; sleeper = sleeper->next) {
        sleeper->how = how;
        group_.end(sleeper->waiter);
    }
}

void Waits::end(Wait& wait, WaitEnd how) noexcept {
    remove(wait);
    wait.how = how;
    wake(wait, how);
    if (wait.number == 0)
        return;
    ended_.push_back({wait.number, how});
    begun_.erase(wait.number);
    if (teller_ != nullptr)
        group_.end(*teller_);
}

void Waits::end_all(WaitEnd how) noexcept {
    while (!looks_.empty())
        end(*looks_.begin()->second->wait, how);
}

bool Waits::is_answered(Wait& wait) {
    if (wait.after)
        return store_.committed() > *wait.after;
    Failure failure;
    const Question& question = wait.question;
    if (!ask(store_, kNewest, wait.question, answer_, failure))
        return false;
    return question.kind != Question::kCommonTime || !question.stamp ||
           answer_.stamp >= *question.stamp;
}

/// After it was asked: what must change before the answer can be another one. The frames up to
/// both roots, for whatever their edges say decides; of one that had several parents anything may.
/// A root is touched by the commit that gives it a parent.
std::vector<FrameId> Waits::frames_of(const Wait& wait) const {
    constexpr int kTries = 4;
    if (wait.after)
        return {kCommits};
    const Question& question = wait.question;
    std::vector<FrameId> frames;
    bool whole = false;
    for (int i = 0; i < kTries && !whole; ++i) {
        frames.clear();
        const StoreView view = store_.view(store_.committed());
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

/// What was committed since it looked last.
void Waits::look() {
    if (const std::uint64_t now = store_.removals(); now != seen_removals_) {
        seen_removals_ = now;
        end_all(WaitEnd::kRemoved);
    }
    const CommitNumber newest = store_.committed();
    if (newest != seen_ && !looks_.empty()) {
        collect_touched(newest);
        for (Wait* const wait : touched_) {
            if (wait->closed != nullptr) {
                if (!wait->quiet_until)
                    wait->quiet_until = seen_;
                ++wait->news;
                wake(*wait, WaitEnd::kCame);
            } else if (is_answered(*wait)) {
                end(*wait, WaitEnd::kCame);
            } else {
                (void)enter(*wait, frames_of(*wait));
            }
        }
    }
    // Last: after an exception the next look begins anew.
    seen_ = newest;
}

void Waits::collect_touched(CommitNumber newest) {
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

/// Those that the notes name, each once however often it is noted, and what stands for more.
const std::vector<FrameId>& Waits::noted_frames(CommitNumber newest) {
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

}  // namespace tfdb::store

namespace tfdb {
namespace {

void check_can_wait(const store::Store& store) {
    if (store.engine != nullptr) {
        throw NotSupported("waits are not supported by the engine '" +
                           std::string(concurrency_name(store.concurrency)) +
                           "': only by the default one, 'snapshot'");
    }
    store::check_not_in_transaction(store);
}

/// Whether a commit after that one is there, even if waits are not supported.
bool is_there(const store::Store& store, CommitNumber after) {
    check_can_wait(store);
    return store.committed() > after;
}

bool came(const store::Store& store, WaitEnd end) {
    if (end == WaitEnd::kClosed || end == WaitEnd::kRemoved)
        store::raise_ended_wait(store, end);
    return end == WaitEnd::kCame;
}

}  // namespace

namespace store {

Waits& waits_of(const Store& store) {
    check_can_wait(store);
    if (store.shared != nullptr && store.shared->control == nullptr) {
        ErrorDetail detail;
        detail.path = store.shared->path;
        if (store.shared->frozen)
            throw NotSupported(
                memory::named(store.shared->path) + " is frozen and gets no further commit",
                std::move(detail));
        throw NotSupported("this process cannot wait for commits to " +
                               memory::named(store.shared->path) +
                               ": this process may not write to its control file; ask its owner "
                               "for permission, or poll it",
                           std::move(detail));
    }
    return store.waits();
}

void raise_ended_wait(const Store& store, WaitEnd end) {
    if (end == WaitEnd::kClosed)
        throw BufferClosed("the buffer was closed: open the store again, or create another Buffer");
    ErrorDetail detail;
    const std::string path = store.shared == nullptr ? std::string() : store.shared->path;
    detail.path = path;
    detail.reason = "removed";
    throw NoSuchStore(
        "the store " + memory::named(path) + " was removed during the wait, which may never end",
        std::move(detail));
}

}  // namespace store

bool Buffer::wait_for(const Question& question, std::optional<std::int64_t> timeout_ns) const {
    store::check_may_exist(question);
    return came(*store_, store::waits_of(*store_).wait(question, store::Patience(timeout_ns)));
}

bool Buffer::wait_for_commit(CommitNumber after, std::optional<std::int64_t> timeout_ns) const {
    return is_there(*store_, after) ||
           came(*store_, store::waits_of(*store_).wait(after, store::Patience(timeout_ns)));
}

std::uint64_t Buffer::begin_wait(const Question& question) const {
    store::check_may_exist(question);
    return store::waits_of(*store_).begin(question);
}

std::uint64_t Buffer::begin_wait_for_commit(CommitNumber after) const {
    return is_there(*store_, after) ? 0 : store::waits_of(*store_).begin(after);
}

bool Buffer::cancel_wait(std::uint64_t number) const {
    return store_->waits().cancel(number);
}

std::vector<EndedWait> Buffer::ended_waits(std::optional<std::int64_t> timeout_ns) const {
    return store_->waits().ended(store::Patience(timeout_ns));
}

void Buffer::await_ended_waits(std::optional<std::int64_t> timeout_ns) const {
    store_->waits().await_ended(store::Patience(timeout_ns));
}

void Buffer::raise_ended_wait(WaitEnd end) const {
    store::raise_ended_wait(*store_, end);
}

void Buffer::end_waits() const {
    store_->waits_ended.store_release(1);
    store_->waits().close(WaitEnd::kClosed);
    sync::EventCount(store_->clock_event).notify();
}

void Buffer::stop_waits(bool stop) const {
    store::Waits& waits = store_->waits();
    if (stop)
        waits.close(WaitEnd::kStopped);
    else
        waits.reopen();
}

}  // namespace tfdb
