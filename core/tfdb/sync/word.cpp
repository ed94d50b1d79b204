#include "tfdb/sync/word.hpp"

#include <linux/futex.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#include <bit>
#include <cerrno>
#include <limits>

namespace tfdb::sync {
namespace {

constexpr std::int64_t kSecond = 1'000'000'000;
static_assert(std::endian::native == std::endian::little, "a futex is the lower half of a word");

/// A shared futex, not a private one: the word may lie in a file that other processes map.
long futex(const void* word, int operation, std::uint32_t value, const timespec* time) noexcept {
    return ::syscall(SYS_futex, word, operation, value, time, nullptr, 0);
}

}  // namespace

Woken Word::sleep(std::uint64_t old, std::int64_t longest_ns) const noexcept {
    if (longest_ns <= 0)
        return Woken::kTimedOut;
    const timespec time{longest_ns / kSecond, longest_ns % kSecond};
    if (futex(&value_, FUTEX_WAIT, static_cast<std::uint32_t>(old), &time) == 0)
        return Woken::kChanged;
    switch (errno) {
        case ETIMEDOUT:
            return Woken::kTimedOut;
        case EINTR:
            return Woken::kInterrupted;
        default:
            return Woken::kChanged;
    }
}

void Word::wake_one() noexcept {
    (void)futex(&value_, FUTEX_WAKE, 1, nullptr);
}

void Word::wake_all() noexcept {
    (void)futex(&value_, FUTEX_WAKE, std::numeric_limits<std::int32_t>::max(), nullptr);
}

std::int64_t steady_now() noexcept {
    timespec now{};
    ::clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * kSecond + now.tv_nsec;
}

}  // namespace tfdb::sync
