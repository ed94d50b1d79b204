// Records what threads, or processes, read and write in one store: JSON lines for `tfdb verify`.
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <charconv>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <latch>
#include <memory>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "worker.hpp"

namespace {

using namespace tfdb;
using namespace tfdb::recorder;

constexpr const char* kUsage =
    "usage: tfdb_recorder [--engine NAME] [--threads N | --processes N] [--writers N]\n"
    "                     [--operations N] [--seed N] [--single-writes] [--no-transactions]\n"
    "                     [--no-commits] [--out FILE]\n";

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
                   !(word == "--processes" && number(value, options.processes)) &&
                   !(word == "--writers" && number(value, options.writers)) &&
                   !(word == "--operations" && number(value, options.operations)) &&
                   !(word == "--seed" && number(value, options.seed))) {
            return false;
        }
    }
    return options.threads > 0;
}

/// The forest before the others start, recorded as the first operation.
void begin_with(Buffer& buffer, Shared& shared, const Options& options, std::FILE* out) {
    Values values(shared);
    const StampNs stamp = shared.clock.load();
    Operation operation;
    operation.thread = options.threads + options.processes;
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
    const CommitNumber commit = buffer.set_transforms(moving, false, "recorder");
    if (options.commits)
        operation.commit = commit;
    operation.end = 1;
    print(out, operation, 0);
}

void print(std::FILE* out, const std::vector<Operation>& history) {
    for (std::size_t i = 0; i < history.size(); ++i)
        print(out, history[i], i + 1);
}

/// Threads of this program, in a store of its own.
void run_threads(const Options& options, Shared& shared, const BufferOptions& wanted,
                 std::FILE* out) {
    Buffer buffer(wanted);
    begin_with(buffer, shared, options, out);
    std::vector<std::unique_ptr<Worker>> workers;
    for (unsigned i = 0; i < options.threads; ++i)
        workers.push_back(std::make_unique<Worker>(buffer, shared, options, i));
    std::latch start(options.threads);
    std::vector<std::thread> threads;
    for (auto& worker : workers) {
        threads.emplace_back([&] {
            start.arrive_and_wait();
            worker->run();
        });
    }
    for (std::thread& thread : threads)
        thread.join();
    for (const auto& worker : workers)
        print(out, worker->history());
}

/// One process: who does not write has the store for reading only.
int work(const Options& options, Shared& shared, const std::string& path, unsigned index,
         std::FILE* out) {
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    Buffer buffer = Buffer::open(path, index < options.writers);
    Worker worker(buffer, shared, options, index);
    ++shared.started;
    while (shared.started.load() < options.processes)
        std::this_thread::yield();
    worker.run();
    print(out, worker.history());
    return std::fflush(out) == 0 ? 0 : 2;
}

/// Processes in a store that they share. Each writes what it did to a file that only it has.
void run_processes(const Options& options, Shared& shared, const BufferOptions& wanted,
                   std::FILE* out) {
    const std::string path = "/dev/shm/tfdb.recorder-" + std::to_string(::getpid());
    ShareOptions share;
    share.size = std::size_t{256} << 20;
    Buffer::create(path, share, wanted);
    std::vector<std::pair<pid_t, std::FILE*>> children;
    bool good = true;
    try {
        {
            Buffer buffer = Buffer::open(path, true);
            begin_with(buffer, shared, options, out);
        }
        std::fflush(out);
        for (unsigned i = 0; i < options.processes; ++i) {
            std::FILE* const part = std::tmpfile();
            const pid_t child = part == nullptr ? -1 : ::fork();
            if (child < 0)
                throw std::system_error(errno, std::generic_category(), "a process");
            if (child == 0) {
                int code = 2;
                try {
                    code = work(options, shared, path, i, part);
                } catch (const std::exception& error) {
                    std::fprintf(stderr, "tfdb_recorder: %s\n", error.what());
                    shared.started += options.processes;  // nobody need wait
                }
                ::_exit(code);
            }
            children.emplace_back(child, part);
        }
    } catch (...) {
        shared.started += options.processes;
        Buffer::unlink(path);
        throw;
    }
    for (const auto& [child, part] : children) {
        int status = 0;
        ::waitpid(child, &status, 0);
        good = good && WIFEXITED(status) && WEXITSTATUS(status) == 0;
        std::rewind(part);
        std::array<char, 1 << 16> piece{};
        for (std::size_t n = 0; (n = std::fread(piece.data(), 1, piece.size(), part)) > 0;)
            good = std::fwrite(piece.data(), 1, n, out) == n && good;
        std::fclose(part);
    }
    Buffer::unlink(path);
    if (!good)
        throw std::runtime_error("a process did not end well");
}

int record(const Options& options) {
    BufferOptions wanted;
    wanted.history_ns = std::nullopt;
    wanted.concurrency = concurrency_of(options.engine);
    Shared& shared = Shared::make();
    std::FILE* const out = options.out.empty() ? stdout : std::fopen(options.out.c_str(), "w");
    if (out == nullptr) {
        std::perror(options.out.c_str());
        return 2;
    }
    std::fprintf(out,
                 "{\"tfdb_history\":1,\"engine\":\"%s\",\"threads\":%u,\"processes\":%u,"
                 "\"operations\":%zu,\"seed\":%u}\n",
                 options.engine.c_str(), options.threads, options.processes, options.operations,
                 options.seed);
    (options.processes > 0 ? run_processes : run_threads)(options, shared, wanted, out);
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
