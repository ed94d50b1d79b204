#include "tfdb/store/watch.hpp"

#include <mutex>

#include "tfdb/base/error.hpp"
#include "tfdb/store/store.hpp"
#include "tfdb/store/touches.hpp"
#include "tfdb/store/validate.hpp"
#include "tfdb/store/waits.hpp"
#include "tfdb/sync/commit_lock.hpp"

namespace tfdb {

struct Watch::State {
    State(std::shared_ptr<store::Store> of, store::Waits& waits_here, const Watched& watched)
        : store(std::move(of)), waits(waits_here), touches(*store, watched) {}
    ~State() { leave(); }
    State(const State&) = delete;
    State& operator=(const State&) = delete;

    /// A child of the process that made it has waits of its own.
    [[nodiscard]] bool is_at_home() const { return waits.forks() == sync::forks(); }

    void leave() {
        if (is_at_home())
            waits.leave(*wait);
    }
    /// The commits after `after` that touched something. Where there are none, the waits look at
    /// all that the next one may touch, and have done so since before the feed was read. `news`:
    /// for `Waits::sleep`.
    [[nodiscard]] std::vector<Touch> read(CommitNumber after, std::size_t limit,
                                          std::uint64_t& news) {
        const std::lock_guard<sync::CommitLock> guard(lock);
        touches.begin(after);
        const store::Waits::Looked looked = waits.look_at(*wait, touches.frames());
        touches.skip(looked.quiet_after, looked.quiet_until);
        news = looked.news;
        return touches.read(limit);
    }

    std::shared_ptr<store::Store> store;
    store::Waits& waits;
    sync::Word closed{};
    std::shared_ptr<store::Waits::Wait> wait = store::Waits::new_watch(closed);
    sync::Word lock_word{};
    sync::CommitLock lock{lock_word};
    store::Touches touches;  // the lock is held
};

Watch::Watch(std::unique_ptr<State> state) : state_(std::move(state)) {}

Watch::~Watch() = default;

void Watch::close() {
    state_->closed.store_release(1);
    state_->leave();
}

bool Watch::is_closed() const {
    return state_->closed.load_acquire() != 0;
}

void Watch::check_open() const {
    if (is_closed())
        throw WatchClosed("the watch is closed: make another by Buffer.watch()");
}

std::vector<Touch> Watch::next(CommitNumber after, std::optional<std::int64_t> timeout_ns,
                               std::size_t limit) {
    State& state = *state_;
    const store::Patience patience(timeout_ns);
    (void)store::waits_of(*state.store);
    if (!state.is_at_home()) {
        ErrorDetail detail;
        detail.reason = "forked";
        throw Forked(
            "this watch belongs to the process that made it, not to its child: make a "
            "watch in this process",
            std::move(detail));
    }
    for (;;) {
        check_open();
        std::uint64_t news = 0;
        std::vector<Touch> touched = state.read(after, limit, news);
        if (!touched.empty() || patience.left() <= 0)
            return touched;
        const WaitEnd end = state.waits.sleep(*state.wait, news, patience);
        if (end == WaitEnd::kClosed || end == WaitEnd::kRemoved)
            store::raise_ended_wait(*state.store, end);
        if (end != WaitEnd::kCame)
            return touched;
    }
}

std::shared_ptr<Watch> Buffer::watch(const Watched& watched) const {
    if (watched.frames.empty() && watched.pairs.empty() && !watched.every_commit)
        throw InvalidArgument("a watch needs at least one frame, or one pair of frames");
    for (const std::string& name : watched.frames)
        store::check_may_exist(name, "nothing would touch it: the");
    for (const auto& [target, source] : watched.pairs) {
        store::check_may_exist(target, "nothing would touch the pair: the target");
        store::check_may_exist(source, "nothing would touch the pair: the source");
    }
    store::Waits& waits = store::waits_of(*store_);
    return std::shared_ptr<Watch>(
        new Watch(std::make_unique<Watch::State>(store_, waits, watched)));
}

}  // namespace tfdb
