#include "tfdb/testing/sched/walk.hpp"

#include <cstdio>

namespace tfdb::sched {

std::vector<Test>& registry() {
    static std::vector<Test> tests;
    return tests;
}

bool& to_the_end() {
    static bool wanted = false;
    return wanted;
}

int add_test(const char* name, void (*body)()) {
    registry().push_back({name, body});
    return 0;
}

void expect(bool holds, const char* text, const char* file, int line) {
    if (!holds) {
        const std::string path = file;
        throw Failure{path.substr(path.find_last_of('/') + 1) + ":" + std::to_string(line) + ": " +
                      text};
    }
}

namespace {

void print(const std::string& name, const Outcome& outcome, const std::string& verdict) {
    std::printf("  %-58s %9llu executions (%llu redundant, up to %zu steps), %s\n", name.c_str(),
                static_cast<unsigned long long>(outcome.executions),
                static_cast<unsigned long long>(outcome.redundant), outcome.longest,
                verdict.c_str());
    std::fflush(stdout);
}

}  // namespace

// Explores as far as to_the_end() requires; `options` become those of the walk.
Outcome Walk::explore_in_time(const Program& program, Options& options) {
    constexpr std::uint64_t kShort = 10'000;
    const std::uint64_t limit = options.max_executions;
    if (to_the_end() || limit < kShort)
        return explore(program, options);
    options.max_executions = kShort;
    Outcome outcome = explore(program, options);
    options.max_executions = limit;
    if (outcome.complete || !outcome.violation.empty())
        return outcome;
    options.preemptions = 1;
    return explore(program, options);
}

void Walk::must_hold(const std::string& name, const Program& program) {
    Options options = options_;
    const Outcome outcome = explore_in_time(program, options);
    if (!outcome.violation.empty()) {
        print(name, outcome, "VIOLATED");
        throw Failure{name + ": " + outcome.violation + "\n" + outcome.schedule};
    }
    if (!outcome.complete) {
        print(name, outcome, "NOT COMPLETE");
        throw Failure{name + ": the walk was cut off at its limit of executions"};
    }
    const std::string bound = std::to_string(options.preemptions.value_or(0));
    print(name, outcome,
          outcome.bounded ? "not exhaustive: at most " + bound + " preemptions" : "exhaustive");
}

void Walk::must_fail(const std::string& name, const std::string& expected, const Program& program) {
    Options options = options_;
    Outcome outcome = explore_in_time(program, options);
    if (outcome.violation.empty() && outcome.bounded)
        outcome = explore(program, options_);
    if (outcome.violation.empty()) {
        print(name, outcome, "NOT FOUND");
        throw Failure{name + ": the seeded bug was not found"};
    }
    if (outcome.violation.find(expected) == std::string::npos) {
        print(name, outcome, "found something else");
        throw Failure{name + ": expected \"" + expected + "\", found " + outcome.violation + "\n" +
                      outcome.schedule};
    }
    print(name, outcome, "bug found: " + outcome.violation);
}

}  // namespace tfdb::sched
