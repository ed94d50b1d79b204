#include "tfdb/testing/sched/word.hpp"

#include <algorithm>

#include "tfdb/testing/sched/run.hpp"

namespace tfdb::sched {

const char* spelling(Kind kind) {
    switch (kind) {
        case Kind::kLoadRelaxed:
            return "load.relaxed";
        case Kind::kLoadAcquire:
            return "load.acquire";
        case Kind::kStoreRelaxed:
            return "store.relaxed";
        case Kind::kStoreRelease:
            return "store.release";
        case Kind::kCompareExchange:
            return "compare_exchange";
        case Kind::kExchange:
            return "exchange";
        case Kind::kFetchAdd:
            return "fetch_add";
        case Kind::kWait:
            return "wait";
        case Kind::kFallAsleep:
            return "fall_asleep";
        case Kind::kWake:
            return "wake";
        case Kind::kNotifyOne:
            return "notify_one";
        case Kind::kNotifyAll:
            return "notify_all";
    }
    return "?";
}

bool only_reads(Kind kind) {
    return kind == Kind::kLoadRelaxed || kind == Kind::kLoadAcquire || kind == Kind::kWait;
}

std::string Word::name() const {
    if (name_ == nullptr) {
        return "word " + std::to_string(number_);
    }
    return number_ == 0 ? name_ : name_ + (" " + std::to_string(number_));
}

Effect Word::access(const Operation& operation) {
    const bool intercepted = interceptor_ != nullptr && Run::inside_thread() != nullptr;
    return intercepted ? interceptor_->access(*this, operation) : access_directly(operation);
}

Effect Word::access_directly(const Operation& operation) {
    Run* const run = Run::inside_thread();
    return run == nullptr ? perform(operation, 0) : run->step(operation);
}

Effect Word::perform(const Operation& operation, std::size_t thread) {
    Effect effect{value_, value_, true};
    switch (operation.kind) {
        case Kind::kLoadRelaxed:
        case Kind::kLoadAcquire:
        case Kind::kWait:
            effect.stored = false;
            break;
        case Kind::kStoreRelaxed:
        case Kind::kStoreRelease:
        case Kind::kExchange:
            effect.after = operation.operand;
            break;
        case Kind::kFetchAdd:
            effect.after = value_ + operation.operand;
            break;
        case Kind::kCompareExchange:
            effect.stored = value_ == operation.expected;
            effect.after = effect.stored ? operation.operand : value_;
            break;
        case Kind::kFallAsleep:
            effect.stored = value_ == operation.expected;
            asleep_ |= effect.stored ? 1U << thread : 0U;
            break;
        case Kind::kWake:
        case Kind::kNotifyOne:
        case Kind::kNotifyAll:
            queue_perform(operation.kind, thread);
            break;
    }
    value_ = effect.after;
    return effect;
}

bool Word::can_perform(const Operation& operation, std::size_t thread) const {
    if (operation.kind == Kind::kWait) {
        return value_ != operation.expected;
    }
    const auto wakes = [&](std::uint32_t who) { return (who >> thread & 1U) != 0; };
    return operation.kind != Kind::kWake || std::any_of(wakeups_.begin(), wakeups_.end(), wakes);
}

/// A notify wakes one of the threads asleep at that moment; the choice is made when one wakes.
void Word::queue_perform(Kind kind, std::size_t thread) {
    if (kind == Kind::kNotifyOne && asleep_ != 0) {
        wakeups_.push_back(asleep_);
    }
    for (std::uint32_t who = 1; kind == Kind::kNotifyAll && who <= asleep_; who <<= 1) {
        if ((asleep_ & who) != 0) {
            wakeups_.push_back(who);
        }
    }
    if (kind == Kind::kWake) {
        const std::uint32_t self = 1U << thread;
        const auto taken = [&](std::uint32_t who) { return (who & self) != 0; };
        wakeups_.erase(std::find_if(wakeups_.begin(), wakeups_.end(), taken));
        asleep_ &= ~self;
        for (std::uint32_t& who : wakeups_) {
            who &= ~self;
        }
        std::erase(wakeups_, 0U);
    }
}

}  // namespace tfdb::sched
