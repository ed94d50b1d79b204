#include "tfdb/testing/sched/run.hpp"

#include <cstdio>
#include <cstdlib>
#include <exception>
#include <utility>

namespace tfdb::sched {

namespace {

Run* g_active = nullptr;
std::uint32_t g_run_number = 0;

}  // namespace

Run::Run(std::vector<Fiber>& fibers, Driver driver)
    : fibers_(fibers), driver_(std::move(driver)), number_(++g_run_number) {
    threads_.reserve(kMaxThreads);
    g_active = this;
}

Run::~Run() {
    g_active = nullptr;
}

Run* Run::inside_thread() {
    return g_active != nullptr && g_active->in_thread_ ? g_active : nullptr;
}

void Run::thread(std::string name, std::function<void()> body, std::size_t dies_after) {
    if (threads_.size() == kMaxThreads) {
        fail("too many threads in one program");
    }
    Thread added{};
    added.name = std::move(name);
    added.body = std::move(body);
    added.dies_after = dies_after;
    threads_.push_back(std::move(added));
}

void Run::join() {
    for (std::size_t thread = 0; thread < threads_.size(); ++thread) {
        launch(thread);
    }
    driver_(*this);
}

void Run::launch(std::size_t thread) {
    Thread& launched = threads_[thread];
    launched.fiber = &fibers_[thread];
    launched.fiber->start([this, &launched] {
        try {
            launched.body();
        } catch (const Violation& violation) {
            violation_ = violation.what;
        } catch (const std::exception& error) {
            violation_ = launched.name + " ended with an exception: " + error.what();
        }
        launched.finished = true;
    });
    if (launched.dies_after == 0) {
        launched.finished = true;
        launched.died = true;
        return;
    }
    go_on(thread);
}

/// Runs a thread until it announces its next access.
void Run::go_on(std::size_t thread) {
    current_ = thread;
    in_thread_ = true;
    threads_[thread].fiber->resume();
    in_thread_ = false;
    if (!violation_.empty()) {
        fail(std::exchange(violation_, {}));
    }
}

Effect Run::step(const Operation& operation) {
    Thread& self = threads_[current_];
    self.announced = operation;
    self.announced_word = identity(*operation.word);
    self.fiber->suspend();
    return self.effect;
}

void Run::die() {
    Thread& self = threads_[current_];
    self.finished = true;
    self.died = true;
    self.fiber->suspend();
    std::abort();  // never resumed
}

const Step& Run::advance(std::size_t thread) {
    Thread& self = threads_[thread];
    const Operation operation = self.announced;
    self.effect = operation.word->perform(operation, thread);
    steps_.push_back({thread, operation.kind, self.announced_word, self.effect});
    self.accesses += 1;
    if (self.accesses == self.dies_after) {
        self.finished = true;
        self.died = true;
    } else {
        go_on(thread);
    }
    return steps_.back();
}

Threads Run::unfinished() const {
    Threads set = 0;
    for (std::size_t thread = 0; thread < threads_.size(); ++thread) {
        set |= threads_[thread].finished ? 0U : Threads{1} << thread;
    }
    return set;
}

Threads Run::runnable() const {
    Threads set = 0;
    for (std::size_t thread = 0; thread < threads_.size(); ++thread) {
        set |= runnable(thread) ? Threads{1} << thread : 0U;
    }
    return set;
}

bool Run::runnable(std::size_t thread) const {
    const Thread& asked = threads_[thread];
    if (asked.finished) {
        return false;
    }
    return asked.announced.word->can_perform(asked.announced, thread);
}

const Operation& Run::announced(std::size_t thread) const {
    return threads_[thread].announced;
}

std::size_t Run::announced_word(std::size_t thread) const {
    return threads_[thread].announced_word;
}

std::size_t Run::identity(Word& word) {
    if (word.run_ != number_) {
        word.run_ = number_;
        word.identity_ = static_cast<std::uint32_t>(words_.size());
        words_.push_back(&word);
    }
    return word.identity_;
}

void Run::fail(std::string what) const {
    throw Violation{std::move(what), schedule()};
}

void Run::require(bool holds, const char* text, const char* file, int line) {
    if (holds) {
        return;
    }
    const std::string path = file;
    const std::string name = path.substr(path.find_last_of('/') + 1);
    const std::string what = name + ":" + std::to_string(line) + ": " + text;
    if (inside_thread() == nullptr && g_active != nullptr) {
        g_active->fail(what);
    }
    throw Violation{what, {}};
}

std::string Run::schedule() const {
    std::string text;
    char line[256];
    for (std::size_t index = 0; index < steps_.size(); ++index) {
        const Step& done = steps_[index];
        const bool sets_value = !only_reads(done.kind) && done.kind < Kind::kFallAsleep;
        const char* arrow = !sets_value ? "->" : done.effect.stored ? "<-" : "unchanged";
        const std::uint64_t value = done.effect.stored ? done.effect.after : done.effect.before;
        std::snprintf(line, sizeof line, "    %3zu  %-10s %-17s %-18s %s %llu\n", index + 1,
                      threads_[done.thread].name.c_str(), spelling(done.kind),
                      words_[done.word]->name().c_str(), arrow,
                      static_cast<unsigned long long>(value));
        text += line;
    }
    for (const Thread& thread : threads_) {
        if (thread.died) {
            text += "         " + thread.name + " was killed after " +
                    std::to_string(thread.accesses) + " accesses\n";
        } else if (!thread.finished) {
            const Operation& next = thread.announced;
            text += "         " + thread.name + " stands before " + spelling(next.kind) + " " +
                    words_[thread.announced_word]->name() + "\n";
        }
    }
    return text;
}

}  // namespace tfdb::sched
