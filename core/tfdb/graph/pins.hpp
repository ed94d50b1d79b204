// Reader pins: the oldest commit that a reader may still need.
#pragma once

#include <algorithm>

#include "tfdb/base/types.hpp"
#include "tfdb/graph/frames.hpp"

namespace tfdb::graph {

/// A few counts of pinned states. Each count has a floor: its states are of that commit or newer.
/// An empty count takes the newest commit as its floor and receives the next pins, while the other
/// counts drain. So the oldest floor follows the oldest state, however many states overlap.
/// Threads: `take`, `join` and `drop` any; `oldest` only a writer: the holder of the commit lock,
/// if others may take pins meanwhile. Guarantee: wait-free. A commit that is loaded after `take` is
/// not older than what `oldest` returns from then on.
template <class Memory>
class Pins {
public:
    static constexpr unsigned kCounts = 3;

    /// `first`: kHeldPins or kReadPins, the first of the words in use.
    Pins(const Frames<Memory>& frames, StoreWord first) : frames_(&frames), first_(first) {}

    /// Adds a pin and returns its count. The full fence pairs with the one in `oldest`: either
    /// `oldest` sees the pin, or the commit that the reader loads next is at or above its floor.
    [[nodiscard]] unsigned take() const {
        // Any count would do: an outdated hint only costs time.
        const unsigned chosen = in_range(word(kHint).load_relaxed());
        count(chosen).fetch_add(1);
        Memory::fence_full();
        return chosen;
    }
    /// The same for a pin that may be held for long. It takes an empty count, if one is left, with
    /// `committed`, the newest commit just before, as its floor. Pins that join the count later
    /// load no older commit. So while counts suffice, no held state is treated as older than it is.
    [[nodiscard]] unsigned take(CommitNumber committed) const {
        const unsigned chosen = choose();
        if (count(chosen).fetch_add(1) == 0)
            word(kCounts + chosen).store_relaxed(committed);
        Memory::fence_full();
        return chosen;
    }
    /// Adds a pin to the count of the caller's own pin. The floor stays, so the new pin keeps that
    /// state and all later ones.
    void join(unsigned taken) const { count(taken).fetch_add(1); }
    void drop(unsigned taken) const { count(taken).fetch_add(~std::uint64_t{0}); }

    /// No pinned state, now or later, is older. `committed` must be published before.
    [[nodiscard]] CommitNumber oldest(CommitNumber committed) const {
        Memory::fence_full();
        return oldest_of(
            [this](unsigned w) -> auto& { return word(w); }, committed);
    }
    /// The same for pins anywhere, after a full fence: `word(w)` returns their words.
    template <class WordAt>
    [[nodiscard]] static CommitNumber oldest_of(WordAt word, CommitNumber committed) {
        CommitNumber oldest = committed;
        unsigned empty = kCounts;
        for (unsigned i = 0; i < kCounts; ++i) {
            if (word(i).load_relaxed() != 0) {
                oldest = std::min<CommitNumber>(oldest, word(kCounts + i).load_relaxed());
                continue;
            }
            word(kCounts + i).store_relaxed(committed);
            empty = i;
        }
        if (empty != kCounts && word(in_range(word(kHint).load_relaxed())).load_relaxed() != 0)
            word(kHint).store_relaxed(empty);
        return oldest;
    }
    /// Sets the floor for the first pins; no pin may exist yet.
    template <class WordAt>
    static void begin(WordAt word, CommitNumber committed) {
        for (unsigned i = 0; i < kCounts; ++i)
            word(kCounts + i).store_relaxed(committed);
    }

private:
    static constexpr unsigned kHint = 2 * kCounts;  // the count that the next pin takes
    static_assert(kHint < kPinWords - 1, "they fit where they are kept, and leave the last word");

    /// An empty count, if one is left.
    [[nodiscard]] unsigned choose() const {
        const unsigned hint = in_range(word(kHint).load_relaxed());
        if (count(hint).load_relaxed() == 0)
            return hint;
        for (unsigned i = 0; i < kCounts; ++i) {
            if (count(i).load_relaxed() == 0) {
                word(kHint).store_relaxed(i);
                return i;
            }
        }
        return hint;
    }

    [[nodiscard]] typename Memory::Word& word(unsigned w) const {
        return frames_->pin_word(first_, w);
    }
    [[nodiscard]] typename Memory::Word& count(unsigned i) const { return word(i); }
    /// The word may be damaged: other programs can write it.
    [[nodiscard]] static constexpr unsigned in_range(std::uint64_t chosen) {
        return chosen < kCounts ? static_cast<unsigned>(chosen) : 0;
    }

    const Frames<Memory>* frames_;
    StoreWord first_;
};

/// Holds a pin for its lifetime. Threads: one. Guarantee: wait-free.
template <class Memory>
class Pin {
public:
    explicit Pin(const Pins<Memory>& pins) : pins_(pins), taken_(pins_.take()) {}
    ~Pin() { pins_.drop(taken_); }
    Pin(const Pin&) = delete;
    Pin& operator=(const Pin&) = delete;

private:
    Pins<Memory> pins_;
    unsigned taken_;
};

}  // namespace tfdb::graph
