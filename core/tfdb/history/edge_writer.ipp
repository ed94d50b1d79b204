// The member functions of EdgeWriter.
#pragma once

#include "tfdb/history/edge_writer.hpp"

namespace tfdb::history {

// -- one sample ---------------------------------------------------------------------------------

template <class Memory>
void EdgeWriter<Memory>::append(const WriteContext& context, const NewSample<Memory>& sample) {
    const SampleAt newest = newest_sample();
    if (!newest || sample.stamp >= newest.stamp) {
        append_behind(context, sample, newest);
    } else {
        with_memory(context, [&] { insert_late(context, sample, newest); });
    }
}

template <class Memory>
void EdgeWriter<Memory>::append(const WriteContext& context,
                                std::span<const NewSample<Memory>> samples) {
    while (!samples.empty()) {
        const SampleAt newest = newest_sample();
        const Seg tail = this->tail();
        if (!newest || samples.front().stamp >= newest.stamp)
            return append_behind(
                context, samples.size(), [&](std::size_t i) -> const auto& { return samples[i]; });
        const auto is_before_tail = [&](const NewSample<Memory>& sample) {
            return sample.stamp < newest.stamp &&
                   (tail.empty() || sample.stamp < tail.stamp(tail.begin()));
        };
        const auto before = static_cast<std::size_t>(
            std::find_if_not(samples.begin(), samples.end(), is_before_tail) - samples.begin());
        if (before > 1 && begin() != end()) {
            with_memory(context, [&] { insert_run(context, samples.first(before), newest); });
            samples = samples.subspan(before);
        } else {
            append(context, samples.front());
            samples = samples.subspan(1);
        }
    }
}

/// Updates the header's other words before the sample becomes part of the edge.
template <class Memory>
void EdgeWriter<Memory>::note(const WriteContext& context, const NewSample<Memory>& sample,
                              const SampleAt& newest) {
    this->word(kChanged).store_relaxed(context.number());
    const std::uint64_t topology = this->topology();
    if (!newest) {
        const std::uint64_t flags =
            topology & (Topology::kMortal | Topology::kCleared | Topology::kParented);
        this->word(kParentFrom).store_relaxed(as_word(sample.stamp));
        this->word(kTopology).store_release(Topology::with_parent(flags, sample.parent, 0));
        return;
    }
    if (Topology::parent(topology) == sample.parent)
        return;
    const bool last = sample.stamp >= newest.stamp;
    // Replaced samples of the same stamp may name another parent. A late sample's interval ends
    // where the next sample begins, which is no later than the newest.
    const StampNs from = last && sample.stamp > newest.stamp ? sample.stamp : newest.stamp + 1;
    this->word(kParentFrom)
        .store_relaxed(as_word(std::max(from, as_stamp(this->word(kParentFrom).load_relaxed()))));
    this->word(kTopology).store_release(
        Topology::with_parent(topology, last ? sample.parent : Topology::parent(topology),
                              Topology::depth(topology)) |
        Topology::kMixedParents);
}

/// Writes into an unpublished slot.
template <class Memory>
void EdgeWriter<Memory>::write(const WriteContext& context, const Seg& into, std::uint64_t index,
                               const NewSample<Memory>& sample) {
    store_sample(memory_, into, index, sample, context.number());
    // If there are others, they are older.
    if (into.empty())
        into.meta(kLeast).store_relaxed(context.number());
}

/// If the limit is reached, it uses retired blocks first, and at last those that held snapshots
/// need: snapshots make writers use more memory, but never stop them.
template <class Memory>
template <class Work>
void EdgeWriter<Memory>::with_memory(const WriteContext& context, Work work) {
    context.ask_again();
    reclaim(memory_, context, Line::kEnded, Sizes::kKept);
    const auto reclaim_all = [&] {
        for (const Line line : {Line::kReplaced, Line::kEnded}) {
            while (reclaim(memory_, context, line, 0)) {
            }
        }
    };
    try {
        return work();
    } catch (const CapacityExceeded&) {
        reclaim_all();
    }
    try {
        return work();
    } catch (const CapacityExceeded&) {
        context.give_up_snapshots();
        evict(context);
        reclaim_all();
    }
    work();
}

// -- behind all others --------------------------------------------------------------------------

template <class Memory>
void EdgeWriter<Memory>::append_behind(const WriteContext& context, const NewSample<Memory>& sample,
                                       const SampleAt& newest) {
    make_room(context, 1);
    note(context, sample, newest);
    const Seg tail = this->tail();
    write(context, tail, tail.end(), sample);
    this->word(kTail).store_release(SegmentWord::with_last(tail.word()));
    if ((tail.end() & 31) == 31)
        update_rate();
}

template <class Memory>
template <class Sample>
void EdgeWriter<Memory>::append_behind(const WriteContext& context, std::size_t count,
                                       Sample sample) {
    for (std::size_t done = 0; done < count;)
        done += fill_tail(context, count - done,
                          [&](std::size_t i) -> decltype(auto) { return sample(done + i); });
}

/// Appends as many samples as fit into one segment; returns their number.
template <class Memory>
template <class Sample>
std::size_t EdgeWriter<Memory>::fill_tail(const WriteContext& context, std::size_t count,
                                          Sample sample) {
    const Seg before = this->tail();
    // A small tail grows at once to the size that the coming samples need.
    const bool grows = SegmentWord::capacity(before.word()) < kFull;
    make_room(context, grows ? std::min<std::uint64_t>(count, kFull - before.end()) : 1);
    const Seg tail = this->tail();
    const std::uint64_t first = tail.end();
    const std::uint64_t capacity = SegmentWord::capacity(tail.word());
    count = std::min<std::size_t>(count, capacity - spare(capacity) - first);
    SampleAt newest = newest_sample();
    FrameId parent = kNoFrame;
    for (std::size_t i = 0; i < count; ++i) {
        const NewSample<Memory>& next = sample(i);
        // A sample with the same parent as the one before changes no other header word.
        if (next.parent != parent)
            note(context, next, newest);
        parent = next.parent;
        store_sample(memory_, tail, first + i, next, context.number());
        newest = {tail.slot(first + i), next.stamp};
    }
    if (tail.empty())
        tail.meta(kLeast).store_relaxed(context.number());
    this->word(kTail).store_release(SegmentWord::only(tail.word(), tail.begin(), first + count));
    if ((first & 31) + count >= 32)
        update_rate();
    return count;
}

template <class Memory>
void EdgeWriter<Memory>::update_rate() {
    const Seg tail = this->tail();
    const StampNs span = tail.stamp(tail.end() - 1) - tail.stamp(tail.begin());
    if (span > 0) {
        const auto steps = static_cast<double>(SegmentWord::count(tail.word()) - 1);
        this->word(kRate).store_relaxed(
            std::bit_cast<std::uint64_t>(steps / static_cast<double>(span)));
    }
}

template <class Memory>
bool EdgeWriter<Memory>::reserve(const WriteContext& context, std::uint64_t samples) {
    if (samples > kLargest / 2)
        return false;
    make_room(context, samples);
    return true;
}

/// An edge that has had late samples leaves some space in a segment when it is sealed.
template <class Memory>
std::uint64_t EdgeWriter<Memory>::spare(std::uint64_t capacity) const {
    return capacity == kFull && this->word(kLate).load_relaxed() != 0 ? kFull / 16 : 0;
}

/// Provides space in the tail. A full tail continues in a copy with space for as many samples as it
/// needs, but at least half its size. A large one is sealed and a new one begun.
template <class Memory>
void EdgeWriter<Memory>::make_room(const WriteContext& context, std::uint64_t samples) {
    const Seg full = tail();
    const bool any = SegmentWord::block(full.word()) != 0;
    const std::uint64_t capacity = any ? SegmentWord::capacity(full.word()) : 0;
    if (full.end() + samples + spare(capacity) <= capacity) [[likely]]
        return;
    with_memory(context, [&] {
        drop_superseded(context, full);
        evict(context);
        const std::uint64_t first = any ? first_needed(context, full) : 0;
        const std::uint64_t needed = any ? count_needed(context, full, first) : 0;
        const std::uint64_t wanted = std::bit_ceil(std::max(2 * needed, needed + samples));
        const std::uint64_t announced = std::max(kFull, std::bit_ceil(samples));
        if (wanted <= announced) {
            constexpr std::uint64_t kFirst = std::uint64_t{1} << Sizes::kFirstLog2;
            copy_tail(context, full, first,
                      std::max({wanted, std::min(capacity, kFull) / 2, kFirst}));
        } else {
            seal(context, announced);
        }
    });
}

template <class Memory>
void EdgeWriter<Memory>::copy_tail(const WriteContext& context, const Seg& full,
                                   std::uint64_t first, std::uint64_t capacity) {
    NewSegment<Memory> made(memory_, capacity);
    const std::uint64_t old = full.word();
    for (std::uint64_t i = first; i < full.end(); ++i) {
        if (is_needed(context, full, i))
            made.copy(full, i);
    }
    if (first != full.begin())
        forget(context, kForgotten);
    if (SegmentWord::count(made.word()) < full.end() - first)
        forget(context, kCorrected);
    this->word(kTail).store_release(made.word());
    made.use();
    hold_unshown(context, made.segment());
    retire_segment(memory_, context, Line::kReplaced, old);
    heal_parents();
}

/// Moves the tail into the directory; an empty one takes its place.
template <class Memory>
void EdgeWriter<Memory>::seal(const WriteContext& context, std::uint64_t next_capacity) {
    NewSegment<Memory> next(memory_, next_capacity);
    if (this->directory().block() == 0 || end() >= this->directory().capacity())
        copy_directory(context, end(), 0, 0, [](const Dir&, std::uint64_t) {});
    const Seg full = tail();
    auto& greatest = full.meta(kGreatest);
    greatest.store_relaxed(
        std::max<CommitNumber>(greatest.load_relaxed(), full.commit(full.end() - 1)));
    this->word(kReshaped).store_relaxed(context.number());
    const Dir directory = this->directory();
    const std::uint64_t k = end();
    directory.first_word(k).store_relaxed(as_word(full.stamp(full.begin())));
    directory.entry(k).store_release(full.word());
    directory.store_figures(k);
    directory.sum_up(k, k + 1);
    directory.word(kDirEnd).store_release(k + 1);
    this->word(kTail).store_release(next.word());
    next.use();
    hold_unshown(context, full);
    this->directory().update_rate();
}

// -- blocks that no state needs -----------------------------------------------------------------

/// From now on, states before the oldest readable one may miss samples.
template <class Memory>
void EdgeWriter<Memory>::forget(const WriteContext& context, HeaderWord what) {
    if (this->word(what).load_relaxed() < context.oldest_read())
        this->word(what).store_relaxed(context.oldest_read());
}

/// Below this stamp only a newest sample is retained. Static poses have no age.
template <class Memory>
StampNs EdgeWriter<Memory>::retained_from(const WriteContext& context, StampNs newest) {
    return newest >= 0 ? newest - context.history : std::numeric_limits<StampNs>::min() / 2;
}

/// Below this stamp nothing is retained in any readable state that shows this version.
template <class Memory>
StampNs EdgeWriter<Memory>::cutoff(const WriteContext& context) const {
    const CommitNumber state = std::max(context.oldest_read(), this->began());
    SampleAt newest = newest_sample();
    if (this->word(kChanged).load_relaxed() > state) {
        EdgeView<Memory> view;
        newest = view.open(memory_, header_, state, context.history, kAsItIs) ? view.newest()
                                                                              : SampleAt{};
    }
    return retained_from(context, newest.stamp);
}

/// Whether every readable state shows a later commit's sample of the same stamp instead.
template <class Memory>
bool EdgeWriter<Memory>::superseded(const WriteContext& context, const Seg& in,
                                    std::uint64_t index) const {
    return index + 1 < in.end() && in.stamp(index) == in.stamp(index + 1) &&
           in.commit(index + 1) <= context.oldest_read();
}
template <class Memory>
bool EdgeWriter<Memory>::is_needed(const WriteContext& context, const Seg& in,
                                   std::uint64_t index) const {
    return in.commit(index) != SlotWord::kNever && !superseded(context, in, index);
}

/// In a tail without segments before it: the first sample that some state still shows.
template <class Memory>
std::uint64_t EdgeWriter<Memory>::first_needed(const WriteContext& context, const Seg& full) const {
    // Computing what can be evicted costs more than this check.
    const bool any_old = !full.empty() && full.stamp(full.begin()) <
                                              retained_from(context, full.stamp(full.end() - 1));
    if (begin() != end() || !any_old)
        return full.begin();
    return full.upper_bound(cutoff(context) - 1);
}

template <class Memory>
std::uint64_t EdgeWriter<Memory>::count_needed(const WriteContext& context, const Seg& in,
                                               std::uint64_t first) const {
    std::uint64_t needed = 0;
    for (std::uint64_t i = first; i < in.end(); ++i)
        needed += is_needed(context, in, i) ? 1 : 0;
    return needed;
}

/// Evicts whole segments that no state retains.
template <class Memory>
void EdgeWriter<Memory>::evict(const WriteContext& context) {
    const Dir directory = this->directory();
    const StampNs newest = this->newest();
    StampNs limit = retained_from(context, newest);
    unsigned evicted = 0;
    for (std::uint64_t k = begin(); k < end() && evicted < kMostEvicted; ++k) {
        const Seg oldest = segment(directory.entry(k).load_relaxed());
        const auto is_needed = [&] {
            return !oldest.empty() && oldest.stamp(oldest.end() - 1) >= limit;
        };
        if (is_needed())
            break;
        // Asking the readers costs more than this check for old samples.
        if (evicted == 0) {
            const StampNs old = limit;
            limit = cutoff(context);
            if (limit < old)
                hold_before(context, old);
            if (is_needed())
                return;
        }
        ++evicted;
        forget(context, kForgotten);
        directory.word(kDirBegin).store_release(k + 1);
        retire_segment(memory_, context, Line::kReplaced, oldest.word());
    }
    if (evicted > 0) {
        this->directory().update_rate();
        heal_parents();
    }
}

template <class Memory>
void EdgeWriter<Memory>::evict_all(const WriteContext& context) {
    for (std::uint64_t left = end() - begin(); left > 0;) {
        evict(context);
        if (end() - begin() == left)
            return;
        left = end() - begin();
    }
}

/// Evicts segments just before the tail that no state shows: all their samples have the stamp with
/// which the tail begins. Only held states let so many accumulate.
template <class Memory>
void EdgeWriter<Memory>::drop_superseded(const WriteContext& context, const Seg& tail) {
    const auto is_superseded = [&](const Seg& in, const Seg& by) {
        return in.empty() || (in.stamp(in.begin()) == by.stamp(by.begin()) &&
                              by.commit(by.begin()) <= context.oldest_read());
    };
    const std::uint64_t last = end();
    std::uint64_t first = last;
    for (Seg by = tail; !by.empty() && first > begin() && last - first < kMostEvicted; --first) {
        const Seg in = segment(word_of(first - 1));
        if (!is_superseded(in, by))
            break;
        if (!in.empty())
            by = in;
    }
    if (first == last)
        return;
    std::array<std::uint64_t, kMostEvicted> dropped{};
    for (std::uint64_t k = first; k < last; ++k)
        dropped[k - first] = word_of(k);
    forget(context, kCorrected);
    this->word(kReshaped).store_relaxed(context.number());
    copy_directory(context, first, last - first, 0, [](const Dir&, std::uint64_t) {});
    for (std::uint64_t k = first; k < last; ++k)
        retire_segment(memory_, context, Line::kReplaced, dropped[k - first]);
    heal_parents();
}

/// Records the bytes of a segment that only held states show.
template <class Memory>
void EdgeWriter<Memory>::hold(const WriteContext& context, const Seg& in, std::uint64_t bytes) {
    auto& held = in.meta(kHeld);
    context.readers().held(bytes - held.load_relaxed());
    held.store_relaxed(bytes);
}
/// Records that only held states show the whole segment. False: that was already recorded.
template <class Memory>
bool EdgeWriter<Memory>::hold_all_of(const WriteContext& context, std::uint64_t word) {
    const std::size_t all = Seg::bytes(SegmentWord::capacity(word));
    if (segment(word).block() == 0 || segment(word).meta(kHeld).load_relaxed() == all)
        return false;
    hold(context, segment(word), all);
    return true;
}
/// Records the bytes of a newly filled segment that only held states show: samples older than the
/// history, and of equal stamps all but the last.
template <class Memory>
void EdgeWriter<Memory>::hold_unshown(const WriteContext& context, const Seg& in) {
    if (in.empty() || !context.is_held())
        return;
    const StampNs oldest = retained_from(context, this->newest());
    std::uint64_t unshown = 0;
    for (std::uint64_t i = in.begin(); i < in.end(); ++i) {
        const StampNs stamp = in.stamp(i);
        unshown += stamp < oldest || (i + 1 < in.end() && stamp == in.stamp(i + 1)) ? 1 : 0;
    }
    const std::uint64_t all = Seg::bytes(SegmentWord::capacity(in.word()));
    const std::uint64_t held = all * unshown / SegmentWord::count(in.word());
    hold(context, in, std::max(held, in.meta(kHeld).load_relaxed()));
}
/// Records this for the segments that end before a stamp, latest first: older ones were recorded
/// earlier.
template <class Memory>
void EdgeWriter<Memory>::hold_before(const WriteContext& context, StampNs stamp) {
    for (std::uint64_t k = segment_of(stamp); k > begin() && hold_all_of(context, word_of(k - 1));)
        --k;
}
template <class Memory>
void EdgeWriter<Memory>::hold_all(const WriteContext& context) {
    for (std::uint64_t k = begin(); k <= end(); ++k)
        hold_all_of(context, word_of(k));
}

/// Once all samples with another parent are evicted, all name one parent.
template <class Memory>
void EdgeWriter<Memory>::heal_parents() {
    if ((this->topology() & Topology::kMixedParents) == 0)
        return;
    const FrameId parent = Topology::parent(this->topology());
    const Seg tail = this->tail();
    bool one = true;
    if (begin() != end()) {
        const Seg first = segment(this->directory().entry(begin()).load_relaxed());
        one = !first.empty() &&
              first.stamp(first.begin()) >= as_stamp(this->word(kParentFrom).load_relaxed());
    } else {
        for (std::uint64_t i = tail.begin(); i < tail.end(); ++i)
            one = one && SlotWord::parent(tail.slot_word(i)) == parent;
    }
    if (one)
        this->word(kTopology).store_release(this->topology() & ~Topology::kMixedParents);
}

// -- among the others ---------------------------------------------------------------------------

/// Puts a segment with a new sample at `index` into the edge, in place of another segment.
template <class Memory>
void EdgeWriter<Memory>::store_word_of(std::uint64_t k, std::uint64_t word, std::uint64_t index) {
    if (k == end()) {
        this->word(kTail).store_release(word);
        return;
    }
    const Dir directory = this->directory();
    const Seg in = segment(word);
    // No search enters the first segment by its first stamp.
    if (k == begin())
        directory.first_word(k).store_relaxed(
            as_word(std::min(in.stamp(in.begin()), directory.first(k))));
    directory.replace(k, in, index);
}

/// Saves the count from before the commit for `trim`.
template <class Memory>
void EdgeWriter<Memory>::set_late(const WriteContext& context, std::uint64_t samples) {
    if (this->word(kLateSince).load_relaxed() != context.number()) {
        this->word(kLateBefore).store_relaxed(this->word(kLate).load_relaxed());
        this->word(kLateSince).store_release(context.number());
    }
    this->word(kLate).store_relaxed(samples);
}

/// The capacity of a segment among others. Each late sample copies its segment, so segments are
/// small until they are so many that the directory costs more.
template <class Memory>
std::uint64_t EdgeWriter<Memory>::most_amid() const {
    constexpr std::uint64_t kMany = std::uint64_t{1} << 13;
    return end() - begin() < kMany ? std::uint64_t{1} << Sizes::kSmallLog2 : kFull;
}

template <class Memory>
void EdgeWriter<Memory>::insert_late(const WriteContext& context, const NewSample<Memory>& sample,
                                     const SampleAt& newest) {
    const std::uint64_t segments = end() - begin();
    std::uint64_t k = segment_of(sample.stamp);
    Seg in = segment(word_of(k));
    std::uint64_t index = in.upper_bound(sample.stamp);
    const std::uint64_t capacity = SegmentWord::capacity(in.word());
    const std::uint64_t most = k == end() ? kFull : most_amid();
    const bool is_full = SegmentWord::count(in.word()) == capacity && capacity >= most;
    const bool is_first = index == in.begin() && k == begin();
    if (is_full && k == end() && !is_first) {
        seal(context, kFull);
        k = end() - 1;
    }
    if (is_full && !is_first && count_needed(context, in, in.begin()) == capacity)
        return insert_run(context, {&sample, 1}, newest);
    note(context, sample, newest);
    if (k != end())
        this->word(kReshaped).store_relaxed(context.number());
    if (index == in.end() && in.end() < capacity) {
        write(context, in, index, sample);
        in.meta(kGreatest).store_relaxed(context.number());
        store_word_of(k, SegmentWord::with_last(in.word()), index);
    } else if (index == in.begin() && index > 0) {
        write(context, in, index - 1, sample);
        in.meta(kGreatest).store_relaxed(context.number());
        store_word_of(k, SegmentWord::with_first(in.word()), index - 1);
    } else if (!is_full) {
        const bool grows = SegmentWord::count(in.word()) == capacity;
        insert_in_copy(context, k, index, grows ? 2 * capacity : capacity, sample);
    } else if (is_first) {
        push_front(context, sample);
    } else {
        insert_in_copy(context, k, index, capacity, sample);
    }
    set_late(context, this->word(kLate).load_relaxed() + 1);
    if (end() - begin() > segments)
        evict(context);
}

template <class Memory>
void EdgeWriter<Memory>::insert_in_copy(const WriteContext& context, std::uint64_t k,
                                        std::uint64_t index, std::uint64_t capacity,
                                        const NewSample<Memory>& sample) {
    const Seg old = segment(word_of(k));
    NewSegment<Memory> made(memory_, capacity);
    // A sample before all others may be followed by more: the segment leaves space for them.
    if (index == old.begin() && k == begin())
        made.start_at(capacity - SegmentWord::count(old.word()) - 1);
    for (std::uint64_t i = old.begin(); i <= old.end(); ++i) {
        if (i == index)
            made.put(sample, context.number());
        if (i < old.end() && is_needed(context, old, i))
            made.copy(old, i);
    }
    if (SegmentWord::count(made.word()) <= SegmentWord::count(old.word()))
        forget(context, kCorrected);
    store_word_of(k, made.word(), made.segment().begin() + (index - old.begin()));
    made.use();
    hold_unshown(context, made.segment());
    retire_segment(memory_, context, Line::kReplaced, old.word());
}

/// A new segment before all others, filled from its end.
template <class Memory>
void EdgeWriter<Memory>::push_front(const WriteContext& context, const NewSample<Memory>& sample) {
    NewSegment<Memory> made(memory_, kFull);
    made.start_at(kFull - 1);
    made.put(sample, context.number());
    const auto enter = [&](const Dir& into, std::uint64_t at) {
        into.first_word(at).store_relaxed(as_word(sample.stamp));
        into.entry(at).store_release(made.word());
    };
    this->word(kReshaped).store_relaxed(context.number());
    const std::uint64_t k = begin();
    // Readers may still access an evicted entry.
    if (this->directory().block() != 0 && k > 0 &&
        this->directory().word(kDirLowest).load_relaxed() == k) {
        enter(this->directory(), k - 1);
        this->directory().word(kDirLowest).store_relaxed(k - 1);
        this->directory().store_figures(k - 1);
        this->directory().sum_up(k - 1, end());
        this->directory().word(kDirBegin).store_release(k - 1);
    } else {
        copy_directory(context, k, 0, 1, enter);
    }
    made.use();
}

/// Inserts late samples that all precede the tail. Their segments and the directory are copied
/// once; samples that exceed a segment's capacity are split into several segments.
template <class Memory>
void EdgeWriter<Memory>::insert_run(const WriteContext& context,
                                    std::span<const NewSample<Memory>> run,
                                    const SampleAt& newest) {
    const Dir directory = this->directory();
    const auto place_of = [&](StampNs stamp) { return directory.find(begin(), end(), stamp); };
    const std::uint64_t first = place_of(run.front().stamp);
    const std::uint64_t last = place_of(run.back().stamp) + 1;
    const std::size_t late = run.size();
    std::vector<NewSegment<Memory>> made;
    std::vector<std::pair<StampNs, std::uint64_t>> entries;
    std::vector<std::uint64_t> replaced;
    for (std::uint64_t k = first; k < last; ++k) {
        const std::uint64_t old = word_of(k);
        std::size_t count = 0;
        while (count < run.size() && (k + 1 == last || run[count].stamp < directory.first(k + 1)))
            ++count;
        if (count == 0) {
            entries.emplace_back(directory.first(k), old);
            continue;
        }
        std::size_t next = made.size();
        merge(context, k, run.first(count), made);
        // A search for the segment's first sample must find the first piece.
        StampNs from = std::min(directory.first(k), run.front().stamp);
        for (; next < made.size(); ++next) {
            entries.emplace_back(from, made[next].word());
            if (next + 1 < made.size()) {
                const Seg following = made[next + 1].segment();
                from = following.stamp(following.begin());
            }
        }
        replaced.push_back(old);
        for (const auto& sample : run.first(count))
            note(context, sample, newest);
        run = run.subspan(count);
    }
    this->word(kReshaped).store_relaxed(context.number());
    copy_directory(context, first, last - first, entries.size(),
                   [&](const Dir& into, std::uint64_t at) {
                       for (const auto& [from, word] : entries) {
                           into.first_word(at).store_relaxed(as_word(from));
                           into.entry(at++).store_relaxed(word);
                       }
                   });
    for (auto& block : made) {
        block.use();
        hold_unshown(context, block.segment());
    }
    for (const std::uint64_t old : replaced)
        retire_segment(memory_, context, Line::kReplaced, old);
    set_late(context, this->word(kLate).load_relaxed() + late);
    evict(context);
}

/// Merges the retained samples of a segment with new samples, in as many segments as they fill.
template <class Memory>
void EdgeWriter<Memory>::merge(const WriteContext& context, std::uint64_t k,
                               std::span<const NewSample<Memory>> samples,
                               std::vector<NewSegment<Memory>>& made) {
    const Seg old = segment(word_of(k));
    const std::uint64_t needed = count_needed(context, old, old.begin());
    if (needed < SegmentWord::count(old.word()))
        forget(context, kCorrected);
    const std::uint64_t total = needed + samples.size();
    const std::uint64_t most = most_amid();
    const std::uint64_t pieces = (total + most - 1) / most;
    const std::uint64_t capacity = std::min(std::bit_ceil(total), most);
    std::uint64_t filled = 0;
    std::uint64_t begun = 0;
    const auto into = [&]() -> NewSegment<Memory>& {
        if (filled++ * pieces >= begun * total) {
            made.emplace_back(memory_, capacity);
            ++begun;
        }
        return made.back();
    };
    std::size_t next = 0;
    for (std::uint64_t i = old.begin(); i <= old.end(); ++i) {
        for (; next < samples.size() && (i == old.end() || samples[next].stamp < old.stamp(i));
             ++next)
            into().put(samples[next], context.number());
        if (i < old.end() && is_needed(context, old, i))
            into().copy(old, i);
    }
}

// -- the directory ------------------------------------------------------------------------------

/// Readers continue in the old directory, which leads to the same samples. `enter(directory, at)`
/// fills in the added entries, which replace `removed` ones from `at` on.
template <class Memory>
template <class Enter>
void EdgeWriter<Memory>::copy_directory(const WriteContext& context, std::uint64_t at,
                                        std::uint64_t removed, std::uint64_t added, Enter enter) {
    const Dir old = this->directory();
    const std::uint64_t last = end();
    const std::uint64_t first = std::min(begin(), last);
    const std::uint64_t entries = last - first + added - removed;
    const std::uint64_t room = entries / 4 + 1;
    const std::uint64_t front = added > removed && at == first ? room : 1;
    // Power-of-two sizes, so that freed blocks fit again.
    const std::uint64_t capacity = std::bit_ceil(front + entries + room);
    NewBlock<Memory> block(memory_, Dir::bytes(capacity));
    const Dir made(memory_, block.offset());
    std::uint64_t to = front;
    made.word(kDirCapacity).store_relaxed(capacity);
    const auto copy = [&](std::uint64_t from) { made.copy(to++, old, from); };
    for (std::uint64_t k = first; k < at; ++k)
        copy(k);
    enter(made, to);
    for (const std::uint64_t behind = to + added; to < behind; ++to)
        made.store_figures(to);
    for (std::uint64_t k = at + removed; k < last; ++k)
        copy(k);
    made.sum_up_all(front, to);
    made.word(kDirBegin).store_relaxed(front);
    made.word(kDirLowest).store_relaxed(front);
    made.word(kDirEnd).store_relaxed(to);
    made.word(kDirRate).store_relaxed(0);
    this->word(kDirectory).store_release(made.block());
    block.use();
    if (old.block() != 0)
        retire_directory(context, Line::kReplaced, old.block());
    this->directory().update_rate();
}

template <class Memory>
void EdgeWriter<Memory>::retire_directory(const WriteContext& context, Line line, Offset block) {
    const Dir list(memory_, block);
    retire(memory_, context, line, list.block(), Dir::bytes(list.capacity()));
}

// -- versions -----------------------------------------------------------------------------------

/// Sends older snapshots to the version that ends here before anything else changes.
template <class Memory>
void EdgeWriter<Memory>::clear(const WriteContext& context) {
    NewBlock<Memory> block(memory_, kVersionBytes);
    const auto keep = [&](VersionWord w, std::uint64_t value) {
        memory_.word(block.offset() + 8 * Offset{w}).store_relaxed(value);
    };
    const std::uint64_t older = this->word(kOlder).load_relaxed();
    const bool goes_on = (older & kTakenBack) != 0;
    const Offset before = version(older);
    keep(kOldTail, this->word(kTail).load_relaxed());
    keep(kOldDirectory, this->word(kDirectory).load_relaxed());
    keep(kOldTopology, this->topology());
    keep(kOldSince, this->began());
    keep(kOldOlder, goes_on ? memory_.word(before + 8 * Offset{kOldOlder}).load_relaxed() : before);
    keep(kOldEnd, end());
    // If an earlier clear was rolled back, a death before the next store leaves another one.
    if (goes_on)
        this->word(kSince).store_release(context.number());
    this->word(kOlder).store_release(block.offset());
    this->word(kSince).store_release(context.number());
    block.use();
    constexpr std::uint64_t kKept = Topology::kMortal | Topology::kParented;
    this->word(kChanged).store_relaxed(context.number());
    this->word(kTopology).store_release((this->topology() & kKept) | Topology::kRoot |
                                        Topology::kCleared);
    this->word(kDirectory).store_release(0);
    this->word(kTail).store_release(0);
    if (goes_on)
        retire(memory_, context, Line::kReplaced, before, kVersionBytes);
}

template <class Memory>
void EdgeWriter<Memory>::retire_older(const WriteContext& context) {
    const Offset block = version(this->word(kOlder).load_relaxed());
    retire_all(context, Line::kEnded, memory_.word(block + 8 * Offset{kOldTail}).load_relaxed(),
               memory_.word(block + 8 * Offset{kOldDirectory}).load_relaxed());
    retire(memory_, context, Line::kEnded, block, kVersionBytes);
}

template <class Memory>
void EdgeWriter<Memory>::retire_all(const WriteContext& context, Line line, std::uint64_t tail,
                                    Offset directory) {
    retire_segment(memory_, context, line, tail);
    if (directory == 0)
        return;
    const Dir list(memory_, directory);
    const std::uint64_t last = list.end();
    for (std::uint64_t k = list.begin(last); k < last; ++k)
        retire_segment(memory_, context, line, list.entry(k).load_relaxed());
    retire_directory(context, line, directory);
}

template <class Memory>
void EdgeWriter<Memory>::release(const WriteContext& context) {
    const std::uint64_t tail = this->word(kTail).load_relaxed();
    const Offset directory = this->word(kDirectory).load_relaxed();
    const std::uint64_t older = this->word(kOlder).load_relaxed();
    this->word(kOlder).store_release(0);
    this->word(kDirectory).store_release(0);
    this->word(kTail).store_release(0);
    retire_all(context, Line::kReplaced, tail, directory);
    if ((older & kTakenBack) != 0)
        retire(memory_, context, Line::kReplaced, version(older), kVersionBytes);
}

// -- taking back --------------------------------------------------------------------------------

template <class Memory>
void EdgeWriter<Memory>::trim(const WriteContext& context) {
    const std::uint64_t older = this->word(kOlder).load_relaxed();
    if (this->word(kSince).load_relaxed() > context.committed && (older & kTakenBack) == 0)
        trim_version(context);
    if (this->word(kReshaped).load_relaxed() > context.committed)
        trim_directory(context);
    if (const Seg tail = this->tail(); !tail.empty())
        this->word(kTail).store_release(trimmed(context, tail.word()));
    if (this->word(kLateSince).load_relaxed() > context.committed)
        this->word(kLate).store_relaxed(this->word(kLateBefore).load_relaxed());
    restore_topology();
}

/// The segment without newer samples at its ends; newer samples inside are marked.
template <class Memory>
std::uint64_t EdgeWriter<Memory>::trimmed(const WriteContext& context, std::uint64_t word) const {
    const Seg in = segment(word);
    std::uint64_t first = in.begin();
    std::uint64_t last = in.end();
    while (last > first && in.commit(last - 1) > context.committed)
        --last;
    while (first < last && in.commit(first) > context.committed)
        ++first;
    for (std::uint64_t i = first; i < last; ++i) {
        if (in.commit(i) > context.committed) {
            memory_.word(in.slot(i))
                .store_relaxed(SlotWord::pack(SlotWord::kNever, SlotWord::parent(in.slot_word(i))));
        }
    }
    return SegmentWord::only(word, first, last);
}

template <class Memory>
void EdgeWriter<Memory>::trim_directory(const WriteContext& context) {
    if (begin() == end())
        return;
    const Dir directory = this->directory();
    const std::uint64_t tail = SegmentWord::block(this->word(kTail).load_relaxed());
    // Sealed, but not yet followed by a new tail.
    if (tail != 0 && SegmentWord::block(directory.entry(end() - 1).load_relaxed()) == tail)
        directory.word(kDirEnd).store_release(end() - 1);
    for (std::uint64_t k = begin(); k < end(); ++k) {
        const std::uint64_t found = directory.entry(k).load_relaxed();
        if (segment(found).meta(kGreatest).load_relaxed() > context.committed) {
            directory.entry(k).store_release(trimmed(context, found));
            directory.store_figures(k);
            directory.sum_up(k, end());
        }
    }
    const auto is_empty = [&](std::uint64_t k) {
        return segment(directory.entry(k).load_relaxed()).empty();
    };
    while (begin() < end() && is_empty(end() - 1)) {
        const std::uint64_t empty = directory.entry(end() - 1).load_relaxed();
        directory.word(kDirEnd).store_release(end() - 1);
        retire_segment(memory_, context, Line::kReplaced, empty);
    }
    while (begin() < end() && is_empty(begin())) {
        const std::uint64_t empty = directory.entry(begin()).load_relaxed();
        directory.word(kDirBegin).store_release(begin() + 1);
        retire_segment(memory_, context, Line::kReplaced, empty);
    }
    this->directory().update_rate();
}

/// Continues the version that the clear was to end.
template <class Memory>
void EdgeWriter<Memory>::trim_version(const WriteContext& context) {
    const Offset block = version(this->word(kOlder).load_relaxed());
    const auto old = [&](VersionWord w) {
        return memory_.word(block + 8 * Offset{w}).load_relaxed();
    };
    const std::uint64_t tail = this->word(kTail).load_relaxed();
    const Offset directory = this->word(kDirectory).load_relaxed();
    const std::uint64_t kept = this->topology() & (Topology::kMortal | Topology::kParented);
    this->word(kTopology).store_release(old(kOldTopology) | kept);
    this->word(kDirectory).store_release(old(kOldDirectory));
    this->word(kTail).store_release(old(kOldTail));
    this->word(kOlder).store_release(block | kTakenBack);
    // After a death during the clear, or during this, they may already be the old version's.
    retire_all(context, Line::kReplaced, tail == old(kOldTail) ? 0 : tail,
               directory == old(kOldDirectory) ? 0 : directory);
}

/// Sets parent and kind to those of the newest sample.
template <class Memory>
void EdgeWriter<Memory>::restore_topology() {
    const SampleAt newest = newest_sample();
    const std::uint64_t topology = this->topology();
    constexpr std::uint64_t kKept = Topology::kMortal | Topology::kCleared | Topology::kParented;
    std::uint64_t restored = (topology & kKept) | Topology::kRoot;
    if (newest) {
        const std::uint64_t slot = memory_.word(newest.slot).load_relaxed();
        restored = Topology::with_parent(topology & (kKept | Topology::kMixedParents),
                                         SlotWord::parent(slot), Topology::depth(topology));
    }
    if (restored != topology)
        this->word(kTopology).store_release(restored);
}

template <class Memory>
void EdgeWriter<Memory>::set_depth_hint(std::uint32_t depth) {
    // A reader of this word must see all that its flags describe, as with every other store to it.
    this->word(kTopology).store_release(
        Topology::with_parent(this->topology(), Topology::parent(this->topology()), depth));
}

}  // namespace tfdb::history
