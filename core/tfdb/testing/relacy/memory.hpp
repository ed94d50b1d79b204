// The engine's words under Relacy, which runs them in the C++ memory model, weak orders included.
// Include what is to be checked before this header: Relacy redefines `assert` and more.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <streambuf>
#include <string>
#include <vector>

#include "tfdb/memory/memory.hpp"
#include "tfdb/sync/word.hpp"
#include "tfdb/testing/retired.hpp"

#if defined(__GNUC__)
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wshadow"
#pragma GCC diagnostic ignored "-Wconversion"
#endif
#include <relacy/relacy.hpp>
// The code under test must be able to say what it means; its allocations are ordinary ones.
#undef new
#undef delete
#if defined(__GNUC__)
#pragma GCC diagnostic pop
#endif

// Relacy replaces `operator delete`, but not the sized ones that C++14 brought: without these, what
// its allocator gave goes to the library's. Once per program, as with Relacy's own headers.
void operator delete(void* block, std::size_t) noexcept {
    ::operator delete(block);
}
void operator delete[](void* block, std::size_t) noexcept {
    ::operator delete[](block);
}

namespace tfdb::relacy {

inline constexpr std::uint64_t kNowhere = ~std::uint64_t{0};

/// What a seeded bug leaves out. Set between simulations only.
struct Weakness {
    std::uint64_t store = kNowhere;  // the word at this offset is stored relaxed throughout
    std::uint64_t load = kNowhere;   // ... or loaded relaxed
    bool no_release_fence = false;
    bool no_acquire_fence = false;
    bool no_full_fence = false;
    bool no_total_order = false;   // ordered operations only acquire and release
    bool relaxed_updates = false;  // compare_exchange, exchange and fetch_add order nothing
};
inline Weakness g_weakness;

/// How many steps a reader idles in each of its checks, at most: long enough for the block that it
/// is in to be used again. Set between simulations only.
inline unsigned g_pause = 0;

inline void fence_acquire() {
    if (!g_weakness.no_acquire_fence) {
        rl::atomic_thread_fence(rl::mo_acquire, RL_INFO);
    }
}
inline void fence_release() {
    if (!g_weakness.no_release_fence) {
        rl::atomic_thread_fence(rl::mo_release, RL_INFO);
    }
}
inline void fence_full() {
    if (!g_weakness.no_full_fence) {
        rl::atomic_thread_fence(rl::mo_seq_cst, RL_INFO);
    }
}

// A word of the region as one of Relacy's atomics; its constructor stores zero.
// Simulated threads may call all. The orders are those of sync::Word.
class Word {
public:
    [[nodiscard]] std::uint64_t load_relaxed() const {
        return value_.load(rl::mo_relaxed, RL_INFO);
    }
    [[nodiscard]] std::uint64_t load_acquire() const {
        return value_.load(weak_load_ ? rl::mo_relaxed : rl::mo_acquire, RL_INFO);
    }
    void store_relaxed(std::uint64_t value) { value_.store(value, rl::mo_relaxed, RL_INFO); }
    void store_release(std::uint64_t value) {
        value_.store(value, weak_store_ ? rl::mo_relaxed : rl::mo_release, RL_INFO);
    }
    bool compare_exchange(std::uint64_t& expected, std::uint64_t desired) {
        return value_(RL_INFO).compare_exchange_strong(
            expected, desired, update_order(),
            g_weakness.relaxed_updates ? rl::mo_relaxed : rl::mo_acquire);
    }
    std::uint64_t exchange(std::uint64_t desired) {
        return value_(RL_INFO).exchange(desired, update_order());
    }
    std::uint64_t fetch_add(std::uint64_t delta) {
        return value_(RL_INFO).fetch_add(delta, update_order());
    }
    [[nodiscard]] std::uint64_t load_ordered() const {
        return value_.load(g_weakness.no_total_order ? rl::mo_acquire : rl::mo_seq_cst, RL_INFO);
    }
    bool compare_exchange_ordered(std::uint64_t& expected, std::uint64_t desired) {
        if (g_weakness.no_total_order) {
            return compare_exchange(expected, desired);
        }
        return value_(RL_INFO).compare_exchange_strong(expected, desired, rl::mo_seq_cst,
                                                       rl::mo_seq_cst);
    }
    static void fence_acquire() { relacy::fence_acquire(); }
    static void fence_release() { relacy::fence_release(); }
    static void fence_full() { relacy::fence_full(); }
    static void fence_full_after_exchange() { relacy::fence_full(); }

    /// Sleeps until told; orders nothing, as std::atomic promises nothing. Relacy calls a thread
    /// that is never woken a livelock.
    void wait(std::uint64_t old) const {
        while (value_.debug_value() == old) {
            const std::uint32_t self = 1U << rl::thread_index();
            asleep_ |= self;
            while ((asleep_ & self) != 0) {
                rl::yield(1, RL_INFO);
            }
        }
    }
    void notify_one() { asleep_ &= asleep_ - 1; }
    void notify_all() { asleep_ = 0; }
    sync::Woken sleep(std::uint64_t old, std::int64_t) const {
        wait(old);
        return sync::Woken::kChanged;
    }
    void wake_one() { notify_one(); }
    void wake_all() { notify_all(); }

    void weaken(bool load, bool store) {
        weak_load_ = load;
        weak_store_ = store;
    }

private:
    static rl::memory_order update_order() {
        return g_weakness.relaxed_updates ? rl::mo_relaxed : rl::mo_acq_rel;
    }

    rl::atomic<std::uint64_t> value_{0};
    mutable std::uint32_t asleep_ = 0;
    bool weak_load_ = false;
    bool weak_store_ = false;
};

// A stream buffer of fixed size, for what Relacy prints. A growing one would be grown inside a
// simulation, by Relacy's allocator, and freed outside by the other one. One thread.
class Account : public std::streambuf {
public:
    Account() { setp(text_.data(), text_.data() + text_.size()); }
    [[nodiscard]] std::string text() const { return {pbase(), pptr()}; }

protected:
    // What does not fit is dropped.
    int_type overflow(int_type character) override { return traits_type::not_eof(character); }

private:
    std::array<char, 1 << 16> text_;
};

// A small region of Relacy's words. A released block is handed out again at once.
// Threads: simulated ones may use words; allocate and release need the engine's lock.
template <unsigned PayloadWords, std::size_t Bytes>
class Memory {
public:
    using Word = relacy::Word;
    using Offset = std::uint64_t;
    static constexpr unsigned kPayloadWords = PayloadWords;
    static constexpr std::size_t kLine = 64;

    Memory() {
        for (std::size_t index = 0; index < words_.size(); ++index) {
            words_[index].weaken(index * 8 == g_weakness.load, index * 8 == g_weakness.store);
        }
    }

    Word& word(Offset offset) const {
        RL_ASSERT(offset < Bytes && offset % 8 == 0);
        return words_[offset / 8];
    }

    Offset allocate(std::size_t bytes) {
        const std::size_t lines = (bytes + kLine - 1) / kLine;
        std::vector<Offset>& waiting = free_[lines];
        if (!waiting.empty()) {
            const Offset block = waiting.back();
            waiting.pop_back();
            return block;
        }
        const Offset block = next_;
        next_ += lines * kLine;
        RL_ASSERT(next_ <= Bytes);
        return block;
    }
    void release(Offset block, std::size_t bytes) {
        free_[(bytes + kLine - 1) / kLine].push_back(block);
    }

    void retire(memory::Line line, Offset block, std::size_t bytes, std::uint64_t commit) {
        retired_[place(line)].add(block, bytes, commit);
    }
    bool reclaim(memory::Line line, std::uint64_t oldest, std::size_t keep) {
        return retired_[place(line)].reclaim(*this, word(kReclaimed + 8 * place(line)), oldest,
                                             keep);
    }
    [[nodiscard]] std::size_t retired_bytes(memory::Line line) const {
        return retired_[place(line)].bytes();
    }
    /// Only readers ask, in their checks.
    [[nodiscard]] Word& reclaimed(memory::Line line) const {
        const bool pauses = g_pause != 0 && line == memory::Line::kReplaced;
        for (unsigned steps = pauses ? rl::rand(g_pause) : 0; steps > 0; --steps)
            (void)word(0).load_relaxed();
        return word(kReclaimed + 8 * place(line));
    }

    static void fence_acquire() { relacy::fence_acquire(); }
    static void fence_release() { relacy::fence_release(); }
    static void fence_full() { relacy::fence_full(); }

private:
    static constexpr Offset kReclaimed = 8;
    static std::size_t place(memory::Line line) { return static_cast<std::size_t>(line); }

    mutable std::array<Word, Bytes / 8> words_;
    Offset next_ = kLine;
    std::map<std::size_t, std::vector<Offset>> free_;
    std::array<testing::RetiredBlocks, memory::kLines> retired_;
};

}  // namespace tfdb::relacy
