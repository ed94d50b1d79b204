#pragma once

#include <cstddef>
#include <functional>

namespace tfdb::sched {

// A stackful coroutine: a body that runs on its own stack and can be suspended anywhere. One OS
// thread at a time may use it: start() and resume() outside, suspend() inside the body. An
// unfinished body may be abandoned: its stack is reused, its destructors do not run.
class Fiber {
public:
    Fiber();
    ~Fiber();
    Fiber(const Fiber&) = delete;
    Fiber& operator=(const Fiber&) = delete;

    /// Gives the fiber a new body, which the next resume() runs. The body must not throw.
    void start(std::function<void()> body);

    /// Runs the body until it calls suspend() or returns.
    void resume();

    /// Call inside the body: returns to the caller of resume().
    void suspend();

    [[nodiscard]] bool finished() const { return finished_; }

private:
    struct Machine;
    static void enter();

    Machine* machine_;
    std::function<void()> body_;
    bool finished_ = true;
};

}  // namespace tfdb::sched
