// One point: fill, check, warm up, measure, check again, print.
#pragma once

#include <cstdio>
#include <exception>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "report.hpp"
#include "thread.hpp"
#include "values.hpp"

namespace tfdb::driver {

inline StoreCounters since(const StoreCounters& before, const StoreCounters& after) {
    return {after.commits - before.commits,          after.aborts - before.aborts,
            after.conflicts - before.conflicts,      after.retries - before.retries,
            after.lock_waits - before.lock_waits,    after.lapped_reads - before.lapped_reads,
            after.pinned_reads - before.pinned_reads};
}

template <Store S>
Outcome measure(S& store, const Forest& forest, const Options& options, const Clock& clock) {
    Stage stage;
    std::vector<std::unique_ptr<Thread<S>>> work;
    for (std::uint32_t i = 0; i < options.threads; ++i) {
        work.push_back(std::make_unique<Thread<S>>(store, forest, options, clock, i));
    }
    std::vector<std::thread> threads;
    for (const auto& one : work) {
        threads.emplace_back([&stage, &thread = *one] { thread.run(stage); });
    }
    while (stage.ready.load() != options.threads) {
        std::this_thread::yield();
    }
    stage.go = true;
    const auto nanos = [](double seconds) { return static_cast<std::int64_t>(1e9 * seconds); };
    clock.sleep_until(clock.now() + nanos(options.warmup));
    const StoreCounters before = store.counters();
    const std::int64_t begin = clock.now();
    stage.phase = Phase::kMeasure;
    Outcome outcome;
    std::int64_t end = begin;
    if (options.iterations == 0) {
        clock.sleep_until(begin + nanos(options.seconds));
        end = clock.now();
        stage.phase = Phase::kStop;
        outcome.counters = since(before, store.counters());
    }
    for (std::thread& thread : threads) {
        thread.join();
    }
    for (const auto& one : work) {
        outcome.tally.add(one->tally());
        end = options.iterations > 0 ? std::max(end, one->ended()) : end;
    }
    if (options.iterations > 0) {
        outcome.counters = since(before, store.counters());
    }
    outcome.elapsed = 1e-9 * static_cast<double>(end - begin);
    return outcome;
}

/// Throws what the store throws, and std::runtime_error where a value is wrong.
template <Store S>
void run_point(const Options& options) {
    const Forest forest(options);
    const Motion motion;
    const Clock clock;
    S store(options, forest, motion);
    Values<S> values(store, forest, motion, options);
    double worst = values.after_filling(clock);
    Outcome outcome = measure(store, forest, options, clock);
    for (const double found : {values.as_left(), values.after_filling(clock)}) {
        worst = found <= worst ? worst : found;
    }
    if (!(worst <= kTolerance)) {
        throw std::runtime_error("answers are off by " + std::to_string(worst));
    }
    outcome.worst_value = worst;
    double edges = 0.0;
    for (std::uint32_t i = 0; i < forest.paths(); ++i) {
        edges += forest.path(i).edges;
    }
    outcome.edges_per_read = edges / forest.paths();
    std::printf("%s\n", to_json(options, outcome).c_str());
}

/// Exit code: 0, 2 for bad options, 1 for anything else; errors are one line on stderr.
template <Store S>
int run_program(const char* program, int count, char** words, const char* engine) {
    try {
        std::vector<std::string> arguments(words + 1, words + count);
        if (engine != nullptr) {
            arguments.insert(arguments.begin(), {"--engine", engine});
        }
        const Options options = parse(arguments);
        if (options.help) {
            std::printf("%s", usage().c_str());
            return 0;
        }
        run_point<S>(options);
        return 0;
    } catch (const BadOption& error) {
        std::fprintf(stderr, "%s: %s\n", program, error.what());
        return 2;
    } catch (const std::exception& error) {
        const std::string text = error.what();  // tf2's may go on for a line per frame
        std::fprintf(stderr, "%s: %s\n", program, text.substr(0, text.find('\n')).c_str());
        return 1;
    }
}

}  // namespace tfdb::driver
