#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace tfdb::sched {

class Word;

/// What a thread does to a word. The memory orders are kept for the printed schedule only.
enum class Kind : std::uint8_t {
    kLoadRelaxed,
    kLoadAcquire,
    kStoreRelaxed,
    kStoreRelease,
    kCompareExchange,
    kExchange,
    kFetchAdd,
    kWait,
};

/// One access as announced, before it has happened.
struct Operation {
    Kind kind;
    Word* word;
    std::uint64_t operand;   // stored, added, or desired
    std::uint64_t expected;  // of a compare-exchange; for a wait: the value that blocks
};

/// What an access did.
struct Effect {
    std::uint64_t before;
    std::uint64_t after;
    bool stored;
};

/// The spelling that a schedule shows, for example "store.release".
const char* spelling(Kind kind);

/// True for what may store: a compare-exchange counts, also when it would fail.
bool may_store(Kind kind);

// A shared word whose every access is a point where the walk may switch threads.
// Any walked thread may call all; outside a running walk the accesses happen directly.
// Sequentially consistent: weaker orders are accepted and recorded, Relacy judges those.
class Word {
public:
    explicit Word(std::uint64_t value = 0, std::string name = {})
        : value_(value), name_(std::move(name)) {}
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

    /// Not runnable while the word holds `blocked`; returns the value that let it go on.
    std::uint64_t wait_while(std::uint64_t blocked) {
        return access({Kind::kWait, this, 0, blocked}).before;
    }

    /// The value, without being a step of the schedule: for the walker and for final checks.
    [[nodiscard]] std::uint64_t peek() const { return value_; }

    [[nodiscard]] const std::string& name() const { return name_; }
    void rename(std::string name) { name_ = std::move(name); }

private:
    friend class Run;

    [[nodiscard]] std::uint64_t read(Kind kind) const {
        return const_cast<Word*>(this)->access({kind, const_cast<Word*>(this), 0, 0}).before;
    }
    Effect access(const Operation& operation);
    Effect perform(const Operation& operation);

    std::uint64_t value_;
    std::string name_;
    std::uint32_t run_ = 0;      // the execution in which `identity_` was given
    std::uint32_t identity_ = 0;  // order of first access in that execution
};

}  // namespace tfdb::sched
