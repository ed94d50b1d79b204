#include "tfdb/store/waits.hpp"

#include <algorithm>
#include <utility>

#include "tfdb/base/error.hpp"
#include "tfdb/memory/file.hpp"
#include "tfdb/store/store.hpp"
#include "tfdb/store/validate.hpp"
#include "tfdb/sync/event_count.hpp"

namespace tfdb::store {

template class BasicWaits<Store>;

Deadline::Deadline(std::optional<std::int64_t> longest_ns) {
    const std::int64_t now = sync::steady_now();
    if (longest_ns && *longest_ns < until_ - now)
        until_ = now + *longest_ns;
}

std::int64_t Deadline::left() const {
    constexpr auto kForEver = std::numeric_limits<std::int64_t>::max();
    return until_ == kForEver ? kForEver : until_ - sync::steady_now();
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

/// Whether a later commit exists, even if waits are not supported.
bool is_there(const store::Store& store, CommitNumber after) {
    check_can_wait(store);
    return !store.removed() && store.committed() > after;
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
        "the store " + memory::named(path) + " was removed: no other process can open it",
        std::move(detail));
}

}  // namespace store

bool Buffer::wait_for(const Question& question, std::optional<std::int64_t> timeout_ns) const {
    store::check_may_exist(question);
    return came(*store_, store::waits_of(*store_).wait(question, store::Deadline(timeout_ns)));
}

bool Buffer::wait_for_commit(CommitNumber after, std::optional<std::int64_t> timeout_ns) const {
    return is_there(*store_, after) ||
           came(*store_, store::waits_of(*store_).wait(after, store::Deadline(timeout_ns)));
}

CommitNumber Buffer::last_to_follow() const {
    const CommitNumber newest = store_->committed();
    return store_->removed() ? std::min(newest, store_->waits().last()) : newest;
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
    return store_->waits().ended(store::Deadline(timeout_ns));
}

void Buffer::await_ended_waits(std::optional<std::int64_t> timeout_ns) const {
    store_->waits().await_ended(store::Deadline(timeout_ns));
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
