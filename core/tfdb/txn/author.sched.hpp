// Random scripts of commits for walks and simulations.
#pragma once

#include <algorithm>
#include <random>
#include <string>

#include "tfdb/txn/script.sched.hpp"

namespace tfdb::txn::forest {

// Creates random scripts; the naive model determines which commits the store accepts.
// One thread; the same seed gives the same script.
class Author {
public:
    explicit Author(std::uint64_t seed) : random_(seed) {}

    Script script() {
        static constexpr std::optional<StampNs> kHistories[] = {std::nullopt, 15, 35};
        Script script;
        script.history = kHistories[below(3)];
        naive::Model model(script.history);
        add(model, script.before, 2 + below(4));
        add(model, script.during, 1);
        for (std::uint64_t left = 1 + below(2); left > 0; --left) {
            Question question{name(), name(), std::nullopt};
            if (below(3) != 0) {
                question.stamp = static_cast<StampNs>(5 * below(14));
            }
            script.questions.push_back(question);
        }
        return script;
    }

    bool held() { return below(3) == 0; }

private:
    std::uint64_t below(std::uint64_t limit) { return random_() % limit; }
    std::string name() { return std::string(1, static_cast<char>('a' + below(4))); }

    void add(naive::Model& model, std::vector<Step>& steps, std::size_t wanted) {
        for (int tries = 0; tries < 100 && steps.size() < wanted; ++tries) {
            Step step = proposal();
            if (accept(model, step)) {
                steps.push_back(step);
            }
        }
    }

    Step proposal() {
        Step step;
        const std::string removed = name();
        const std::uint64_t chance = below(8);
        step.kind = chance == 0   ? Step::kRemove
                    : chance == 1 ? Step::kClear
                    : chance == 2 ? Step::kSetStatic
                                  : Step::kSet;
        if (step.kind == Step::kRemove)
            step.name = removed;
        clock_ += static_cast<StampNs>(below(12));
        for (std::uint64_t left = 1 + below(3) / 2; left > 0; --left) {
            const StampNs stamp = clock_ - (below(4) == 0 ? static_cast<StampNs>(below(20)) : 0);
            step.edges.push_back({name(), name(), std::max<StampNs>(0, stamp)});
        }
        if (step.edges.size() == 2 && step.edges[0].child == step.edges[1].child) {
            step.edges.pop_back();  // the store sorts the members of one edge; this one does not
        }
        return step;
    }

    /// Determines the store's result of the step; false: it would be refused before it is written.
    bool accept(naive::Model& model, Step& step) {
        if (step.kind == Step::kClear) {
            step.edges.clear();
            model.clear();
            return true;
        }
        if (step.kind == Step::kRemove) {
            step.edges.clear();
            return !model.remove(step.name, false);
        }
        std::vector<naive::Member> batch;
        for (const Step::Edge& edge : step.edges) {
            batch.push_back({edge.parent, edge.child, edge.stamp, pose_of(0, 0)});
        }
        const bool is_static = step.kind == Step::kSetStatic;
        const WriteRules rules{.change_kind = true};
        if (!model.faults(batch, is_static, rules).empty())
            return false;
        if (!model.closes_cycle(batch, is_static)) {
            model.set(batch, is_static);
            return true;
        }
        step.kind = Step::kSetCycle;
        return !is_static;
    }

    std::mt19937_64 random_;
    StampNs clock_ = 0;
};

/// The script in one line, for reports.
inline std::string describe(const Script& script) {
    static constexpr const char* kKinds[] = {"set", "static", "cycle", "remove", "clear"};
    std::string text =
        "history " + (script.history ? std::to_string(*script.history) : std::string("all"));
    const auto add = [&](const std::vector<Step>& steps) {
        for (const Step& step : steps) {
            text += std::string(", ") + kKinds[step.kind];
            text += step.kind == Step::kRemove ? " " + step.name : "";
            for (const Step::Edge& edge : step.edges) {
                text += " " + edge.parent + "<-" + edge.child + "@" + std::to_string(edge.stamp);
            }
        }
    };
    add(script.before);
    text += " | ";
    add(script.during);
    for (const Question& question : script.questions) {
        text += " ? " + question.target + "<-" + question.source + " at " +
                (question.stamp ? std::to_string(*question.stamp) : std::string("latest"));
    }
    return text;
}

}  // namespace tfdb::txn::forest
