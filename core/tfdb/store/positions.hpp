// How far the commits of other stores have been applied here.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "tfdb/memory/region.hpp"
#include "tfdb/store/buffer.hpp"

namespace tfdb::store {

/// Positions of sources, in the region, as a list that only grows. Each has two slots. A slot
/// counts from the commit of this store that it names: so it becomes valid with that commit, and
/// of two valid ones the later counts. What a dead writer wrote names a commit that is not there;
/// `repair` takes it away before another commit has that number.
/// Threads: `position` and `all` any; the others only the holder of the commit lock.
/// Guarantee: these two are lock-free.
class Positions {
public:
    static constexpr std::uint64_t kMost = 1 << 16;
    /// The choice of a position where this store became the source's home: local writers may write.
    static constexpr std::uint64_t kReleased = ~std::uint64_t{0};

    /// `first`: the word of the region that leads to the list; `commit`: the newest commit.
    Positions(memory::Region& region, sync::Word& first, const sync::Word& commit)
        : region_(region), first_(first), commit_(commit) {}

    /// One source's record: its block in the region. 0: none.
    using Record = Offset;
    [[nodiscard]] Record find(std::string_view source);
    /// Throws CapacityExceeded, and InvalidArgument where names by this prefix and those of another
    /// source could be the same.
    [[nodiscard]] Record make(std::string_view source, std::string_view prefix);
    /// The source's number, from 1 on, by which frames name it.
    [[nodiscard]] std::uint64_t number(Record record) const;
    [[nodiscard]] std::string prefix(Record record) const;
    /// Whether nothing was ever applied.
    [[nodiscard]] bool empty() const { return first_.load_relaxed() == 0; }
    /// The source of that number, if only its commits may change what it wrote: it has a position,
    /// and this store is not its home.
    [[nodiscard]] std::optional<std::string> owner(std::uint64_t number) const;
    /// None: nothing of the source was applied. Its epoch is 0: the source was forgotten.
    [[nodiscard]] std::optional<Position> position(Record record) const;
    [[nodiscard]] std::vector<Position> all() const;

    /// Sets the position from the next commit of this store on, which is published just after the
    /// call.
    void set(Record record, const Epoch& epoch, CommitNumber commit, std::uint64_t choice);
    /// The same: none, from the next commit on. The record stays, with the source's number, which
    /// its frames name.
    void forget(Record record) { set(record, Epoch{}, 0, 0); }
    /// After the death of a writer.
    void repair();
    /// The number of the source that a commit of this store came from, the newest or the one before
    /// it; 0: a writer of this store.
    [[nodiscard]] std::uint64_t source_of(CommitNumber commit) const;

    /// Every block of the region that they lie in: visit(offset, bytes).
    template <class Visit>
    void visit_blocks(Visit visit) const {
        for_each([&](Record record) {
            visit(record, bytes(size_of(record, kSourceSize), size_of(record, kPrefixSize)));
            return true;
        });
    }

private:
    // Words of a record.
    static constexpr unsigned kNext = 0;
    static constexpr unsigned kNumber = 1;
    static constexpr unsigned kSourceSize = 2;
    static constexpr unsigned kPrefixSize = 3;
    static constexpr unsigned kFirstSlot = 4;
    // Words of a slot.
    static constexpr unsigned kValidFrom = 0;  // 0: it is empty
    static constexpr unsigned kEpochNumber = 1;
    static constexpr unsigned kEpochHigh = 2;
    static constexpr unsigned kEpochLow = 3;
    static constexpr unsigned kCommit = 4;
    static constexpr unsigned kChoice = 5;
    static constexpr unsigned kSlotWords = 6;
    static constexpr unsigned kSecondSlot = kFirstSlot + kSlotWords;
    static constexpr unsigned kTexts = kSecondSlot + kSlotWords;

    static std::size_t bytes(std::size_t source, std::size_t prefix) {
        return 8 * (kTexts + (source + 7) / 8 + (prefix + 7) / 8);
    }
    [[nodiscard]] sync::Word& word(Record record, unsigned w) const {
        return region_.word(record + 8 * Offset{w});
    }
    [[nodiscard]] std::uint64_t load(Record record, unsigned w) const {
        return word(record, w).load_relaxed();
    }
    /// Of a text; only a damaged record gives more than the region has.
    [[nodiscard]] std::size_t size_of(Record record, unsigned w) const;
    [[nodiscard]] std::string source(Record record) const;
    /// Until `visit(record)` returns false.
    template <class Visit>
    void for_each(Visit visit) const {
        Record record = region_.inside(first_.load_acquire());
        for (std::uint64_t left = kMost; record != 0 && left > 0 && visit(record); --left)
            record = region_.inside(load(record, kNext));
    }
    /// The first word of the slot that counts in a commit; kNone if none does.
    [[nodiscard]] unsigned valid_slot(Record record, CommitNumber committed) const;
    static constexpr unsigned kNone = 0;

    memory::Region& region_;
    sync::Word& first_;
    const sync::Word& commit_;
    std::unordered_map<std::string, Record> known_;  // only the holder of the commit lock asks
};

}  // namespace tfdb::store
