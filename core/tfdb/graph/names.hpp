// Frame names to ids: a hash table in the region that readers search without a lock.
#pragma once

#include <bit>
#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>

#include "tfdb/base/types.hpp"
#include "tfdb/graph/frames.hpp"
#include "tfdb/history/layout.hpp"

namespace tfdb::graph {

static_assert(std::endian::native == std::endian::little, "names are compared as words");

/// The (up to eight) bytes at `at`, the first one lowest, zeros behind the end. It avoids a memcpy
/// of a length unknown to the compiler: that would cost more than everything else.
inline std::uint64_t name_word(std::string_view name, std::size_t at) {
    const char* bytes = name.data() + at;
    const std::size_t left = name.size() - at;
    std::uint64_t word = 0;
    if (left >= 8) {
        std::memcpy(&word, bytes, 8);
    } else if (left >= 4) {
        std::uint32_t low = 0;
        std::uint32_t high = 0;  // overlaps `low` if fewer than eight bytes are left
        std::memcpy(&low, bytes, 4);
        std::memcpy(&high, bytes + left - 4, 4);
        word = low | std::uint64_t{high} << 8 * (left - 4);
    } else {
        for (std::size_t i = 0; i < left; ++i) {
            word |= std::uint64_t{static_cast<unsigned char>(bytes[i])} << 8 * i;
        }
    }
    return word;
}

/// Stores a text in the region: whole words, padded with zeros.
template <class Memory>
void store_text(Memory& memory, Offset to, std::string_view text) {
    for (std::size_t at = 0; at < text.size(); at += 8)
        memory.word(to + at).store_relaxed(name_word(text, at));
}
template <class Memory>
[[nodiscard]] std::string load_text(Memory& memory, Offset from, std::size_t size) {
    std::string text((size + 7) / 8 * 8, '\0');
    for (std::size_t at = 0; at < size; at += 8) {
        const std::uint64_t word = memory.word(from + at).load_relaxed();
        std::memcpy(text.data() + at, &word, 8);
    }
    text.resize(size);
    return text;
}

/// Multiply and fold, one word at a time; the constant is the golden ratio's. The low bits of a
/// product do not depend on the factor's high bits, and table lookups use the low bits, so the
/// folds mix them. `word_at(i)`: the bytes from the i-th on, as `name_word` returns them.
template <class WordAt>
std::uint64_t hash_words(std::size_t size, WordAt word_at) {
    constexpr std::uint64_t kGolden = 0x9E3779B97F4A7C15ULL;
    std::uint64_t hash = size;
    for (std::size_t at = 0; at < size; at += 8) {
        hash = (hash ^ word_at(at)) * kGolden;
        hash ^= hash >> 32;
    }
    hash *= kGolden;
    return hash ^ hash >> 29;
}

inline std::uint64_t hash_name(std::string_view name) {
    return hash_words(name.size(), [&](std::size_t at) { return name_word(name, at); });
}

/// An open-addressed table of (hash, id). A name that was removed and created again has two entries
/// until the old slot is reused; the snapshot selects one of them.
/// Threads: find any; insert and erase only the holder of the commit lock.
/// Guarantee: `find` never waits; it repeats only if the table grew meanwhile.
template <class Memory>
class Names {
public:
    explicit Names(Frames<Memory> frames) : frames_(frames), memory_(&frames.memory()) {}

    /// The frame of that name that exists in `snapshot`, or kNoFrame.
    [[nodiscard]] FrameId find(std::string_view name, CommitNumber snapshot) const {
        const std::uint64_t hash = hash_name(name);
        for (;;) {
            const std::uint64_t table = frames_.store_word(kNames).load_acquire();
            if (TableWord::empty(table))
                return kNoFrame;
            const FrameId id = find_in(table, hash, name, snapshot);
            if (id != kNoFrame)
                return id;
            Memory::fence_acquire();
            if (frames_.store_word(kNames).load_relaxed() == table)
                return kNoFrame;
        }
    }

    /// Copies a name into its own block. Throws CapacityExceeded.
    [[nodiscard]] Offset store_name(std::string_view name) const {
        const Offset block = memory_->allocate(name_bytes(name.size()));
        memory_->word(block).store_relaxed(name.size());
        store_text(*memory_, block + 8, name);
        return block;
    }
    void free_name(Offset offset) const {
        const Offset block = memory::inside(*memory_, offset);
        memory_->release(block, name_bytes(stored_size(block)));
    }

    /// Ensures space for one more entry. Throws CapacityExceeded and then changes nothing.
    void reserve() const {
        const std::uint64_t table = frames_.store_word(kNames).load_relaxed();
        const std::uint64_t filled = frames_.store_word(kNamesFilled).load_relaxed();
        if (!TableWord::empty(table) && 2 * (filled + 1) <= TableWord::capacity(table))
            return;
        rehash();
    }

    /// Inserts a frame; requires `reserve` before.
    void insert(std::string_view name, FrameId id) const {
        const std::uint64_t table = frames_.store_word(kNames).load_relaxed();
        put(table, hash_name(name), id);
        store_filled(1 + frames_.store_word(kNamesFilled).load_relaxed());
    }

    /// Allocates nothing: the rollback of a commit calls it.
    void erase(FrameId id) const {
        const std::uint64_t table = frames_.store_word(kNames).load_relaxed();
        const std::uint64_t mask = TableWord::capacity(table) - 1;
        std::uint64_t at = stored_hash(id) & mask;
        for (std::uint64_t probes = 0; probes <= mask; ++probes, at = (at + 1) & mask) {
            const std::uint64_t found = entry(table, at).load_relaxed();
            if (found == 0)
                return;
            if (static_cast<std::uint32_t>(found) == id + 1) {
                entry(table, at).store_release(kDead);
                return;
            }
        }
    }

    /// Recounts the entries: a process may have died between an entry and its count.
    void recount() const {
        const std::uint64_t table = frames_.store_word(kNames).load_relaxed();
        std::uint64_t filled = 0;
        for (std::uint64_t i = 0; !TableWord::empty(table) && i < TableWord::capacity(table); ++i)
            filled += entry(table, i).load_relaxed() != 0 ? 1 : 0;
        store_filled(filled);
    }
    /// Visits every block of the names and of their table: visit(offset, bytes).
    template <class Visit>
    void visit_blocks(Visit visit) const {
        const std::uint64_t table = frames_.store_word(kNames).load_relaxed();
        if (!TableWord::empty(table))
            visit(TableWord::block(table), 8 * TableWord::capacity(table));
        for (FrameId id = 0; id < frames_.count(); ++id) {
            if (const Offset block = name_block(id); block != 0)
                visit(block, name_bytes(stored_size(block)));
        }
    }

    /// The block of a frame's name: its length, then its bytes. 0: the frame has no name.
    [[nodiscard]] Offset name_block(FrameId id) const {
        return memory::inside(*memory_, frames_.word(id, history::kName).load_acquire());
    }
    /// The length in bytes; 0 for an invalid name.
    [[nodiscard]] std::uint64_t stored_size(Offset block) const {
        const std::uint64_t size = memory_->word(block).load_relaxed();
        return size <= kMaxNameBytes ? size : 0;
    }
    /// The frame's current name.
    [[nodiscard]] std::string name(FrameId id) const {
        const Offset block = name_block(id);
        if (block == 0)
            return {};
        return load_text(*memory_, block + 8, stored_size(block));
    }

private:
    static constexpr std::uint64_t kDead = 0xFFFFFFFFULL;
    static constexpr std::uint64_t kTooLarge = 16;  // times the needed size: the table shrinks

    [[nodiscard]] static std::size_t name_bytes(std::size_t length) {
        return 8 + (length + 7) / 8 * 8;
    }
    [[nodiscard]] typename Memory::Word& entry(std::uint64_t table, std::uint64_t i) const {
        return memory_->word(memory::inside(*memory_, TableWord::block(table)) + 8 * i);
    }
    /// Hash of the frame's name, which does not change meanwhile.
    [[nodiscard]] std::uint64_t stored_hash(FrameId id) const {
        const Offset block = name_block(id);
        return hash_words(stored_size(block), [&](std::size_t at) {
            return memory_->word(block + 8 + at).load_relaxed();
        });
    }
    void store_filled(std::uint64_t filled) const {
        frames_.store_word(kNamesFilled).store_relaxed(filled);
    }

    [[nodiscard]] FrameId find_in(std::uint64_t table, std::uint64_t hash, std::string_view name,
                                  CommitNumber snapshot) const {
        const std::uint64_t mask = TableWord::capacity(table) - 1;
        std::uint64_t at = hash & mask;
        for (std::uint64_t probes = 0; probes <= mask; ++probes, at = (at + 1) & mask) {
            const std::uint64_t found = entry(table, at).load_acquire();
            if (found == 0)
                return kNoFrame;
            if (found == kDead || found >> 32 != hash >> 32)
                continue;
            const FrameId id = static_cast<std::uint32_t>(found) - 1;
            if (id >= frames_.max_frames())
                continue;
            const std::uint64_t born = frames_.word(id, history::kBorn).load_acquire();
            if (!frames_.alive(id, snapshot) || !equals(id, name))
                continue;
            Memory::fence_acquire();
            // If the slot was reused meanwhile, its frame was born after this snapshot.
            if (frames_.word(id, history::kBorn).load_relaxed() == born)
                return id;
        }
        return kNoFrame;
    }

    [[nodiscard]] bool equals(FrameId id, std::string_view name) const {
        const Offset block = name_block(id);
        if (block == 0 || memory_->word(block).load_relaxed() != name.size())
            return false;
        for (std::size_t at = 0; at < name.size(); at += 8) {
            if (memory_->word(block + 8 + at).load_relaxed() != name_word(name, at))
                return false;
        }
        return true;
    }

    void put(std::uint64_t table, std::uint64_t hash, FrameId id) const {
        const std::uint64_t mask = TableWord::capacity(table) - 1;
        std::uint64_t i = hash & mask;
        // The table has space unless its count was damaged.
        for (std::uint64_t probes = 0; probes < mask && entry(table, i).load_relaxed() != 0;
             ++probes)
            i = (i + 1) & mask;
        entry(table, i).store_release((hash >> 32) << 32 | (id + 1));
    }

    /// A table with space, without the dead entries; readers of the old one search again.
    void rehash() const {
        const std::uint64_t old = frames_.store_word(kNames).load_relaxed();
        std::uint64_t live = 0;
        const std::uint64_t old_capacity = TableWord::empty(old) ? 0 : TableWord::capacity(old);
        for (std::uint64_t i = 0; i < old_capacity; ++i) {
            const std::uint64_t found = entry(old, i).load_relaxed();
            if (found != 0 && found != kDead)
                ++live;
        }
        unsigned log2 = history::Tuning<Memory>::kFirstNamesLog2;
        while ((std::uint64_t{1} << log2) < 4 * (live + 1))
            ++log2;
        // Creating and removing frames must not make the table's size oscillate.
        if (old_capacity >> log2 > 1 && old_capacity >> log2 < kTooLarge)
            log2 = TableWord::log2_capacity(old);
        const std::uint64_t capacity = std::uint64_t{1} << log2;
        const Offset block = memory_->allocate(8 * capacity);
        const std::uint64_t table = TableWord::pack(block, log2, TableWord::version(old) + 1);
        for (std::uint64_t i = 0; i < capacity; ++i)
            entry(table, i).store_relaxed(0);
        for (std::uint64_t i = 0; i < old_capacity; ++i) {
            const std::uint64_t found = entry(old, i).load_relaxed();
            const FrameId id = static_cast<std::uint32_t>(found) - 1;
            if (id < frames_.max_frames())  // no frame, or a dead one
                put(table, stored_hash(id), id);
        }
        frames_.store_word(kNames).store_release(table);
        store_filled(live);
        if (old_capacity != 0) {
            Memory::fence_release();
            memory_->release(TableWord::block(old), 8 * old_capacity);
        }
    }

    Frames<Memory> frames_;
    Memory* memory_;
};

}  // namespace tfdb::graph
