// Which states are held: so that writers know what nobody can ask for any more.
#pragma once

#include <algorithm>

#include "tfdb/base/types.hpp"
#include "tfdb/graph/frames.hpp"

namespace tfdb::graph {

/// A few counts of held snapshots, each with a floor: the snapshots that it counts are of that
/// commit or newer. A count that is found empty gets the newest commit as its floor, and the next
/// snapshots; the others meanwhile drain. So the oldest floor follows the oldest snapshot however
/// many overlap.
/// Threads: `take` and `drop` any; `oldest` only who writes, where others may take pins meanwhile
/// only the holder of the commit lock.
/// Guarantee: wait-free. Whoever loads the commit after `take` holds a state that is not older than
/// what `oldest` says from then on.
template <class Memory>
class Pins {
public:
    static constexpr unsigned kCounts = 3;

    explicit Pins(const Frames<Memory>& frames) : frames_(&frames) {}

    /// Counts one in, in the count that it returns. The full fence pairs with the one in `oldest`:
    /// either that sees the pin, or the commit that is loaded next is no older than its floor.
    [[nodiscard]] unsigned take() const {
        // Any count would do: an old hint costs nothing but time.
        const auto chosen = static_cast<unsigned>(word(kPinHint).load_relaxed());
        count(chosen).fetch_add(1);
        Memory::fence_full();
        return chosen;
    }
    void drop(unsigned taken) const { count(taken).fetch_add(~std::uint64_t{0}); }

    /// True if a snapshot was held just now.
    [[nodiscard]] bool any() const {
        bool held = false;
        for (unsigned i = 0; i < kCounts; ++i)
            held |= count(i).load_relaxed() != 0;
        return held;
    }

    /// No snapshot that is held, or will be taken, is older. `committed` was published before.
    [[nodiscard]] CommitNumber oldest(CommitNumber committed) const {
        Memory::fence_full();
        CommitNumber oldest = committed;
        unsigned empty = kCounts;
        for (unsigned i = 0; i < kCounts; ++i) {
            if (count(i).load_relaxed() != 0) {
                oldest = std::min<CommitNumber>(oldest, floor(i).load_relaxed());
                continue;
            }
            floor(i).store_relaxed(committed);
            empty = i;
        }
        const auto hint = static_cast<unsigned>(word(kPinHint).load_relaxed());
        if (empty != kCounts && count(hint).load_relaxed() != 0)
            word(kPinHint).store_relaxed(empty);
        return oldest;
    }

private:
    [[nodiscard]] typename Memory::Word& word(unsigned w) const {
        return frames_->store_word(static_cast<StoreWord>(w));
    }
    [[nodiscard]] typename Memory::Word& count(unsigned i) const { return word(kPins + i); }
    [[nodiscard]] typename Memory::Word& floor(unsigned i) const { return word(kPinFloors + i); }

    const Frames<Memory>* frames_;
};

}  // namespace tfdb::graph
