#include "tfdb/store/writer_lock.hpp"

#include <utility>

#include "tfdb/base/error.hpp"

namespace tfdb::store {

using memory::Control;

void WriterLock::check_writable() const {
    if (shared_->writable)
        return;
    ErrorDetail detail;
    detail.path = shared_->path;
    throw ReadOnly("the store " + shared_->path +
                       " was opened for reading only: open it with mode \"rw\" to write to it",
                   std::move(detail));
}

void WriterLock::took(Control::Taken taken) noexcept {
    if (taken != Control::Taken::kAfterDeath)
        return;
    repairs_.repair();
    shared_->control->consistent();
}

void WriterLock::lock_shared() {
    try {
        check_writable();
        const Control::Taken taken = shared_->control->lock(kLongestWaitNs);
        if (taken == Control::Taken::kNo) {
            ErrorDetail detail;
            detail.path = shared_->path;
            detail.pid = shared_->control->holder();
            detail.limit = kLongestWaitNs;
            throw LockTimeout("process " + std::to_string(*detail.pid) + " has held the store " +
                                  shared_->path +
                                  " for 10 s: it may be stopped (SIGSTOP); let it "
                                  "go on, or end it, which frees the store",
                              std::move(detail));
        }
        took(taken);
    } catch (...) {
        own_.unlock();
        throw;
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
