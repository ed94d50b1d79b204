#include "tfdb/testing/sched/causality.hpp"

#include <algorithm>

namespace tfdb::sched {

namespace {

void join(Clock& into, const Clock& from) {
    for (std::size_t thread = 0; thread < kMaxThreads; ++thread) {
        into[thread] = std::max(into[thread], from[thread]);
    }
}

}  // namespace

void Causality::clear() {
    events_.clear();
    words_.clear();
    clocks_ = {};
}

Causality::Touches& Causality::touches(std::size_t word) {
    while (words_.size() <= word) {
        words_.emplace_back().last_read.fill(Touches::kNone);
    }
    return words_[word];
}

bool Causality::before(std::size_t event, const Clock& clock) const {
    return clock[events_[event].thread] >= events_[event].sequence;
}

const std::vector<std::size_t>& Causality::append(std::size_t thread, std::size_t word,
                                                  bool stored) {
    Touches& touched = touches(word);
    Clock& clock = clocks_[thread];
    races_.clear();
    const auto consider = [&](std::size_t earlier) {
        if (earlier != Touches::kNone && !before(earlier, clock)) {
            races_.push_back(earlier);
        }
    };
    consider(touched.last_store);
    if (stored) {
        for (const std::size_t reader : touched.last_read) {
            consider(reader);
        }
    }
    for (const std::size_t earlier : races_) {
        join(clock, events_[earlier].clock);
    }
    keep_immediate();
    clock[thread] += 1;
    events_.push_back({thread, clock[thread], stored, word, clock});
    if (stored) {
        touched.last_store = events_.size() - 1;
        touched.last_read.fill(Touches::kNone);
    } else {
        touched.last_read[thread] = events_.size() - 1;
    }
    return races_;
}

/// Drops a race with an event that already precedes another racing event.
void Causality::keep_immediate() {
    const std::vector<std::size_t> all = races_;
    races_.clear();
    for (const std::size_t event : all) {
        const bool covered = std::any_of(all.begin(), all.end(), [&](std::size_t other) {
            return other != event && before(event, events_[other].clock);
        });
        if (!covered) {
            races_.push_back(event);
        }
    }
}

const std::vector<std::size_t>& Causality::conflicts(std::size_t thread, std::size_t word,
                                                     bool stores) {
    races_.clear();
    for (std::size_t event = 0; event < events_.size(); ++event) {
        const Event& earlier = events_[event];
        if (earlier.word == word && (stores || earlier.stored) && earlier.thread != thread &&
            !before(event, clocks_[thread])) {
            races_.push_back(event);
        }
    }
    return races_;
}

Threads Causality::first_when_turned(std::size_t event) const {
    return firsts(event, events_.size() - 1, events_.back());
}

Threads Causality::first_when_turned(std::size_t event, std::size_t thread,
                                     std::size_t word) const {
    Event announced{thread, clocks_[thread][thread] + 1, false, word, clocks_[thread]};
    if (word < words_.size() && words_[word].last_store != Touches::kNone) {
        join(announced.clock, events_[words_[word].last_store].clock);
    }
    announced.clock[thread] = announced.sequence;
    return firsts(event, events_.size(), announced);
}

Threads Causality::firsts(std::size_t event, std::size_t end, const Event& last) const {
    Threads seen = 0;
    Threads result = 0;
    Clock first_sequence{};
    const auto take = [&](const Event& candidate) {
        const Threads bit = Threads{1} << candidate.thread;
        if ((seen & bit) != 0) {
            return;
        }
        bool is_first = true;
        for (std::size_t other = 0; other < kMaxThreads; ++other) {
            if ((seen >> other & 1U) != 0 && candidate.clock[other] >= first_sequence[other]) {
                is_first = false;
            }
        }
        seen |= bit;
        first_sequence[candidate.thread] = candidate.sequence;
        result |= is_first ? bit : 0;
    };
    for (std::size_t later = event + 1; later < end; ++later) {
        if (!before(event, events_[later].clock)) {
            take(events_[later]);
        }
    }
    take(last);
    return result;
}

}  // namespace tfdb::sched
