// Records what threads read and write in one store: JSON lines for `tfdb verify`.
#include <charconv>
#include <cstdio>
#include <cstring>
#include <latch>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "worker.hpp"

namespace {

using namespace tfdb;
using namespace tfdb::recorder;

constexpr const char* kUsage =
    "usage: tfdb_recorder [--engine NAME] [--threads N] [--writers N] [--operations N] [--seed N]\n"
    "                     [--single-writes] [--no-transactions] [--no-commits] [--out FILE]\n";

template <class Number>
bool number(const char* text, Number& out) {
    const char* const end = text + std::strlen(text);
    const auto [last, error] = std::from_chars(text, end, out);
    return error == std::errc{} && last == end;
}

bool parse(int count, char** words, Options& options) {
    for (int i = 1; i < count; ++i) {
        const std::string_view word = words[i];
        if (word == "--single-writes") {
            options.batches = false;
        } else if (word == "--no-transactions") {
            options.transactions = false;
        } else if (word == "--no-commits") {
            options.commits = false;
        } else if (i + 1 == count) {
            return false;
        } else if (const char* const value = words[++i]; word == "--engine") {
            options.engine = value;
        } else if (word == "--out") {
            options.out = value;
        } else if (!(word == "--threads" && number(value, options.threads)) &&
                   !(word == "--writers" && number(value, options.writers)) &&
                   !(word == "--operations" && number(value, options.operations)) &&
                   !(word == "--seed" && number(value, options.seed))) {
            return false;
        }
    }
    return options.threads > 0;
}

/// The forest before the threads start, recorded as the first operation.
Operation begin_with(Buffer& buffer, Values& values, StampNs stamp) {
    Operation operation;
    std::vector<TransformView> moving;
    std::vector<TransformView> fixed;
    for (std::size_t i = 0; i < kEdges.size(); ++i) {
        const Edge& edge = kEdges[i];
        if (edge.comes_and_goes)
            continue;
        const StampNs at = edge.is_static ? -1 : stamp;
        const auto value = values.add(i, at, edge.parent);
        (edge.is_static ? fixed : moving)
            .push_back({edge.parent, edge.name, stamp, pose_of(edge, value)});
        Written written{edge.name,
                        "\"" + std::string(edge.name) + "#" + std::to_string(value) + "\"", stamp,
                        edge.parent, false};
        if (edge.is_static)
            written.stamp.reset();
        operation.writes.push_back(written);
    }
    operation.begin = 0;
    buffer.set_transforms(fixed, true, "recorder");
    operation.commit = buffer.set_transforms(moving, false, "recorder");
    operation.end = 1;
    return operation;
}

int record(const Options& options) {
    BufferOptions wanted;
    wanted.history_ns = std::nullopt;
    wanted.concurrency = concurrency_of(options.engine);
    Buffer buffer(wanted);
    Values values;
    std::atomic<StampNs> clock{1000};
    Operation first = begin_with(buffer, values, clock.load());
    first.thread = options.threads;
    if (!options.commits)
        first.commit.reset();

    std::vector<Worker> workers;
    workers.reserve(options.threads);
    for (unsigned i = 0; i < options.threads; ++i)
        workers.emplace_back(buffer, values, clock, options, i);
    std::latch start(options.threads);
    std::vector<std::thread> threads;
    for (Worker& worker : workers) {
        threads.emplace_back([&] {
            start.arrive_and_wait();
            worker.run();
        });
    }
    for (std::thread& thread : threads)
        thread.join();

    std::FILE* const out = options.out.empty() ? stdout : std::fopen(options.out.c_str(), "w");
    if (out == nullptr) {
        std::perror(options.out.c_str());
        return 2;
    }
    std::fprintf(out,
                 "{\"tfdb_history\":1,\"engine\":\"%s\",\"threads\":%u,\"operations\":%zu,"
                 "\"seed\":%u}\n",
                 options.engine.c_str(), options.threads, options.operations, options.seed);
    print(out, first, 0);
    for (const Worker& worker : workers) {
        for (std::size_t i = 0; i < worker.history().size(); ++i)
            print(out, worker.history()[i], i + 1);
    }
    const bool bad = std::ferror(out) != 0;
    return (out == stdout ? std::fflush(out) : std::fclose(out)) != 0 || bad ? 2 : 0;
}

}  // namespace

int main(int count, char** words) {
    Options options;
    if (!parse(count, words, options)) {
        std::fputs(kUsage, stderr);
        return 2;
    }
    try {
        return record(options);
    } catch (const std::exception& error) {
        std::fprintf(stderr, "tfdb_recorder: %s\n", error.what());
        return 2;
    }
}
