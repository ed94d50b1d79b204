#include "tfdb/store/watch.hpp"

#include "tfdb/base/error.hpp"
#include "tfdb/store/store.hpp"
#include "tfdb/store/validate.hpp"
#include "tfdb/store/watcher.hpp"

namespace tfdb {

struct Watch::State {
    State(std::shared_ptr<store::Store> of, store::Waits& waits, const Watched& watched)
        : store(std::move(of)), watcher(*store, waits, watched) {}
    ~State() { watcher.leave(); }
    State(const State&) = delete;
    State& operator=(const State&) = delete;

    std::shared_ptr<store::Store> store;
    store::BasicWatcher<store::Store> watcher;
};

Watch::Watch(std::unique_ptr<State> state) : state_(std::move(state)) {}

Watch::~Watch() = default;

void Watch::close() {
    state_->watcher.close();
}

bool Watch::is_closed() const {
    return state_->watcher.is_closed();
}

void Watch::check_open() const {
    state_->watcher.check_open();
}

std::vector<Touch> Watch::next(CommitNumber after, std::optional<std::int64_t> timeout_ns,
                               std::size_t limit) {
    const store::Deadline deadline(timeout_ns);
    (void)store::waits_of(*state_->store);
    if (!state_->watcher.is_at_home()) {
        ErrorDetail detail;
        detail.reason = "forked";
        throw Forked(
            "this watch belongs to the process that made it, not to its child: make a "
            "watch in this process",
            std::move(detail));
    }
    return state_->watcher.next(after, deadline, limit);
}

std::shared_ptr<Watch> Buffer::watch(const Watched& watched) const {
    if (watched.frames.empty() && watched.pairs.empty() && !watched.every_commit)
        throw InvalidArgument("a watch needs at least one frame, or one pair of frames");
    for (const std::string& name : watched.frames)
        store::check_may_exist(name, "no commit can touch the watch: the");
    for (const auto& [target, source] : watched.pairs) {
        store::check_may_exist(target, "nothing would touch the pair: the target");
        store::check_may_exist(source, "nothing would touch the pair: the source");
    }
    store::Waits& waits = store::waits_of(*store_);
    return std::shared_ptr<Watch>(
        new Watch(std::make_unique<Watch::State>(store_, waits, watched)));
}

}  // namespace tfdb
