// The positions up to which other stores' commits have been applied here.
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

/// Positions of sources, in the region, as a list that only grows. Each has two slots. A slot is
/// valid from the commit of this store that it names, and of two valid slots the later one counts.
/// A slot of a dead writer names a commit that does not exist; `repair` clears it before another
/// commit gets that number.
/// Threads: `search`, `position` and `all` any; the others only the holder of the commit lock.
/// Guarantee: those three are lock-free.
class Positions {
public:
    static constexpr std::uint64_t kMost = 1 << 16;
    /// The choice of a position after this store became the source's home: local writers may write.
    static constexpr std::uint64_t kReleased = ~std::uint64_t{0};

    /// `first`: the region's word with the list's first record; `commit`: the newest commit.
    Positions(memory::Region& region, sync::Word& first, const sync::Word& commit)
        : region_(region), first_(first), commit_(commit) {}

    /// One source's record: its block in the region; 0: none.
    using Record = Offset;
    [[nodiscard]] Record find(std::string_view source);
    /// The same, for any thread: it visits all records.
    [[nodiscard]] Record search(std::string_view source) const;
    /// Creates a record. Throws CapacityExceeded, and InvalidArgument if names with this prefix
    /// could equal names of another source.
    [[nodiscard]] Record make(std::string_view source, std::string_view prefix);
    /// The source's number, starting at 1, which frames store.
    [[nodiscard]] std::uint64_t number(Record record) const;
    [[nodiscard]] std::string prefix(Record record) const;
    /// Whether no commit was ever applied.
    [[nodiscard]] bool empty() const { return first_.load_relaxed() == 0; }
    /// The source of that number, if only its commits may change its data: it has a position, and
    /// this store is not its home.
    [[nodiscard]] std::optional<std::string> owner(std::uint64_t number) const;
    /// Empty if no commit of the source was applied. An epoch of 0: the source was forgotten.
    [[nodiscard]] std::optional<Position> position(Record record) const;
    [[nodiscard]] std::vector<Position> all() const;

    /// Sets the position from the next commit of this store on. The caller publishes that commit
    /// right after the call.
    void set(Record record, const Epoch& epoch, CommitNumber commit, std::uint64_t choice);
    /// Clears the position from the next commit on. The record and the source's number stay,
    /// because frames store the number.
    void forget(Record record) { set(record, Epoch{}, 0, 0); }
    /// Call after the death of a writer.
    void repair();
    /// The number of the source of a commit of this store, which must be the newest or the one
    /// before it; 0: a writer of this store.
    [[nodiscard]] std::uint64_t source_of(CommitNumber commit) const;

    /// Visits every block of the region that holds them: visit(offset, bytes).
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
    static constexpr unsigned kValidFrom = 0;  // 0: empty
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
    /// Size of a text, limited to the region's size: a damaged record may claim more.
    [[nodiscard]] std::size_t size_of(Record record, unsigned w) const;
    [[nodiscard]] std::string source(Record record) const;
    /// Visits the records until `visit(record)` returns false.
    template <class Visit>
    void for_each(Visit visit) const {
        Record record = region_.inside(first_.load_acquire());
        for (std::uint64_t left = kMost; record != 0 && left > 0 && visit(record); --left)
            record = region_.inside(load(record, kNext));
    }
    /// The first word of the slot that is valid in a commit; kNone if none is.
    [[nodiscard]] unsigned valid_slot(Record record, CommitNumber committed) const;
    static constexpr unsigned kNone = 0;

    memory::Region& region_;
    sync::Word& first_;
    const sync::Word& commit_;
    std::unordered_map<std::string, Record> known_;  // used only by the holder of the commit lock
};

}  // namespace tfdb::store
