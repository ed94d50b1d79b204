#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <mutex>

#include "tfdb/testing/check.hpp"

namespace tfdb::testing {

namespace {

std::atomic<long> failures_of_test{0};
std::atomic<long> checks_of_test{0};
std::mutex output_mutex;

bool selected(const TestCase& test, int argc, char** argv) {
    bool filtered = false;
    for (int i = 1; i < argc; ++i) {
        if (argv[i][0] == '-') {
            continue;
        }
        filtered = true;
        if (std::strstr(test.name, argv[i]) != nullptr ||
            std::strstr(test.file, argv[i]) != nullptr) {
            return true;
        }
    }
    return !filtered;
}

bool has_flag(const char* flag, int argc, char** argv) {
    for (int i = 1; i < argc; ++i) {
        if (std::strcmp(argv[i], flag) == 0) {
            return true;
        }
    }
    return false;
}

bool run(const TestCase& test) {
    failures_of_test = 0;
    checks_of_test = 0;
    try {
        test.body();
    } catch (const std::exception& error) {
        report_failure(test.file, test.line, std::string("escaped: ") + error.what());
    } catch (...) {
        report_failure(test.file, test.line, "escaped: not a std::exception");
    }
    if (failures_of_test == 0 && checks_of_test == 0) {
        report_failure(test.file, test.line, "the test judged nothing");
    }
    return failures_of_test == 0;
}

}  // namespace

std::vector<TestCase>& registry() {
    static std::vector<TestCase> tests;
    return tests;
}

void report_failure(const char* file, int line, const std::string& message) {
    ++failures_of_test;
    const std::lock_guard<std::mutex> guard(output_mutex);
    std::fprintf(stderr, "%s:%d: failed: %s\n", file, line, message.c_str());
}

void count_check() {
    ++checks_of_test;
}

int run_all(int argc, char** argv) {
    const bool list_only = has_flag("--list", argc, argv);
    const bool verbose = has_flag("-v", argc, argv);
    long passed = 0;
    long failed = 0;
    for (const TestCase& test : registry()) {
        if (!selected(test, argc, argv)) {
            continue;
        }
        if (list_only) {
            std::printf("%s\n", test.name);
            continue;
        }
        const auto start = std::chrono::steady_clock::now();
        const bool ok = run(test);
        const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
        ++(ok ? passed : failed);
        if (verbose || !ok) {
            std::printf("%s %s (%.3f s)\n", ok ? "ok    " : "FAILED", test.name, took.count());
            std::fflush(stdout);
        }
    }
    if (!list_only) {
        std::printf("%ld passed, %ld failed\n", passed, failed);
    }
    // A filter without matches must not look like success.
    return list_only || (failed == 0 && passed > 0) ? 0 : 1;
}

}  // namespace tfdb::testing

int main(int argc, char** argv) {
    return tfdb::testing::run_all(argc, argv);
}
