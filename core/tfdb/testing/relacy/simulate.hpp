// Runs a suite of Relacy's, once as it is and once for each order or fence that it needs.
#pragma once

#include <cstdio>
#include <cstdlib>
#include <ostream>
#include <string>

#include "tfdb/testing/check.hpp"
#include "tfdb/testing/relacy/memory.hpp"

namespace tfdb::relacy {

inline unsigned long iterations() {
    const char* const wish = std::getenv("TFDB_RELACY_ITERATIONS");
    return wish == nullptr ? 20'000 : std::strtoul(wish, nullptr, 10);
}

/// Empty if no execution breaks a promise, else Relacy's account of the first that does. One that
/// takes more than `depth` steps breaks one.
template <class Suite>
std::string simulate(const std::string& name, const Weakness& weakness,
                     unsigned depth = rl::test_params().execution_depth_limit) {
    g_weakness = weakness;
    Account account;
    Account ignored;
    std::ostream output(&account);
    std::ostream progress(&ignored);
    rl::test_params params;
    params.iteration_count = iterations();
    params.execution_depth_limit = depth;
    params.output_stream = &output;
    params.progress_stream = &progress;
    const bool held = rl::simulate<Suite>(params);
    g_weakness = {};
    std::printf("  %-52s %8lu executions, %s\n", name.c_str(),
                static_cast<unsigned long>(params.stop_iteration),
                held ? "all hold" : rl::test_result_str(params.test_result));
    std::fflush(stdout);
    return held ? std::string() : account.text();
}

template <class Suite>
void holds(const std::string& name, const Weakness& harmless = {}) {
    CHECK_EQ(simulate<Suite>(name, harmless), std::string());
}

/// Without the order that `weakness` leaves out, some execution must break a promise.
template <class Suite>
void needs(const std::string& name, const Weakness& weakness) {
    CHECK(!simulate<Suite>("without " + name, weakness).empty());
}

}  // namespace tfdb::relacy
