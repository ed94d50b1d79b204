// Cancellation of long work at defined points.
#pragma once

namespace tfdb {

/// Cancels the long work of one thread: the work polls it, and it throws to cancel. Threads: its
/// own. Guarantee: polled only where nothing is half-written except a read's output, and where the
/// thread holds no lock for which the canceller may wait.
class Interruption {
public:
    virtual void ask() = 0;

    /// This thread's interruption; null: its work cannot be cancelled.
    static Interruption*& current() noexcept {
        static constinit thread_local Interruption* here = nullptr;
        return here;
    }

    Interruption() = default;
    Interruption(const Interruption&) = delete;
    Interruption& operator=(const Interruption&) = delete;

protected:
    ~Interruption() = default;
};

/// A cancellation point of long work.
inline void interruption_point() {
    if (Interruption* const interruption = Interruption::current(); interruption != nullptr)
        interruption->ask();
}

/// No cancellation during its lifetime. Threads: its own. Guarantee: wait-free.
class NotInterrupted {
public:
    NotInterrupted() noexcept : before_(Interruption::current()) {
        Interruption::current() = nullptr;
    }
    ~NotInterrupted() { Interruption::current() = before_; }
    NotInterrupted(const NotInterrupted&) = delete;
    NotInterrupted& operator=(const NotInterrupted&) = delete;

private:
    Interruption* before_;
};

}  // namespace tfdb
