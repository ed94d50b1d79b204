// tfdb's core against the real tf2 (ROS 1, libtf2-dev), both in this one program.
//
//   against_tf2 [--rounds N] [--batch-ms MS] [lookups] [writes] [threads] [history]
//   against_tf2 --count "tf2 lookup mid" CHAIN TIMES      (to be run under callgrind)
//
// Prints one JSON object per row; tfdb_measure reads them. Answers are compared to 1e-12
// before anything is timed. Rows of one thread are CPU time, rows of several threads wall time.

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "groups.hpp"

namespace {

const std::vector<std::pair<std::string, std::function<void(const bench::Options&)>>> kGroups{
    {"lookups", bench::lookup_rows},
    {"writes", bench::write_rows},
    {"threads", bench::thread_rows},
    {"history", bench::history_rows},
};

int usage() {
    std::fprintf(stderr,
                 "usage: against_tf2 [--rounds N] [--batch-ms MS] [GROUP ...]\n"
                 "       against_tf2 --count \"CONTENDER OPERATION\" CHAIN TIMES\n");
    return 2;
}

int run(const std::vector<std::string>& arguments) {
    bench::Options options;
    if (arguments.size() == 4 && arguments[0] == "--count") {
        const auto times = static_cast<std::size_t>(std::stoull(arguments[3]));
        return bench::run_for_counting(arguments[1], std::stoi(arguments[2]), times) ? 0 : usage();
    }
    for (std::size_t i = 0; i < arguments.size(); ++i) {
        if (arguments[i] == "--rounds" && i + 1 < arguments.size()) {
            options.rounds = std::stoi(arguments[++i]);
        } else if (arguments[i] == "--batch-ms" && i + 1 < arguments.size()) {
            options.batch_seconds = 1e-3 * std::stod(arguments[++i]);
        } else {
            options.groups.push_back(arguments[i]);
        }
    }
    for (const auto& [name, rows] : kGroups) {
        bool wanted = options.groups.empty();
        for (const std::string& group : options.groups) {
            wanted = wanted || group == name;
        }
        if (wanted) {
            rows(options);
        }
    }
    return 0;
}

}  // namespace

int main(int argc, char** argv) {
    try {
        return run({argv + 1, argv + argc});
    } catch (const std::exception& error) {
        std::fprintf(stderr, "against_tf2: %s\n", error.what());
        return 1;
    }
}
