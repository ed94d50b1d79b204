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

/// One executed step, as the printed schedule shows it.
struct Step {
    std::size_t thread;
    Kind kind;
    std::size_t word;  // order of first access
    Effect effect;
};

/// Thrown by SCHED_REQUIRE: the program under the walk broke a promise.
struct Violation {
    std::string what;
    std::string schedule;  // filled in where the words still live
};

// One execution of a small concurrent program, stepped by a scheduler.
// The program calls thread() and join(); its threads only touch Words and require().
// Each step is one access to one Word; what a thread does between two accesses is not seen.
class Run {
public:
    static constexpr std::size_t kNever = std::numeric_limits<std::size_t>::max();

    /// Decides the schedule: called by join() after all threads stand before their first access.
    using Driver = std::function<void(Run&)>;

    Run(std::vector<Fiber>& fibers, Driver driver);
    ~Run();
    Run(const Run&) = delete;
    Run& operator=(const Run&) = delete;

    /// Adds a thread. With `dies_after`, it stops for ever after that many accesses: nothing of it
    /// is unwound, as if its process had been killed.
    void thread(std::string name, std::function<void()> body, std::size_t dies_after = kNever);

    /// Numbers a word before the threads do, so that its number does not depend on the schedule.
    void touch(Word& word) { identity(word); }

    /// Runs the threads to their end. What follows in the program is the final check.
    void join();

    /// Leaves the program with a violation unless `holds`.
    static void require(bool holds, const char* text, const char* file, int line);

    /// The thread that is being executed stops for ever, as with `dies_after`.
    [[noreturn]] void die();

    /// True once a thread has been killed.
    [[nodiscard]] bool died(std::size_t thread) const { return threads_[thread].died; }

    /// The run whose thread is being executed right now, or null.
    static Run* inside_thread();

    /// Number of the thread that is being executed, in the order of thread().
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

/// Holds in every execution, or the walk prints the schedule that broke it.
#define SCHED_REQUIRE(expression) \
    ::tfdb::sched::Run::require(static_cast<bool>(expression), #expression, __FILE__, __LINE__)
