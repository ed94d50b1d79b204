// EdgeView: the search for the samples around a stamp.
#pragma once

#include <algorithm>
#include <bit>

#include "tfdb/history/edge_view.hpp"

namespace tfdb::history {

/// Branch-free halving over [from, to): first index whose stamp is greater.
template <class Memory>
std::uint64_t EdgeView<Memory>::search_tail(std::uint64_t from, std::uint64_t to,
                                            StampNs stamp) const {
    std::uint64_t length = to - from;
    while (length > 0) {
        const std::uint64_t half = length / 2;
        const bool right = stamp_at(from + half) <= stamp;
        from = right ? from + half + 1 : from;
        length = right ? length - half - 1 : half;
    }
    return from;
}

/// Most lookups ask for the last few samples: try those, then guess from the mean rate and gallop,
/// and halve what is left when a gap has misled the guess.
template <class Memory>
std::uint64_t EdgeView<Memory>::upper_bound(StampNs stamp) const {
    constexpr std::uint64_t kNear = 4;
    constexpr std::uint64_t kGallop = 64;
    std::uint64_t high = hi_;
    for (std::uint64_t i = 0; i < kNear; ++i) {
        if (high == lo_ || stamp_at(high - 1) <= stamp)
            return high;
        --high;
    }
    std::uint64_t low = lo_;
    const double back = static_cast<double>(stamp_at(high) - stamp) *
                        std::bit_cast<double>(word(kRate).load_relaxed());
    const double room = static_cast<double>(high - low);
    if (!(back >= 0.0 && back < room))
        return search_tail(low, high, stamp);
    std::uint64_t guess = high - static_cast<std::uint64_t>(back);
    if (guess >= high)
        guess = high - 1;
    std::uint64_t step = 1;
    if (stamp_at(guess) <= stamp) {
        low = guess + 1;
        while (low + step < high && step <= kGallop && stamp_at(low + step) <= stamp) {
            low += step + 1;
            step *= 2;
        }
        if (step <= kGallop && low + step < high)
            high = low + step;
    } else {
        high = guess;
        while (high > low + step && step <= kGallop && stamp_at(high - step) > stamp) {
            high -= step;
            step *= 2;
        }
        if (step <= kGallop && high > low + step)
            low = high - step + 1;
    }
    return search_tail(low, high, stamp);
}

/// Calls visit(index, stamp) in index order on every visible sample that can be next to `stamp`:
/// in each run those within the run's slack around the place where the search ended.
template <class Memory>
template <class Visit>
void EdgeView<Memory>::visit_near(StampNs stamp, Visit visit) const {
    if (mode_ == Mode::kScan) {
        for (std::uint64_t i = lo_; i < hi_; ++i) {
            if (visible(i))
                visit(i, stamp_at(i));
        }
        return;
    }
    const std::uint64_t order = word(kOrder).load_acquire();
    const std::uint64_t slack = order & 0xFFFFFFFFU;
    const auto runs = static_cast<unsigned>(std::min<std::uint64_t>(order >> 32, kMaxRuns));
    const Offset starts = RingWord::block(ring_);
    for (unsigned run = 0; run < runs; ++run) {
        std::uint64_t from = lo_;
        std::uint64_t to = hi_;
        if (run > 0)
            from = std::max(from, memory_->word(starts + 8 * run).load_relaxed());
        if (run + 1 < runs)
            to = std::min(to, memory_->word(starts + 8 * (run + 1)).load_relaxed());
        if (from >= to)
            continue;
        const std::uint64_t p = search_tail(from, to, stamp);
        const std::uint64_t first = p - from > slack + 1 ? p - 1 - slack : from;
        const std::uint64_t last = to - p > slack + 1 ? p + slack + 1 : to;
        for (std::uint64_t i = first; i < last; ++i)
            visit(i, stamp_at(i));
    }
}

template <class Memory>
StampNs EdgeView<Memory>::newest_stamp() const {
    if (mode_ == Mode::kOrdered)
        return stamp_at(hi_ - 1);
    StampNs newest = kNoStamp;
    // Searching for the end of time ends at each run's end.
    visit_near(std::numeric_limits<StampNs>::max(), [&](std::uint64_t, StampNs s) {
        if (s > newest)
            newest = s;
    });
    return newest;
}

/// Among equal stamps the later index is the newer commit, and wins.
template <class Memory>
auto EdgeView<Memory>::last_at_or_before(StampNs stamp) const -> Found {
    Found best;
    visit_near(stamp, [&](std::uint64_t i, StampNs s) {
        if (s <= stamp && s >= 0 && s >= best.stamp)
            best = {i, s};
    });
    return best;
}

template <class Memory>
StampNs EdgeView<Memory>::least_stamp_after(StampNs stamp) const {
    StampNs least = kNoStamp;
    visit_near(stamp, [&](std::uint64_t, StampNs s) {
        if (s > stamp && s >= 0 && (least == kNoStamp || s < least))
            least = s;
    });
    return least;
}

template <class Memory>
bool EdgeView<Memory>::bracket_general(StampNs stamp, Bracket& out) const {
    out = Bracket{};
    out.lowest = lo_;
    if (may_miss())
        return false;
    const Found before = last_at_or_before(stamp);
    if (before.index != kNoIndex && before.stamp >= cutoff()) {
        out.before = before.index;
        out.before_stamp = before.stamp;
    }
    const StampNs next = least_stamp_after(std::max(stamp, cutoff() - 1));
    if (next != kNoStamp) {
        out.after_stamp = next;
        out.after = last_at_or_before(next).index;
    }
    return true;
}

}  // namespace tfdb::history
