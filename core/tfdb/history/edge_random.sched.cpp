// Random scripts, each walked through every interleaving with a reader.
#include <cstdio>
#include <cstdlib>
#include <string>

#include "tfdb/history/author.sched.hpp"
#include "tfdb/history/edge.sched.hpp"

namespace tfdb::history::script {

TFDB_SCHED(edge_random_scripts) {
    const char* const first = std::getenv("TFDB_SCHED_SEED");
    const std::uint64_t first_seed = first == nullptr ? 7 : std::strtoull(first, nullptr, 10);
    const char* const wish = std::getenv("TFDB_SCHED_SCRIPTS");
    const std::uint64_t scripts =
        wish == nullptr ? (sched::to_the_end() ? 300 : 60) : std::strtoull(wish, nullptr, 10);
    std::uint64_t executions = 0;
    std::uint64_t cut = 0;
    for (std::uint64_t seed = first_seed; seed < first_seed + scripts; ++seed) {
        Author author(seed);
        const Script script = author.script();
        const StampNs stamp = author.stamp();
        sched::Options options;
        options.max_executions = 200'000;
        const sched::Outcome outcome = sched::explore(program(script, stamp, 1), options);
        executions += outcome.executions;
        cut += outcome.complete ? 0 : 1;
        if (!outcome.violation.empty()) {
            throw sched::Failure{"seed " + std::to_string(seed) + ", " + describe(script, stamp) +
                                 "\n" + outcome.violation + "\n" + outcome.schedule};
        }
    }
    // Few scripts are too large.
    SCHED_EXPECT(100 * cut <= scripts);
    std::printf("  %llu scripts from seed %llu: %llu executions, %llu walks not exhaustive\n",
                static_cast<unsigned long long>(scripts),
                static_cast<unsigned long long>(first_seed),
                static_cast<unsigned long long>(executions), static_cast<unsigned long long>(cut));
}

}  // namespace tfdb::history::script
