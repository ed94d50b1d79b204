#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "tfdb/testing/sched/causality.hpp"
#include "tfdb/testing/sched/fiber.hpp"
#include "tfdb/testing/sched/word.hpp"

namespace tfdb::sched {

/// One executed step, for the printed schedule.
struct Step {
    std::size_t thread;
    Kind kind;
    std::size_t word;  // order of first access
    Effect effect;
};

/// Thrown by SCHED_REQUIRE: the walked program violated a requirement.
struct Violation {
    std::string what;
    std::string schedule;  // filled in while the words still exist
};

// One execution of a small concurrent program, stepped by a scheduler. The program calls thread()
// and join(); its threads only touch Words and require(). Each step is one access to one Word; the
// walk ignores what a thread does in between.
class Run {
public:
    static constexpr std::size_t kNever = std::numeric_limits<std::size_t>::max();

    /// Decides the schedule: join() calls it when every thread is about to make its first access.
    using Driver = std::function<void(Run&)>;

    Run(std::vector<Fiber>& fibers, Driver driver);
    ~Run();
    Run(const Run&) = delete;
    Run& operator=(const Run&) = delete;

    /// Adds a thread. With `dies_after`, it stops for ever after that many accesses: its stack is
    /// not unwound, as if its process had been killed.
    void thread(std::string name, std::function<void()> body, std::size_t dies_after = kNever);

    /// Numbers a word before the threads do, so that its number does not depend on the schedule.
    void touch(Word& word) { identity(word); }

    /// Runs the threads to their end. The program's code after it is the final check.
    void join();

    /// Leaves the program with a violation unless `holds`.
    static void require(bool holds, const char* text, const char* file, int line);

    /// Stops the current thread for ever, as with `dies_after`.
    [[noreturn]] void die();

    /// Whether a thread was killed.
    [[nodiscard]] bool died(std::size_t thread) const { return threads_[thread].died; }

    /// The run whose thread is executing now, or null.
    static Run* inside_thread();

    /// Number of the executing thread, in the order of thread().
    [[nodiscard]] std::size_t current() const { return current_; }

    // For Word and the drivers.
    Effect step(const Operation& operation);
    [[nodiscard]] std::size_t thread_count() const { return threads_.size(); }
    [[nodiscard]] Threads unfinished() const;
    [[nodiscard]] Threads runnable() const;
    [[nodiscard]] bool runnable(std::size_t thread) const;
    [[nodiscard]] const Operation& announced(std::size_t thread) const;
    [[nodiscard]] std::size_t announced_word(std::size_t thread) const;
    const Step& advance(std::size_t thread);
    [[nodiscard]] const std::vector<Step>& steps() const { return steps_; }
    [[noreturn]] void fail(std::string what) const;

private:
    struct Thread {
        std::string name;
        std::function<void()> body;
        std::size_t dies_after;
        std::size_t accesses = 0;
        Fiber* fiber = nullptr;
        bool finished = false;
        bool died = false;
        Operation announced{};
        std::size_t announced_word = 0;
        Effect effect{};
    };

    [[nodiscard]] std::string schedule() const;
    void launch(std::size_t thread);
    void go_on(std::size_t thread);
    std::size_t identity(Word& word);

    std::vector<Fiber>& fibers_;
    Driver driver_;
    std::vector<Thread> threads_;
    std::vector<Step> steps_;
    std::vector<const Word*> words_;
    std::uint32_t number_;
    std::size_t current_ = 0;
    bool in_thread_ = false;
    std::string violation_;
};

}  // namespace tfdb::sched

/// Must be true in every execution; otherwise the walk prints the violating schedule.
#define SCHED_REQUIRE(expression) \
    ::tfdb::sched::Run::require(static_cast<bool>(expression), #expression, __FILE__, __LINE__)
