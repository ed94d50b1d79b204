#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace tfdb::sched {

inline constexpr std::size_t kMaxThreads = 6;

/// A set of threads, bit i for thread i.
using Threads = std::uint32_t;

/// Number of each thread's events known to have happened before.
using Clock = std::array<std::uint32_t, kMaxThreads>;

// The happens-before order of one execution: program order plus conflicts on the same word. Used by
// one OS thread. It determines the racing events, and the threads that can go first when a race is
// reversed.
class Causality {
public:
    struct Event {
        std::size_t thread;
        std::uint32_t sequence;  // counts from 1 inside its thread
        bool stored;
        std::size_t word;
        Clock clock;  // everything before it, including itself
    };

    void clear();

    /// Appends the next event. Returns the earlier events that race with it: conflicting, of
    /// another thread, with no event between the two in the happens-before order.
    const std::vector<std::size_t>& append(std::size_t thread, std::size_t word, bool stored);

    /// The events that conflict with an announced, still blocked access to `word` by `thread`, and
    /// do not precede it already.
    const std::vector<std::size_t>& conflicts(std::size_t thread, std::size_t word, bool stores);

    /// The threads that can take the first step of: everything after `event` that does not depend
    /// on it, then the last event (the racing one).
    [[nodiscard]] Threads first_when_turned(std::size_t event) const;

    /// The same if the racing event is only announced: an access to `word` by `thread`.
    [[nodiscard]] Threads first_when_turned(std::size_t event, std::size_t thread,
                                            std::size_t word) const;

    [[nodiscard]] const std::vector<Event>& events() const { return events_; }

private:
    struct Touches {
        static constexpr std::size_t kNone = ~std::size_t{0};
        std::size_t last_store = kNone;
        std::array<std::size_t, kMaxThreads> last_read;  // since the last store
    };

    Touches& touches(std::size_t word);
    [[nodiscard]] bool before(std::size_t event, const Clock& clock) const;
    [[nodiscard]] Threads firsts(std::size_t event, std::size_t end, const Event& last) const;
    void keep_immediate();

    std::vector<Event> events_;
    std::vector<Touches> words_;
    std::array<Clock, kMaxThreads> clocks_{};
    std::vector<std::size_t> races_;
};

}  // namespace tfdb::sched
