// How long work is ended from outside, at places where it may end.
#pragma once

namespace tfdb {

/// Asked now and then by the long work of its thread; to end it, it throws.
/// Threads: its own. Guarantee: asked where no lock is held that others may wait for while they
/// keep this thread from going on, and where nothing is half-written but the output of a read.
class Interruption {
public:
    virtual void ask() = 0;

    /// That of this thread; null: its work cannot be interrupted.
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

/// Long work may end here.
inline void may_end() {
    if (Interruption* const interruption = Interruption::current(); interruption != nullptr)
        interruption->ask();
}

/// Between its beginning and its end work is not ended.
/// Threads: its own. Guarantee: wait-free.
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
