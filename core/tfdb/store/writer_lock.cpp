#include "tfdb/store/writer_lock.hpp"

#include <algorithm>
#include <utility>

#include "tfdb/base/error.hpp"
#include "tfdb/base/interruption.hpp"
#include "tfdb/store/store.hpp"

namespace tfdb::store {

using memory::Control;

void WriterLock::check_writable() const {
    if (shared_->writable)
        return;
    ErrorDetail detail;
    detail.path = shared_->path;
    if (shared_->frozen)
        throw ReadOnly("the store " + shared_->path +
                           " is frozen: nothing can be written to it; write to another Buffer, "
                           "and freeze that",
                       std::move(detail));
    throw ReadOnly("the store " + shared_->path +
                       " was opened for reading only: open it with mode \"rw\" to write to it",
                   std::move(detail));
}

void WriterLock::took(Control::Taken taken) {
    if (taken == Control::Taken::kBroken) {
        own_.unlock();
        ErrorDetail detail;
        detail.path = shared_->path;
        detail.reason = "lock";
        throw CorruptStore("the lock of the store " + shared_->path +
                               " was damaged: it can be read, but not written to; make it anew",
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
                             shared_->path + " for " + seconds(*detail.limit) +
                             ": it may be stopped (SIGSTOP); let it go on, or end it, which frees "
                             "the store";
    throw LockTimeout(text, std::move(detail));
}

void WriterLock::lock_shared(bool urgently) {
    try {
        check_writable();
    } catch (...) {
        own_.unlock();
        throw;
    }
    // Who finds it free need not look at the clock: that would take longer than the lock.
    if (const Control::Taken taken = shared_->control->try_lock(); taken != Control::Taken::kNo) {
        took(taken);
        return;
    }
    const std::int64_t limit = shared_->lock_timeout_ns;
    for (const std::int64_t began = sync::steady_now();;) {
        const std::int64_t left = limit - (sync::steady_now() - began);
        const Control::Taken taken =
            shared_->control->lock(std::clamp<std::int64_t>(left, 0, kTurnNs));
        if (taken != Control::Taken::kNo) {
            took(taken);
            return;
        }
        // The other threads get a turn, and this one's work may end.
        own_.unlock();
        if (left <= kTurnNs)
            throw_timeout();
        may_end();
        lock_own(urgently);
    }
}

bool WriterLock::try_lock_shared() {
    try {
        check_writable();
    } catch (...) {
        own_.unlock();
        throw;
    }
    const Control::Taken taken = shared_->control->try_lock();
    if (taken == Control::Taken::kNo) {
        own_.unlock();
        return false;
    }
    took(taken);
    return true;
}

}  // namespace tfdb::store
