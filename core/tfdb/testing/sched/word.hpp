#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "tfdb/sync/word.hpp"

namespace tfdb::sched {

class Word;

/// A thread's access to a word. The memory orders are kept only for the printed schedule.
enum class Kind : std::uint8_t {
    kLoadRelaxed,
    kLoadAcquire,
    kStoreRelaxed,
    kStoreRelease,
    kCompareExchange,
    kExchange,
    kFetchAdd,
    kWait,        // blocks until the value differs
    kFallAsleep,  // atomic wait, first half: queues the thread if the value is still the same
    kWake,        // atomic wait, second half: blocks until a notify has taken it off the queue
    kNotifyOne,
    kNotifyAll,
};

/// An access as announced, before it happens.
struct Operation {
    Kind kind;
    Word* word;
    std::uint64_t operand;   // stored, added, or desired
    std::uint64_t expected;  // of a compare-exchange; for a wait: the value that blocks
};

/// The effect of an access.
struct Effect {
    std::uint64_t before;
    std::uint64_t after;
    bool stored;
};

/// The name in a schedule, for example "store.release".
const char* spelling(Kind kind);

/// True for loads and waits: other threads cannot observe them.
bool only_reads(Kind kind);

// Intercepts a thread's accesses: a test seeds a bug without changing the protocol. Called only by
// walked threads. It may change, drop or forward the access.
class Interceptor {
public:
    virtual ~Interceptor() = default;
    virtual Effect access(Word& word, const Operation& operation) = 0;
};

// A shared word: the walk may switch threads at each access. Any walked thread may call all
// functions; outside a running walk the accesses happen directly. Sequentially consistent: weaker
// orders are accepted and recorded, and Relacy checks them.
class Word {
public:
    /// `name` is a literal; a nonzero number is printed after it.
    explicit Word(std::uint64_t value = 0, const char* name = nullptr)
        : value_(value), name_(name) {}
    Word(const Word&) = delete;
    Word& operator=(const Word&) = delete;

    [[nodiscard]] std::uint64_t load_relaxed() const { return read(Kind::kLoadRelaxed); }
    [[nodiscard]] std::uint64_t load_acquire() const { return read(Kind::kLoadAcquire); }
    void store_relaxed(std::uint64_t value) { access({Kind::kStoreRelaxed, this, value, 0}); }
    void store_release(std::uint64_t value) { access({Kind::kStoreRelease, this, value, 0}); }

    bool compare_exchange(std::uint64_t& expected, std::uint64_t desired) {
        const Effect effect = access({Kind::kCompareExchange, this, desired, expected});
        expected = effect.before;
        return effect.stored;
    }
    std::uint64_t exchange(std::uint64_t value) {
        return access({Kind::kExchange, this, value, 0}).before;
    }
    std::uint64_t fetch_add(std::uint64_t value) {
        return access({Kind::kFetchAdd, this, value, 0}).before;
    }

    // The walk is one total order already, so these need no separate operation; fences order
    // nothing.
    [[nodiscard]] std::uint64_t load_ordered() const { return read(Kind::kLoadAcquire); }
    bool compare_exchange_ordered(std::uint64_t& expected, std::uint64_t desired) {
        return compare_exchange(expected, desired);
    }
    static void fence_acquire() {}
    static void fence_release() {}
    static void fence_full() {}
    static void fence_full_after_exchange() {}

    /// Not runnable while the word holds `blocked`; returns the value that unblocked it.
    std::uint64_t wait_while(std::uint64_t blocked) {
        return access({Kind::kWait, this, 0, blocked}).before;
    }

    /// std::atomic::wait and notify_one, including lost wake-ups: a sleeper needs a notify.
    void wait(std::uint64_t old) const {
        Word& self = const_cast<Word&>(*this);
        while (self.access({Kind::kFallAsleep, &self, 0, old}).stored) {
            self.access({Kind::kWake, &self, 0, 0});
        }
    }
    void notify_one() { access({Kind::kNotifyOne, this, 0, 0}); }
    void notify_all() { access({Kind::kNotifyAll, this, 0, 0}); }

    /// A futex without signals. Short sleeps end at once; others last until a wake.
    sync::Woken sleep(std::uint64_t old, std::int64_t longest_ns) const {
        if (longest_ns == 1) {
            (void)load_relaxed();
            return sync::Woken::kTimedOut;
        }
        wait(old);
        return sync::Woken::kChanged;
    }
    void wake_one() { notify_one(); }
    void wake_all() { notify_all(); }

    /// The value, without a step of the schedule: for the walker and for final checks.
    [[nodiscard]] std::uint64_t peek() const { return value_; }

    /// The access itself, bypassing any interceptor.
    Effect access_directly(const Operation& operation);
    void intercept(Interceptor* interceptor) { interceptor_ = interceptor; }

    [[nodiscard]] std::string name() const;
    void rename(const char* name, std::uint32_t number) {
        name_ = name;
        number_ = number;
    }

private:
    friend class Run;

    [[nodiscard]] std::uint64_t read(Kind kind) const {
        return const_cast<Word*>(this)->access({kind, const_cast<Word*>(this), 0, 0}).before;
    }
    Effect access(const Operation& operation);
    Effect perform(const Operation& operation, std::size_t thread);
    [[nodiscard]] bool can_perform(const Operation& operation, std::size_t thread) const;
    void queue_perform(Kind kind, std::size_t thread);

    std::uint64_t value_;
    const char* name_;
    Interceptor* interceptor_ = nullptr;
    std::uint32_t number_ = 0;
    std::uint32_t run_ = 0;               // the execution in which `identity_` was given
    std::uint32_t identity_ = 0;          // order of first access in that execution
    std::uint32_t asleep_ = 0;            // threads in the queue of wait()
    std::vector<std::uint32_t> wakeups_;  // for each notify: the threads that it may have woken
};

}  // namespace tfdb::sched
