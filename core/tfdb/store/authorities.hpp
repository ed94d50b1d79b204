// Names of authorities (writers), and their numbers, which frame headers store.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "tfdb/memory/region.hpp"
#include "tfdb/sync/commit_lock.hpp"

namespace tfdb::store {

/// Numbers the names of authorities; the empty name is number 0. The names lie in the region, as a
/// list that only grows; each process reads them into its own tables.
/// Threads: any. Guarantee: calls block only each other. An exception leaves everything unchanged.
class Authorities {
public:
    /// Maximum number of names, including the empty one: a note of the feed has 16 bits for the
    /// number.
    static constexpr std::uint64_t kMost = 1 << 16;

    /// `newest`: the region's word with the list's newest entry.
    Authorities(memory::Region& region, sync::Word& newest);

    /// The number of a name; adds a new name if necessary. In a shared store only the holder of the
    /// commit lock may call it. Throws CapacityExceeded.
    [[nodiscard]] std::uint64_t id(std::string_view name);
    /// Empty for an unknown number, which only a damaged store has.
    [[nodiscard]] std::string name(std::uint64_t id);

    /// Whether a thread is using the names.
    [[nodiscard]] bool in_use() const noexcept { return lock_.in_use(); }
    /// Memory occupied by the names.
    [[nodiscard]] std::size_t bytes() const;
    /// Visits every block of the region that holds them: visit(offset, bytes).
    template <class Visit>
    void visit_blocks(Visit visit) const {
        Offset block = region_.inside(newest_.load_acquire());
        for (std::uint64_t left = kMost; block != 0 && left > 0; --left) {
            visit(block, Listed::bytes(region_.word(block + Listed::kSize).load_relaxed()));
            block = region_.inside(region_.word(block + Listed::kNext).load_relaxed());
        }
    }

private:
    struct Hash {
        using is_transparent = void;
        std::size_t operator()(std::string_view name) const noexcept {
            return std::hash<std::string_view>()(name);
        }
    };
    using Ids = std::unordered_map<std::string, std::uint64_t, Hash, std::equal_to<>>;

    /// An entry of the list in the region.
    struct Listed {
        static constexpr Offset kNext = 0;
        static constexpr Offset kNumber = 8;
        static constexpr Offset kSize = 16;
        static constexpr Offset kText = 24;
        static constexpr std::size_t bytes(std::size_t size) { return kText + (size + 7) / 8 * 8; }
    };

    std::uint64_t find_or_add(std::string_view name);
    void enter(std::string_view name, std::uint64_t id);
    void list(std::string_view name, std::uint64_t id);
    /// Reads the names that other processes have added.
    void learn();
    mutable sync::Word lock_word_{};
    mutable sync::CommitLock lock_{lock_word_};
    Ids ids_;                                                      // those known to this process
    std::unordered_map<std::uint64_t, const std::string*> names_;  // the keys of `ids_`
    std::uint64_t last_id_ = 0;
    std::uint64_t serial_;  // unique, unlike an address
    memory::Region& region_;
    sync::Word& newest_;
};

}  // namespace tfdb::store
