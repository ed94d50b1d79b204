#include <cstdint>
#include <cstdio>
#include <deque>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "tfdb/testing/sched/walk.hpp"

namespace tfdb::sched {

namespace {

constexpr std::size_t kWords = 2;
constexpr std::uint64_t kSeed = 20240611;

struct Instruction {
    enum Code {
        kLoad,
        kStore,
        kStoreSeen,
        kAdd,
        kSwap,
        kCompare,
        kWait,
        kSleep,
        kNotify,
        kSkipIfSeen,
        kCodes
    };
    Code code;
    std::size_t word;
    std::uint64_t value;
};
using Body = std::vector<Instruction>;

void interpret(const Body& body, std::deque<Word>& words) {
    std::uint64_t seen = 0;
    for (std::size_t at = 0; at < body.size(); ++at) {
        const Instruction& next = body[at];
        Word& word = words[next.word];
        switch (next.code) {
            case Instruction::kLoad:
                seen = word.load_relaxed();
                break;
            case Instruction::kStore:
                word.store_relaxed(next.value);
                break;
            case Instruction::kStoreSeen:
                word.store_relaxed(seen ^ next.value);
                break;
            case Instruction::kAdd:
                seen = word.fetch_add(next.value);
                break;
            case Instruction::kSwap:
                seen = word.exchange(next.value);
                break;
            case Instruction::kCompare:
                seen = next.value;
                word.compare_exchange(seen, next.value + 1);
                break;
            case Instruction::kWait:
                seen = word.wait_while(next.value);
                break;
            case Instruction::kSleep:
                word.wait(next.value);
                break;
            case Instruction::kNotify:
                next.value == 0 ? word.notify_all() : word.notify_one();
                break;
            case Instruction::kSkipIfSeen:
                at += seen == next.value ? 1 : 0;
                break;
            case Instruction::kCodes:
                break;
        }
    }
}

/// The order of conflicts as text: who stored when on each word, who read which store.
std::string canonical(const Run& run) {
    std::vector<std::string> threads(kMaxThreads);
    std::vector<std::string> stores(kWords);
    std::vector<std::string> last_store(kWords, "start");
    for (const Step& step : run.steps()) {
        std::string& own = threads[step.thread];
        const std::string label = std::to_string(step.thread) + "." + std::to_string(own.size());
        own += std::to_string(step.word) + "<" + last_store[step.word] + ">" +
               std::to_string(step.effect.before) + ";";
        if (step.effect.stored) {
            stores[step.word] += label + " ";
            last_store[step.word] = label;
        }
    }
    std::string text;
    for (const std::string& part : threads) {
        text += part + "|";
    }
    for (const std::string& part : stores) {
        text += part + "|";
    }
    return text;
}

std::set<std::string> traces(const std::vector<Body>& bodies, bool reduce, Outcome& outcome) {
    std::set<std::string> found;
    Options options;
    options.reduce = reduce;
    options.deadlock_is_violation = false;
    options.observe = [&](const Run& run) { found.insert(canonical(run)); };
    outcome = explore(
        [&](Run& run) {
            std::deque<Word> words(kWords);
            for (Word& word : words) {
                run.touch(word);
            }
            for (std::size_t thread = 0; thread < bodies.size(); ++thread) {
                run.thread(std::to_string(thread),
                           [&, thread] { interpret(bodies[thread], words); });
            }
            run.join();
        },
        options);
    return found;
}

std::vector<Body> random_program(std::mt19937_64& random) {
    const auto below = [&](std::uint64_t limit) { return random() % limit; };
    std::vector<Body> bodies(2 + below(3));
    for (Body& body : bodies) {
        const std::size_t most = bodies.size() == 2 ? 6 : bodies.size() == 3 ? 4 : 2;
        body.resize(1 + below(most));
        for (Instruction& next : body) {
            next.code = static_cast<Instruction::Code>(below(Instruction::kCodes));
            next.word = below(kWords);
            next.value = below(3);
        }
    }
    return bodies;
}

}  // namespace

// The judge of the reduction: on random programs with loads, stores, read-modify-writes, waits and
// branches it must reach exactly the orders of conflicts that plain enumeration reaches.
TFDB_SCHED(reduction_loses_no_order_of_conflicts) {
    std::mt19937_64 random(kSeed);
    std::uint64_t plain = 0;
    std::uint64_t reduced = 0;
    std::uint64_t redundant = 0;
    std::uint64_t orders = 0;
    for (int round = 0; round < 2'000; ++round) {
        const std::vector<Body> bodies = random_program(random);
        Outcome all;
        Outcome few;
        const std::set<std::string> expected = traces(bodies, false, all);
        const std::set<std::string> found = traces(bodies, true, few);
        SCHED_EXPECT(all.exhaustive() && few.exhaustive());
        SCHED_EXPECT(found == expected);
        SCHED_EXPECT(few.executions - few.redundant == found.size());
        SCHED_EXPECT((few.deadlocks > 0) == (all.deadlocks > 0));
        plain += all.executions;
        reduced += few.executions;
        redundant += few.redundant;
        orders += found.size();
    }
    std::printf("  seed %llu: %llu interleavings, %llu orders, %llu executions (%llu redundant)\n",
                static_cast<unsigned long long>(kSeed), static_cast<unsigned long long>(plain),
                static_cast<unsigned long long>(orders), static_cast<unsigned long long>(reduced),
                static_cast<unsigned long long>(redundant));
}

}  // namespace tfdb::sched
