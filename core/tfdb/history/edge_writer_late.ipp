// EdgeWriter: samples that come out of order.
//
// The ring keeps commit order, so that snapshots and aborts only ever look at its end. Lateness is
// told to readers in two numbers: a ring is a few runs, and within a run two samples that are
// further apart than `slack` positions are in stamp order. A sample a little late widens the slack;
// one that is very late starts a new run; when there are too many runs they are sorted into one
// (`rebuild`), in a new block, and snapshots older than that look at every sample.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "tfdb/history/edge_writer.hpp"

namespace tfdb::history {

template <class Memory>
void EdgeWriter<Memory>::note_late(const WriteContext& context, StampNs stamp) {
    // The same stamp again is a correction, not lateness.
    if (stamp < newest())
        word(kLate).store_relaxed(word(kLate).load_relaxed() + 1);
    if (!widen_slack(word(kRing).load_relaxed(), stamp))
        start_run(context);
    word(kOrderedFrom).store_relaxed(word(kHead).load_relaxed() + 1);
    word(kTopology).store_release(topology() | Topology::kUnordered);
}

/// True if the sample fits into the last run, with a slack that stays small.
template <class Memory>
bool EdgeWriter<Memory>::widen_slack(std::uint64_t ring, StampNs stamp) {
    const std::uint64_t head = word(kHead).load_relaxed();
    const std::uint64_t order = word(kOrder).load_relaxed();
    const std::uint64_t slack = order & 0xFFFFFFFFU;
    const std::uint64_t runs = order >> 32;
    std::uint64_t start = std::max(word(kBegin).load_relaxed(), word(kCleared).load_relaxed());
    if (runs > 1) {
        start =
            std::max(start, memory_.word(RingWord::block(ring) + 8 * (runs - 1)).load_relaxed());
    }
    const auto root = static_cast<std::uint64_t>(std::sqrt(static_cast<double>(head - start)));
    const std::uint64_t limit = std::max(Tuning<Memory>::kSlackLimit, root);
    const std::uint64_t floor = head - start > limit ? head - limit : start;
    std::uint64_t at = head;  // first position from which all samples are later
    while (at > floor && stamp_at(ring, at - 1) > stamp)
        --at;
    if (at == floor && floor > start && stamp_at(ring, floor - 1) > stamp)
        return false;
    // Samples up to `slack` before its neighbour may still be later.
    const std::uint64_t from = at - start > slack + 1 ? at - 1 - slack : start;
    std::uint64_t first_later = at;
    for (std::uint64_t i = from; i < at; ++i) {
        if (stamp_at(ring, i) > stamp) {
            first_later = i;
            break;
        }
    }
    const std::uint64_t widened = std::max(slack, head - first_later);
    word(kOrder).store_release(runs << 32 | widened);
    return true;
}

template <class Memory>
void EdgeWriter<Memory>::start_run(const WriteContext& context) {
    if (word(kOrder).load_relaxed() >> 32 >= Tuning<Memory>::kMaxRuns)
        rebuild(context);
    const std::uint64_t order = word(kOrder).load_relaxed();
    const std::uint64_t runs = order >> 32;
    const std::uint64_t ring = word(kRing).load_relaxed();
    memory_.word(RingWord::block(ring) + 8 * runs).store_relaxed(word(kHead).load_relaxed());
    // A reader that counts this run must find where it starts.
    word(kOrder).store_release((runs + 1) << 32 | (order & 0xFFFFFFFFU));
}

/// All committed samples after the last clear, by stamp, and by index among equal stamps.
template <class Memory>
auto EdgeWriter<Memory>::sorted_samples(const WriteContext& context) const -> SortedSamples {
    const std::uint64_t ring = word(kRing).load_relaxed();
    SortedSamples sorted;
    sorted.first = std::max(word(kBegin).load_relaxed(), word(kCleared).load_relaxed());
    sorted.end = word(kHead).load_relaxed();
    while (sorted.end > sorted.first && commit_at(ring, sorted.end - 1) > context.committed)
        --sorted.end;
    sorted.samples.reserve(sorted.end - sorted.first);
    for (std::uint64_t i = sorted.first; i < sorted.end; ++i)
        sorted.samples.emplace_back(stamp_at(ring, i), i);
    std::sort(sorted.samples.begin(), sorted.samples.end());
    return sorted;
}

/// Puts the sorted samples, as one run, into a block of their own, up against those of the commit
/// in progress: these stay behind them in their own order, so that they can still be undone.
template <class Memory>
void EdgeWriter<Memory>::replace_by(const WriteContext& context, const SortedSamples& sorted) {
    const std::uint64_t old_ring = word(kRing).load_relaxed();
    const std::uint64_t head = word(kHead).load_relaxed();
    const std::uint64_t start = sorted.end - sorted.samples.size();
    const Offset block = memory_.allocate(RingLayout<Memory>::bytes(RingWord::capacity(old_ring)));
    const std::uint64_t ring =
        RingWord::pack(block, RingWord::log2_capacity(old_ring), RingWord::version(old_ring) + 1);
    for (std::uint64_t i = word(kBegin).load_relaxed(); i < sorted.first; ++i)
        copy_sample(old_ring, i, ring, i);
    for (std::uint64_t i = start; i < sorted.end; ++i)
        copy_sample(old_ring, sorted.samples[i - start].second, ring, i);
    for (std::uint64_t i = sorted.end; i < head; ++i)
        copy_sample(old_ring, i, ring, i);

    std::uint64_t runs = 1;
    memory_.word(block).store_relaxed(start);
    for (std::uint64_t i = sorted.end; i < head; ++i) {
        if (i == sorted.end || stamp_at(ring, i) < stamp_at(ring, i - 1)) {
            memory_.word(block + 8 * runs++).store_relaxed(i);
        }
    }
    close_ring();
    if (start > sorted.first) {
        word(kEvictSafe).store_relaxed(context.committed);
        word(kBegin).store_release(start);
    }
    word(kSortedEnd).store_relaxed(sorted.end);
    word(kSortedCommit).store_relaxed(context.committed);
    word(kOrder).store_relaxed(runs << 32);
    word(kParentFrom).store_relaxed(head);
    word(kTopology).store_release(topology() | Topology::kRebuilt);
    publish_ring(old_ring, ring);
}

/// One run in place of many.
template <class Memory>
void EdgeWriter<Memory>::rebuild(const WriteContext& context) {
    replace_by(context, sorted_samples(context));
}

/// Drops samples that a later one of the same stamp has replaced: a source that repeats its stamps
/// (a simulation that stands still) must not fill the memory. False if that would gain little.
template <class Memory>
bool EdgeWriter<Memory>::compact(const WriteContext& context) {
    SortedSamples sorted = sorted_samples(context);
    auto& samples = sorted.samples;
    std::size_t kept = 0;
    for (std::size_t i = 0; i < samples.size(); ++i) {
        if (i + 1 == samples.size() || samples[i + 1].first != samples[i].first)
            samples[kept++] = samples[i];
    }
    const std::uint64_t capacity = RingWord::capacity(word(kRing).load_relaxed());
    if (4 * (samples.size() - kept) < capacity)
        return false;
    samples.resize(kept);
    replace_by(context, sorted);
    return true;
}

}  // namespace tfdb::history
