// Positions of frames in a list, and lists in which each frame is once.
#pragma once

#include <algorithm>
#include <cstdint>
#include <utility>
#include <vector>

#include "tfdb/base/types.hpp"

namespace tfdb::txn {

/// Positions by frame, in one flat table with O(1) `clear`.
/// Threads: one. Guarantee: an exception leaves it unchanged.
class FramePlaces {
public:
    static constexpr std::uint32_t kNone = ~std::uint32_t{0};

    void clear() {
        used_ = 0;
        ++round_;
    }
    [[nodiscard]] std::uint32_t find(FrameId id) const {
        return used_ == 0 ? kNone : entries_[entry_of(id)].place_in(round_);
    }
    /// kNone: removes the frame's position.
    void set(FrameId id, std::uint32_t place) {
        if (2 * (used_ + 1) > entries_.size())
            grow();
        Entry& entry = entries_[entry_of(id)];
        used_ += entry.round == round_ ? 0 : 1;
        entry = {round_, id, place};
    }

private:
    struct Entry {
        std::uint64_t round = 0;
        FrameId id = kNoFrame;
        std::uint32_t place = kNone;

        [[nodiscard]] std::uint32_t place_in(std::uint64_t now) const {
            return round == now ? place : kNone;
        }
    };

    /// Index of the frame's entry, or of the entry that it would get.
    [[nodiscard]] std::size_t entry_of(FrameId id) const {
        const std::size_t mask = entries_.size() - 1;
        std::size_t at = (id * std::size_t{0x9E37'79B9'7F4A'7C15} >> 32U) & mask;
        while (entries_[at].round == round_ && entries_[at].id != id)
            at = (at + 1) & mask;
        return at;
    }
    void grow() {
        std::vector<Entry> entries(std::max<std::size_t>(16, 2 * entries_.size()));
        entries.swap(entries_);
        for (const Entry& entry : entries) {
            if (entry.round == round_)
                entries_[entry_of(entry.id)] = entry;
        }
    }

    std::vector<Entry> entries_;  // size is a power of two
    std::size_t used_ = 0;
    std::uint64_t round_ = 1;  // entries of other rounds are free
};

/// Frames in the order of their insertion, each once.
/// Threads: one. Guarantee: `contains`, `insert` and `clear` are O(1).
class FrameList {
public:
    void clear() {
        frames_.clear();
        places_.clear();
    }
    [[nodiscard]] bool contains(FrameId id) const { return places_.find(id) != FramePlaces::kNone; }
    /// False: the frame is already in the list.
    bool insert(FrameId id) {
        if (contains(id))
            return false;
        places_.set(id, 0);
        frames_.push_back(id);
        return true;
    }
    [[nodiscard]] bool empty() const { return frames_.empty(); }
    [[nodiscard]] auto begin() const { return frames_.begin(); }
    [[nodiscard]] auto end() const { return frames_.end(); }

private:
    std::vector<FrameId> frames_;
    FramePlaces places_;
};

/// Lists of a transaction, reused by the next transaction of the thread that ends it.
/// Threads: one at a time. Guarantee: each thread keeps at most one, and no large one.
template <class Lists>
class KeptByThread {
public:
    KeptByThread() : lists_(spare != nullptr ? std::exchange(spare, nullptr) : new Lists) {}
    ~KeptByThread() {
        lists_->clear();
        if (spare == nullptr && !thread_ended && lists_->is_small()) {
            static thread_local const End end;
            (void)end;
            spare = lists_;
        } else {
            delete lists_;
        }
    }
    KeptByThread(const KeptByThread&) = delete;
    KeptByThread& operator=(const KeptByThread&) = delete;

    [[nodiscard]] Lists& operator*() const { return *lists_; }
    [[nodiscard]] Lists* operator->() const { return lists_; }

private:
    struct End {
        ~End() {
            delete std::exchange(spare, nullptr);
            thread_ended = true;
        }
    };
    static inline constinit thread_local Lists* spare = nullptr;
    static inline constinit thread_local bool thread_ended = false;

    Lists* lists_;
};

}  // namespace tfdb::txn
