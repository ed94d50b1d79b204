// Names of authorities (writers), and their numbers, which frames keep.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "tfdb/memory/region.hpp"
#include "tfdb/sync/commit_lock.hpp"

namespace tfdb::store {

/// Names of authorities by numbers that are never used twice; no name is number 0. In a store that
/// processes share, the names also lie in its region, as a list that only grows.
/// Threads: any; `keep_only` only with exclusive use of the store.
/// Guarantee: they block only against each other. What throws leaves all as it was.
class Authorities {
public:
    Authorities();
    /// Before the first read: `newest` is the word of the region that leads to the list.
    void share(memory::Region& region, sync::Word& newest);

    /// The number of a name, a new one where necessary: where the names are shared, only the holder
    /// of the commit lock asks, and it throws CapacityExceeded.
    [[nodiscard]] std::uint64_t id(std::string_view name);
    /// None: it was dropped, so no frame has it any more.
    [[nodiscard]] std::optional<std::string> name(std::uint64_t id);

    /// Whether the names are so many that unused ones should go.
    [[nodiscard]] bool crowded() const noexcept {
        return count_.load_relaxed() > most_.load_relaxed();
    }
    /// Drops all names but those with these numbers, and is crowded once twice as many, and
    /// `spare` more, have come.
    void keep_only(std::vector<std::uint64_t> ids, std::size_t spare);

    /// Whether a thread uses the names.
    [[nodiscard]] bool in_use() const noexcept { return lock_.in_use(); }
    /// What the names occupy.
    [[nodiscard]] std::size_t bytes() const;
    /// Every block of the region that they lie in: visit(offset, bytes).
    template <class Visit>
    void visit_blocks(Visit visit) const {
        if (region_ == nullptr)
            return;
        Offset block = region_->inside(newest_->load_acquire());
        for (std::uint64_t left = kMostShared; block != 0 && left > 0; --left) {
            visit(block, Listed::bytes(region_->word(block + Listed::kSize).load_relaxed()));
            block = region_->inside(region_->word(block + Listed::kNext).load_relaxed());
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

    static constexpr std::uint64_t kFew = 64;

    /// Of each name in the region.
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
    /// Learns what others have listed since.
    void learn();
    /// Never the same twice, as an address might be.
    static std::uint64_t next_serial();

    static constexpr std::uint64_t kMostShared = 1 << 16;

    mutable sync::Word lock_word_{};
    mutable sync::CommitLock lock_{lock_word_};
    Ids ids_;  // of a shared store: those that are known here
    std::unordered_map<std::uint64_t, const std::string*> names_;  // the keys of `ids_`
    std::uint64_t last_id_ = 0;
    sync::Word count_{};
    sync::Word most_{};
    sync::Word serial_{};  // another one once names were dropped
    memory::Region* region_ = nullptr;
    sync::Word* newest_ = nullptr;
};

}  // namespace tfdb::store
