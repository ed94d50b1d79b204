#include <algorithm>
#include <array>
#include <bit>
#include <string>
#include <utility>

#include "tfdb/testing/sched/causality.hpp"
#include "tfdb/testing/sched/walk.hpp"

namespace tfdb::sched {

namespace {

Threads bit_of(std::size_t thread) {
    return Threads{1} << thread;
}

std::size_t lowest(Threads set) {
    return static_cast<std::size_t>(std::countr_zero(set));
}

/// Thrown through the program if its execution cannot continue and needs no check.
struct Deadlocked {};

/// Hash of the threads' announced steps.
std::size_t signature(const Run& run) {
    std::size_t mixed = 0;
    for (std::size_t thread = 0; thread < run.thread_count(); ++thread) {
        const auto kind = static_cast<std::size_t>(run.announced(thread).kind);
        mixed = mixed * 1'000'003 + run.announced_word(thread) * 16 + kind + 1;
    }
    return mixed;
}

/// Whether the announced step would store now: a failing compare-exchange is a read.
bool would_store(const Run& run, std::size_t thread) {
    const Operation& next = run.announced(thread);
    if ((run.unfinished() & bit_of(thread)) == 0 || only_reads(next.kind)) {
        return false;
    }
    const bool conditional = next.kind == Kind::kCompareExchange || next.kind == Kind::kFallAsleep;
    return !conditional || next.word->peek() == next.expected;
}

/// Depth-first search with source sets and sleep sets (Abdulla, Aronis, Jonsson, Sagonas: "Source
/// sets", 2017), extended to steps that must wait. A race between an event and a later step of
/// another thread makes that thread, or one that it needs first, an alternative before the event.
class Explorer {
public:
    Explorer(const Program& program, const Options& options)
        : program_(program), options_(options), fibers_(kMaxThreads) {
        reduce_ = options.reduce && !options.preemptions;
    }

    Outcome all() {
        do {
            if (outcome_.executions == options_.max_executions) {
                return std::move(outcome_);
            }
            once();
            if (!outcome_.violation.empty()) {
                return std::move(outcome_);
            }
        } while (backtrack());
        outcome_.complete = true;
        return std::move(outcome_);
    }

private:
    struct Node {
        std::size_t chosen = 0;
        Threads runnable = 0;
        Threads wanted = 0;  // to be chosen here
        Threads done = 0;    // chosen here in earlier executions
        Threads asleep = 0;  // choosing them repeats executions explored before this node
        unsigned preemptions = 0;
        std::size_t signature = 0;  // of all threads' announced steps
    };

    void once();
    void drive(Run& run);
    std::size_t choose(Run& run, std::size_t depth, Threads runnable);
    Threads candidates(std::size_t depth, Threads runnable);
    unsigned preemptions_before(std::size_t depth) const;
    void advance_reduced(Run& run, std::size_t depth, std::size_t thread);
    void note_waiting_races(Run& run, const Step& step);
    void turn(std::size_t event, Threads firsts);
    bool backtrack();

    const Program& program_;
    const Options& options_;
    bool reduce_;
    std::vector<Fiber> fibers_;
    std::vector<Node> nodes_;
    std::size_t replayed_ = 0;  // nodes whose choice is prescribed
    Threads next_asleep_ = 0;
    bool redundant_ = false;
    Causality causality_;
    Outcome outcome_;
};

void Explorer::once() {
    outcome_.executions += 1;
    redundant_ = false;
    next_asleep_ = 0;
    causality_.clear();
    Run run(fibers_, [this](Run& running) { drive(running); });
    try {
        program_(run);
    } catch (const Deadlocked&) {
        outcome_.deadlocks += redundant_ ? 0 : 1;
    } catch (const Violation& violation) {
        outcome_.violation = violation.what;
        outcome_.schedule = violation.schedule;
    }
    outcome_.longest = std::max(outcome_.longest, run.steps().size());
    outcome_.redundant += redundant_ ? 1 : 0;
    if (options_.observe && !redundant_) {
        options_.observe(run);
    }
}

void Explorer::drive(Run& run) {
    for (std::size_t depth = 0; run.unfinished() != 0; ++depth) {
        const Threads runnable = run.runnable();
        if (runnable == 0) {
            if (options_.deadlock_is_violation) {
                run.fail("deadlock: no thread can go on");
            }
            throw Deadlocked{};
        }
        if (depth == options_.max_steps) {
            run.fail("endless: more than " + std::to_string(depth) + " steps");
        }
        const std::size_t thread = choose(run, depth, runnable);
        if (redundant_ || !reduce_) {
            run.advance(thread);
        } else {
            advance_reduced(run, depth, thread);
        }
    }
}

void Explorer::advance_reduced(Run& run, std::size_t depth, std::size_t thread) {
    // The announcements before the step determine which threads stay asleep.
    std::array<bool, kMaxThreads> reads{};
    Threads same_word = 0;
    for (std::size_t other = 0; other < run.thread_count(); ++other) {
        reads[other] = !would_store(run, other);
        same_word |= run.announced_word(other) == run.announced_word(thread) ? bit_of(other) : 0U;
    }
    const Step step = run.advance(thread);
    next_asleep_ = (nodes_[depth].asleep | nodes_[depth].done) & ~bit_of(thread);
    for (std::size_t other = 0; other < run.thread_count(); ++other) {
        const bool conflicts =
            (same_word & bit_of(other)) != 0 && (step.effect.stored || !reads[other]);
        next_asleep_ &= conflicts ? ~bit_of(other) : ~Threads{0};
    }
    const auto& races = causality_.append(step.thread, step.word, step.effect.stored);
    if (depth + 1 >= replayed_) {
        for (const std::size_t event : races) {
            turn(event, causality_.first_when_turned(event));
        }
        note_waiting_races(run, step);
    }
}

/// The races of steps that are blocked: of a waiting thread, or of one that this step blocked.
void Explorer::note_waiting_races(Run& run, const Step& step) {
    for (std::size_t thread = 0; thread < run.thread_count(); ++thread) {
        if ((run.unfinished() & bit_of(thread)) == 0 || run.runnable(thread)) {
            continue;
        }
        const std::size_t word = run.announced_word(thread);
        if (thread == step.thread) {
            const bool stores = !only_reads(run.announced(thread).kind);
            for (const std::size_t event : causality_.conflicts(thread, word, stores)) {
                turn(event, causality_.first_when_turned(event, thread, word));
            }
        } else if (step.effect.stored && step.word == word) {
            const std::size_t last = causality_.events().size() - 1;
            turn(last, causality_.first_when_turned(last, thread, word));
        }
    }
}

/// Makes one of `firsts` an alternative to the choice that led to `event`, unless one already is.
void Explorer::turn(std::size_t event, Threads firsts) {
    Node& node = nodes_[event];
    const Threads possible = firsts & node.runnable;
    if (possible == 0 || (firsts & (node.wanted | node.asleep)) != 0) {
        return;
    }
    node.wanted |= bit_of(lowest(possible));
}

std::size_t Explorer::choose(Run& run, std::size_t depth, Threads runnable) {
    if (depth < replayed_) {
        if (runnable != nodes_[depth].runnable || signature(run) != nodes_[depth].signature) {
            run.fail("the program is not deterministic: a replayed step differs");
        }
        return nodes_[depth].chosen;
    }
    const Threads allowed = redundant_ ? 0 : candidates(depth, runnable);
    if (allowed == 0) {
        // Finished without branching instead of aborted: the threads' destructors run.
        redundant_ = true;
        const std::size_t last = run.steps().empty() ? 0 : run.steps().back().thread;
        const Threads after = runnable & ~(bit_of(last + 1) - 1);
        return lowest(after != 0 ? after : runnable);
    }
    Node node;
    const std::size_t last = depth > 0 ? nodes_[depth - 1].chosen : 0;
    const bool stays = depth > 0 && (allowed & bit_of(last)) != 0;
    node.chosen = stays ? last : lowest(allowed);
    node.runnable = runnable;
    node.asleep = next_asleep_;
    node.wanted = reduce_ ? bit_of(node.chosen) : allowed;
    node.preemptions = preemptions_before(depth);
    node.signature = signature(run);
    nodes_.push_back(node);
    return node.chosen;
}

/// How often the choices so far preempted a runnable thread.
unsigned Explorer::preemptions_before(std::size_t depth) const {
    if (depth < 2) {
        return 0;
    }
    const Node& last = nodes_[depth - 1];
    const std::size_t earlier = nodes_[depth - 2].chosen;
    const bool preempted = last.chosen != earlier && (last.runnable & bit_of(earlier)) != 0;
    return last.preemptions + (preempted ? 1U : 0U);
}

Threads Explorer::candidates(std::size_t depth, Threads runnable) {
    if (reduce_) {
        return runnable & ~next_asleep_;
    }
    if (options_.preemptions && depth > 0) {
        const Threads stay = runnable & bit_of(nodes_[depth - 1].chosen);
        if (stay != 0 && preemptions_before(depth) >= *options_.preemptions) {
            outcome_.bounded = outcome_.bounded || stay != runnable;
            return stay;
        }
    }
    return runnable;
}

bool Explorer::backtrack() {
    while (!nodes_.empty()) {
        Node& node = nodes_.back();
        node.done |= bit_of(node.chosen);
        const Threads left = node.wanted & ~node.done & ~node.asleep;
        if (left != 0) {
            node.chosen = lowest(left);
            replayed_ = nodes_.size();
            return true;
        }
        nodes_.pop_back();
    }
    return false;
}

}  // namespace

Outcome explore(const Program& program, const Options& options) {
    return Explorer(program, options).all();
}

}  // namespace tfdb::sched
