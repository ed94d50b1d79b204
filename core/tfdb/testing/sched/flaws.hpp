#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <utility>
#include <vector>

#include "tfdb/testing/sched/run.hpp"
#include "tfdb/testing/sched/word.hpp"

// Seeds bugs between a protocol and its words, so that the tested code is the shipped code. Each
// seeded bug proves that a walk can fail.
namespace tfdb::sched {

using Which = std::function<bool(const Word&)>;

inline bool is_load(Kind kind) {
    return kind == Kind::kLoadRelaxed || kind == Kind::kLoadAcquire;
}

// Delays one thread's stores to some words until after its next store to another word. Create one
// per execution.
class Delays : public Interceptor {
public:
    Delays(std::size_t thread, Which delayed, const Word& until)
        : thread_(thread), delayed_(std::move(delayed)), until_(until) {}

    Effect access(Word& word, const Operation& operation) override {
        if (sched::Run::inside_thread()->current() != thread_) {
            return word.access_directly(operation);
        }
        if (is_load(operation.kind)) {
            for (auto held = held_.rbegin(); held != held_.rend(); ++held) {
                if (held->word == &word) {
                    return {held->operand, held->operand, false};
                }
            }
            return word.access_directly(operation);
        }
        if (delayed_(word)) {
            held_.push_back(operation);
            return {0, operation.operand, true};
        }
        const Effect effect = word.access_directly(operation);
        if (&word == &until_) {
            for (const Operation& held : std::exchange(held_, {})) {
                held.word->access_directly(held);
            }
        }
        return effect;
    }

private:
    std::size_t thread_;
    Which delayed_;
    const Word& until_;
    std::vector<Operation> held_;
};

// Drops some stores. Create one per execution.
class Forgets : public Interceptor {
public:
    using Forgotten = std::function<bool(const Word&, std::uint64_t value)>;
    explicit Forgets(Forgotten forgotten) : forgotten_(std::move(forgotten)) {}

    Effect access(Word& word, const Operation& operation) override {
        if (!is_load(operation.kind) && forgotten_(word, operation.operand)) {
            return {0, operation.operand, true};
        }
        return word.access_directly(operation);
    }

private:
    Forgotten forgotten_;
};

// Every second load of one word by a thread returns the first load's value: a repeated check
// without effect. Create one per execution.
class LooksOnce : public Interceptor {
public:
    LooksOnce(std::size_t thread, const Word& word) : thread_(thread), word_(word) {}

    Effect access(Word& word, const Operation& operation) override {
        if (&word != &word_ || !is_load(operation.kind) ||
            sched::Run::inside_thread()->current() != thread_) {
            return word.access_directly(operation);
        }
        looked_ = !looked_;
        if (looked_)
            seen_ = word.access_directly(operation).before;
        return {seen_, seen_, false};
    }

private:
    std::size_t thread_;
    const Word& word_;
    bool looked_ = false;
    std::uint64_t seen_ = 0;
};

// A thread's relaxed loads of one word return the value of its last acquiring load: a final check
// that sees old values. Create one per execution.
class BelievesFirst : public Interceptor {
public:
    BelievesFirst(std::size_t thread, const Word& word) : thread_(thread), believed_(word) {}

    Effect access(Word& word, const Operation& operation) override {
        const bool ours = &word == &believed_ && sched::Run::inside_thread()->current() == thread_;
        if (ours && operation.kind == Kind::kLoadRelaxed) {
            return {first_, first_, false};
        }
        const Effect effect = word.access_directly(operation);
        first_ = ours ? effect.before : first_;
        return effect;
    }

private:
    std::size_t thread_;
    const Word& believed_;
    std::uint64_t first_ = 0;
};

// A thread dies after a number of stores and marks that in a word, as the kernel does for the
// holder of a robust lock. The steps before its death may contain a seeded bug. Create one per
// execution.
class Dies : public Interceptor {
public:
    Dies(std::size_t thread, std::size_t stores, Word& told, Interceptor* flaw = nullptr)
        : thread_(thread), left_(stores), told_(told), flaw_(flaw) {}

    Effect access(Word& word, const Operation& operation) override {
        Run* const run = Run::inside_thread();
        if (run->current() == thread_ && !only_reads(operation.kind) && left_-- == 0) {
            told_.access_directly({Kind::kStoreRelease, &told_, 1, 0});
            run->die();
        }
        return flaw_ != nullptr ? flaw_->access(word, operation) : word.access_directly(operation);
    }

private:
    std::size_t thread_;
    std::size_t left_;
    Word& told_;
    Interceptor* flaw_;
};

}  // namespace tfdb::sched
