// Ages of the sessions in a gate's slots, and their order.
#pragma once

#include "tfdb/engines/shared_state.hpp"
#include "tfdb/store/transaction.hpp"
#include "tfdb/txn/session.hpp"

namespace tfdb::txn {

/// A session's seniority: by priority, then by the commit at which its first attempt began, then by
/// slot. It is unique among the sessions in slots.
/// Threads: one; others read the age in the slot. Guarantee: wait-free.
template <class Memory>
class Seniority {
public:
    using Shared = SharedState<Memory>;
    using Options = TransactionOptions;

    explicit Seniority(const SessionOptions& options)
        : priority_(options.priority), age_(options.age) {}

    /// Call before the session requests its first lock.
    void take_place(Shared& shared, unsigned slot) {
        if (age_ == 0)
            age_ = shared.committed() + 1;
        word_ = std::uint64_t{Options::kMaxPriority - priority_} << Options::kAgeBits | age_;
        shared.gate.age(slot).store_relaxed(word_);
    }
    [[nodiscard]] bool senior_to(Shared& shared, unsigned slot, unsigned other) const {
        const std::uint64_t theirs = shared.gate.age(other).load_relaxed();
        return word_ < theirs || (word_ == theirs && slot < other);
    }
    [[nodiscard]] std::uint64_t age() const { return age_; }

private:
    unsigned priority_;
    std::uint64_t age_;
    std::uint64_t word_ = 0;
};

/// Calls visit(slot) for each bit of a frame lock's holders, until it returns false.
template <class Visit>
[[nodiscard]] bool all_of_holders(std::uint64_t holders, Visit visit) {
    for (; holders != 0; holders &= holders - 1) {
        if (!visit(static_cast<unsigned>(std::countr_zero(holders))))
            return false;
    }
    return true;
}

}  // namespace tfdb::txn
