// The shared 64-bit word, its memory orders and the fences: all shared data consist of these.
#pragma once

#include <atomic>
#include <cstdint>

namespace tfdb::sync {

// ThreadSanitizer does not model fences. That is harmless here: all shared data are atomic words,
// so a fence never causes a false or a missed race report.
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wtsan"
#endif
inline void fence_acquire() noexcept {
    std::atomic_thread_fence(std::memory_order_acquire);
}
inline void fence_release() noexcept {
    std::atomic_thread_fence(std::memory_order_release);
}
/// Orders an earlier store before a later load (the pin protocol needs it).
inline void fence_full() noexcept {
    std::atomic_thread_fence(std::memory_order_seq_cst);
}
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC diagnostic pop
#endif

#ifdef TFDB_COUNTS_STORES
/// Called before every store in builds that count stores in order to die at one: see `make
/// torture`.
void about_to_store() noexcept;
#else
inline void about_to_store() noexcept {}
#endif

/// How a sleep ended.
enum class Woken : std::uint8_t { kChanged, kTimedOut, kInterrupted };  // kInterrupted: by a signal

/// A 64-bit word shared by threads and processes.
/// Threads: any may call anything.
/// Guarantee: every operation is wait-free except `sleep` and `wait`, which blocks until the value
/// differs.
class Word {
public:
    [[nodiscard]] std::uint64_t load_relaxed() const noexcept {
        return value_.load(std::memory_order_relaxed);
    }
    [[nodiscard]] std::uint64_t load_acquire() const noexcept {
        return value_.load(std::memory_order_acquire);
    }
    void store_relaxed(std::uint64_t value) noexcept {
        about_to_store();
        value_.store(value, std::memory_order_relaxed);
    }
    void store_release(std::uint64_t value) noexcept {
        about_to_store();
        value_.store(value, std::memory_order_release);
    }
    /// On failure `expected` holds the current value.
    bool compare_exchange(std::uint64_t& expected, std::uint64_t desired) noexcept {
        about_to_store();
        return value_.compare_exchange_strong(expected, desired, std::memory_order_acq_rel,
                                              std::memory_order_acquire);
    }
    std::uint64_t exchange(std::uint64_t desired) noexcept {
        about_to_store();
        return value_.exchange(desired, std::memory_order_acq_rel);
    }
    std::uint64_t fetch_add(std::uint64_t delta) noexcept {
        about_to_store();
        return value_.fetch_add(delta, std::memory_order_acq_rel);
    }
    /// Operations in one total order: if two threads each call `compare_exchange_ordered`, then
    /// `load_ordered` of the other's word, at least one of them sees the other's change. This is
    /// cheaper than a full fence in between.
    bool compare_exchange_ordered(std::uint64_t& expected, std::uint64_t desired) noexcept {
        about_to_store();
        return value_.compare_exchange_strong(expected, desired, std::memory_order_seq_cst,
                                              std::memory_order_seq_cst);
    }
    [[nodiscard]] std::uint64_t load_ordered() const noexcept {
        return value_.load(std::memory_order_seq_cst);
    }

    /// The fences as members, so that generic code uses the fences of its word type.
    static void fence_acquire() noexcept { sync::fence_acquire(); }
    static void fence_release() noexcept { sync::fence_release(); }
    static void fence_full() noexcept { sync::fence_full(); }

    /// A full fence after an operation that changed a word of memory and read it at once, such as
    /// unlocking a lock. It costs nothing on processors that let no access pass such an operation.
    static void fence_full_after_exchange() noexcept {
#if defined(__x86_64__)
        std::atomic_signal_fence(std::memory_order_seq_cst);
#else
        sync::fence_full();
#endif
    }

    /// Sleeps until `wake_one` or `wake_all` in any process that maps the word, or until the time
    /// is over. Returns at once if the lower half of the value already differs.
    Woken sleep(std::uint64_t old, std::int64_t longest_ns) const noexcept;
    void wake_one() noexcept;
    void wake_all() noexcept;

    void wait(std::uint64_t old) const noexcept {
        value_.wait(old, std::memory_order_relaxed);
    }
    void notify_one() noexcept {
        value_.notify_one();
    }
    void notify_all() noexcept {
        value_.notify_all();
    }

private:
    std::atomic<std::uint64_t> value_;
};

/// A pointer shared by the threads of a process.
/// Threads: any. Guarantee: wait-free.
template <class T>
class Pointer {
public:
    [[nodiscard]] T* load_acquire() const noexcept {
        return value_.load(std::memory_order_acquire);
    }
    void store_release(T* value) noexcept { value_.store(value, std::memory_order_release); }
    /// On failure `expected` holds the current value.
    bool compare_exchange(T*& expected, T* desired) noexcept {
        return value_.compare_exchange_strong(expected, desired, std::memory_order_acq_rel,
                                              std::memory_order_acquire);
    }

private:
    std::atomic<T*> value_{nullptr};
};

static_assert(sizeof(Word) == 8 && alignof(Word) == 8,
              "a word is eight aligned bytes of the region");
static_assert(std::atomic<std::uint64_t>::is_always_lock_free, "words must not hide a lock");

/// Nanoseconds of a monotonic clock that all processes share.
[[nodiscard]] std::int64_t steady_now() noexcept;

/// Tells the processor that this thread is spinning.
inline void spin_pause() noexcept {
#if defined(__x86_64__) || defined(__i386__)
    __builtin_ia32_pause();
#elif defined(__aarch64__)
    asm volatile("yield");
#endif
}

}  // namespace tfdb::sync
