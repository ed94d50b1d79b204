#include <chrono>
#include <cstdio>
#include <cstring>
#include <exception>

#include "tfdb/testing/sched/walk.hpp"

namespace {

bool passes(const tfdb::sched::Test& test) {
    std::printf("%s\n", test.name);
    const auto start = std::chrono::steady_clock::now();
    try {
        test.body();
        const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
        std::printf("  %.1f s\n", took.count());
        std::fflush(stdout);
        return true;
    } catch (const tfdb::sched::Failure& failure) {
        std::printf("  FAILED %s\n", failure.what.c_str());
    } catch (const std::exception& error) {
        std::printf("  FAILED with an exception: %s\n", error.what());
    }
    return false;
}

}  // namespace

/// Runs all walks, or those whose name contains the last argument; `--all`: to their ends.
int main(int argc, char** argv) {
    tfdb::sched::to_the_end() = argc > 1 && std::strcmp(argv[1], "--all") == 0;
    const char* name = argc > 1 ? argv[argc - 1] : "";
    if (std::strcmp(name, "--all") == 0)
        name = "";
    int passed = 0;
    int failed = 0;
    for (const tfdb::sched::Test& test : tfdb::sched::registry()) {
        if (std::strstr(test.name, name) != nullptr)
            (passes(test) ? passed : failed) += 1;
    }
    std::printf("%d passed, %d failed\n", passed, failed);
    return failed == 0 && passed > 0 ? 0 : 1;
}
