// Random commits with a few names, each walked through every interleaving with a lookup.
#include <cstdio>
#include <cstdlib>
#include <string>

#include "tfdb/txn/author.sched.hpp"
#include "tfdb/txn/forest.sched.hpp"

namespace tfdb::txn::forest {

TFDB_SCHED(commit_random_scripts) {
    const char* const first = std::getenv("TFDB_SCHED_SEED");
    const char* const wish = std::getenv("TFDB_SCHED_SCRIPTS");
    const std::uint64_t seed_of_first = first == nullptr ? 1 : std::strtoull(first, nullptr, 10);
    const std::uint64_t scripts =
        wish == nullptr ? (sched::to_the_end() ? 60 : 10) : std::strtoull(wish, nullptr, 10);
    std::uint64_t executions = 0;
    std::uint64_t cut = 0;
    for (std::uint64_t seed = seed_of_first; seed < seed_of_first + scripts; ++seed) {
        Author author(seed);
        const Script script = author.script();
        sched::Options options;
        options.max_executions = 20'000;
        const sched::Outcome outcome =
            sched::explore(program(script, author.held() ? ask_held : ask_fresh), options);
        executions += outcome.executions;
        cut += outcome.complete ? 0 : 1;
        if (!outcome.violation.empty()) {
            throw sched::Failure{"seed " + std::to_string(seed) + ", " + describe(script) + "\n" +
                                 outcome.violation + "\n" + outcome.schedule};
        }
    }
    // A few scripts are too large; most must be walked to the end.
    SCHED_EXPECT(4 * cut <= scripts);
    std::printf("  %llu scripts from seed %llu: %llu executions, %llu walks not exhaustive\n",
                static_cast<unsigned long long>(scripts),
                static_cast<unsigned long long>(seed_of_first),
                static_cast<unsigned long long>(executions), static_cast<unsigned long long>(cut));
}

}  // namespace tfdb::txn::forest
