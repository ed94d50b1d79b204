#include <cstdio>
#include <cstring>
#include <exception>

#include "tfdb/testing/sched/walk.hpp"

namespace {

bool passes(const tfdb::sched::Test& test) {
    std::printf("%s\n", test.name);
    try {
        test.body();
        return true;
    } catch (const tfdb::sched::Failure& failure) {
        std::printf("  FAILED %s\n", failure.what.c_str());
    } catch (const std::exception& error) {
        std::printf("  FAILED with an exception: %s\n", error.what());
    }
    return false;
}

}  // namespace

/// Runs all walks, or those whose name contains the first argument.
int main(int argc, char** argv) {
    int passed = 0;
    int failed = 0;
    for (const tfdb::sched::Test& test : tfdb::sched::registry()) {
        if (argc < 2 || std::strstr(test.name, argv[1]) != nullptr) {
            (passes(test) ? passed : failed) += 1;
        }
    }
    std::printf("%d passed, %d failed\n", passed, failed);
    return failed == 0 && passed > 0 ? 0 : 1;
}
