#include "tfdb/store/writer_lock.hpp"

#include <algorithm>
#include <utility>

#include "tfdb/base/error.hpp"
#include "tfdb/base/interruption.hpp"
#include "tfdb/memory/file.hpp"
#include "tfdb/store/store.hpp"

namespace tfdb::store {

using memory::Control;

void WriterLock::check_writable() const {
    if (shared_->writable)
        return;
    ErrorDetail detail;
    detail.path = shared_->path;
    if (shared_->frozen)
        throw ReadOnly("the store " + memory::named(shared_->path) +
                           " is frozen: nothing can be written to it; write to another Buffer, "
                           "and freeze that",
                       std::move(detail));
    throw ReadOnly("the store " + memory::named(shared_->path) +
                       " was opened for reading only: open it with mode \"rw\" to write to it",
                   std::move(detail));
}

void WriterLock::handle_result(Control::Taken taken) {
    if (taken == Control::Taken::kBroken) {
        own_.unlock();
        ErrorDetail detail;
        detail.path = shared_->path;
        detail.reason = "lock";
        throw CorruptStore("the lock of the store " + memory::named(shared_->path) +
                               " was damaged: it can be read, but not written to; create it again",
                           std::move(detail));
    }
    if (taken != Control::Taken::kAfterDeath)
        return;
    repairs_.repair();
    shared_->control->consistent();
}

void WriterLock::throw_timeout() const {
    ErrorDetail detail;
    detail.path = shared_->path;
    detail.pid = shared_->control->holder();
    detail.limit = shared_->lock_timeout_ns;
    const std::string text = "process " + std::to_string(*detail.pid) + " has held the store " +
                             memory::named(shared_->path) + " for " + seconds(*detail.limit) +
                             ": it may be stopped (SIGSTOP); resume it, or kill it, which frees "
                             "the store";
    throw LockTimeout(text, std::move(detail));
}

/// Requires the process's own lock, and releases it on failure.
bool WriterLock::try_lock_shared(std::int64_t longest_ns) {
    try {
        check_writable();
    } catch (...) {
        own_.unlock();
        throw;
    }
    // A free lock is taken without reading the clock, which would take longer.
    Control::Taken taken = shared_->control->try_lock();
    if (taken == Control::Taken::kNo && longest_ns > 0)
        taken = shared_->control->lock(longest_ns);
    if (taken == Control::Taken::kNo) {
        own_.unlock();
        return false;
    }
    handle_result(taken);
    return true;
}

void WriterLock::await(bool urgently) {
    const std::int64_t began = sync::steady_now();
    const std::int64_t limit = shared_ == nullptr ? 0 : shared_->lock_timeout_ns;
    for (std::int64_t waited = 0;; waited = sync::steady_now() - began) {
        if (own_.lock_within(kTurnNs, urgently)) {
            if (shared_ == nullptr ||
                try_lock_shared(std::clamp<std::int64_t>(limit - waited, 0, kTurnNs)))
                return;
        }
        if (shared_ != nullptr && sync::steady_now() - began >= limit &&
            shared_->control->is_held_elsewhere())
            throw_timeout();
        interruption_point();
    }
}

}  // namespace tfdb::store
