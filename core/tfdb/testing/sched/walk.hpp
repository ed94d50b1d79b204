#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "tfdb/testing/sched/run.hpp"

namespace tfdb::sched {

/// A concurrent program: creates fresh state, adds threads, joins them, checks the result. It must
/// be deterministic for a given schedule.
using Program = std::function<void(Run&)>;

struct Options {
    /// One representative per class of executions that differ only in the order of independent
    /// steps. False: every interleaving.
    bool reduce = true;
    /// With a bound, only schedules with at most this many preemptions of a runnable thread: not
    /// exhaustive. Disables the reduction.
    std::optional<unsigned> preemptions;
    /// Beyond this the walk gives up, which fails the test.
    std::uint64_t max_executions = 5'000'000;
    /// Beyond this an execution counts as endless, which is a violation.
    std::size_t max_steps = 4'000;
    /// False: a deadlocked execution just ends.
    bool deadlock_is_violation = true;
    /// Called after each complete execution that is not redundant, deadlocked ones included.
    std::function<void(const Run&)> observe;
};

struct Outcome {
    std::uint64_t executions = 0;  // including redundant ones
    std::uint64_t redundant = 0;   // repeated an earlier one, finished without branching
    std::uint64_t deadlocks = 0;
    std::size_t longest = 0;  // steps
    bool complete = false;    // nothing is left to explore
    bool bounded = false;     // a preemption bound kept schedules out
    std::string violation;    // empty: none
    std::string schedule;     // of the violation

    [[nodiscard]] bool exhaustive() const { return complete && !bounded; }
};

/// Explores the executions of `program` depth first, each from the start.
Outcome explore(const Program& program, const Options& options = {});

/// Whether walks run to their end, however long (`make proof`). Otherwise a walk of more than
/// 50,000 executions preempts a runnable thread at most once.
bool& to_the_end();

// The walks of one test. Not thread safe; a failed expectation ends the test. must_hold() passes
// only for an exhaustive walk, an intentionally bounded one, or a long one without to_the_end().
class Walk {
public:
    explicit Walk(Options options = {}) : options_(std::move(options)) {}

    /// No execution violates a requirement, and the walk is complete.
    void must_hold(const std::string& name, const Program& program);

    /// Some execution violates a requirement whose text contains `expected`: this proves that the
    /// checks can fail.
    void must_fail(const std::string& name, const std::string& expected, const Program& program);

private:
    static Outcome explore_in_time(const Program& program, Options& options);

    Options options_;
};

/// A failed expectation of a test.
struct Failure {
    std::string what;
};

struct Test {
    const char* name;
    void (*body)();
};
std::vector<Test>& registry();
int add_test(const char* name, void (*body)());
void expect(bool holds, const char* text, const char* file, int line);

}  // namespace tfdb::sched

#define TFDB_SCHED(name)                                        \
    static void tfdb_sched_##name();                            \
    [[maybe_unused]] static const int tfdb_sched_added_##name = \
        ::tfdb::sched::add_test(#name, &tfdb_sched_##name);     \
    static void tfdb_sched_##name()

/// Ends the test with a failure if the expression is false. For the test function itself; inside a
/// walked program use SCHED_REQUIRE.
#define SCHED_EXPECT(expression) \
    ::tfdb::sched::expect(static_cast<bool>(expression), #expression, __FILE__, __LINE__)
