#include "tfdb/testing/sched/walk.hpp"

#include <cstdio>

namespace tfdb::sched {

std::vector<Test>& registry() {
    static std::vector<Test> tests;
    return tests;
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

void Walk::must_hold(const std::string& name, const Program& program) {
    const Outcome outcome = explore(program, options_);
    if (!outcome.violation.empty()) {
        print(name, outcome, "VIOLATED");
        throw Failure{name + ": " + outcome.violation + "\n" + outcome.schedule};
    }
    if (!outcome.complete) {
        print(name, outcome, "NOT COMPLETE");
        throw Failure{name + ": the walk was cut off at its limit of executions"};
    }
    const std::string bound =
        options_.preemptions ? std::to_string(*options_.preemptions) : std::string();
    print(name, outcome,
          outcome.bounded ? "not exhaustive: at most " + bound + " preemptions" : "exhaustive");
}

void Walk::must_fail(const std::string& name, const std::string& expected, const Program& program) {
    const Outcome outcome = explore(program, options_);
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
