#include "tfdb/memory/control.hpp"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <new>
#include <system_error>
#include <utility>
#include <vector>

#include "tfdb/base/error.hpp"
#include "tfdb/memory/file.hpp"
#include "tfdb/sync/event_count.hpp"
#include "tfdb/sync/fork.hpp"

namespace tfdb::memory {
namespace {

constexpr std::uint64_t kMagic = 0x314C544342444654;  // "TFDBCTL1" on a little-endian machine
constexpr unsigned kOwnMagicWord = 0;
constexpr unsigned kOwnIdWord = 1;
constexpr unsigned kHolderWord = 2;
constexpr unsigned kSlotsWord = 5;
constexpr std::size_t kMutexByte = 256;
constexpr std::size_t kSlotsByte = 4096;
constexpr int kSpins = 400;
constexpr std::int64_t kSecond = 1'000'000'000;

#ifdef __GLIBC_PREREQ
#if __GLIBC_PREREQ(2, 30)
#define TFDB_HAS_CLOCKLOCK
#endif
#endif

/// Locks the mutex, or gives up at a time of the steady clock.
int lock_until(pthread_mutex_t* mutex, std::int64_t until) noexcept {
#ifdef TFDB_HAS_CLOCKLOCK
    const timespec at{until / kSecond, until % kSecond};
    return ::pthread_mutex_clocklock(mutex, CLOCK_MONOTONIC, &at);
#else
    // Older libraries wait by the adjustable clock: with short steps that matters little.
    constexpr std::int64_t kStep = 10'000'000;
    for (;;) {
        const std::int64_t left = until - sync::steady_now();
        timespec at{};
        ::clock_gettime(CLOCK_REALTIME, &at);
        const std::int64_t ends = at.tv_nsec + std::clamp(left, std::int64_t{0}, kStep);
        at.tv_sec += ends / kSecond;
        at.tv_nsec = ends % kSecond;
        if (const int result = ::pthread_mutex_timedlock(mutex, &at);
            result != ETIMEDOUT || left <= kStep)
            return result;
    }
#endif
}

/// A lock on a slot's byte. It belongs to the open file description, so it ends when the last
/// process closes that.
struct flock lock_of(unsigned slot, short kind) {
    struct flock lock {};
    lock.l_type = kind;
    lock.l_whence = SEEK_SET;
    lock.l_start = static_cast<off_t>(slot);
    lock.l_len = 1;
    return lock;
}
bool set_lock(int file, unsigned slot, short kind) {
    struct flock lock = lock_of(slot, kind);
    return ::fcntl(file, F_OFD_SETLK, &lock) == 0;
}

/// This process's pid, and its pid namespace.
std::uint64_t this_process() {
    struct stat space {};
    ::stat("/proc/self/ns/pid", &space);
    return static_cast<std::uint64_t>(::getpid()) << 32 | (space.st_ino & 0xFFFFFFFFU);
}

[[noreturn]] void throw_damaged(const std::string& path) {
    throw CorruptStore(
        "the control file of the store " + named(path) +
            " belongs to another store or is damaged; remove the store and create it again",
        detail_of(path, "control file"));
}

void make_mutex(pthread_mutex_t* mutex) {
    pthread_mutexattr_t attributes;
    ::pthread_mutexattr_init(&attributes);
    ::pthread_mutexattr_setpshared(&attributes, PTHREAD_PROCESS_SHARED);
    ::pthread_mutexattr_setrobust(&attributes, PTHREAD_MUTEX_ROBUST);
    ::pthread_mutex_init(mutex, &attributes);
    ::pthread_mutexattr_destroy(&attributes);
}

using MutexWords = std::array<std::uint32_t, sizeof(pthread_mutex_t) / 4>;

/// A mutex that was never locked. Its nonzero words identify its kind and never change.
MutexWords fresh_mutex() {
    pthread_mutex_t mutex;
    make_mutex(&mutex);
    MutexWords words{};
    std::memcpy(words.data(), &mutex, sizeof words);
    ::pthread_mutex_destroy(&mutex);
    return words;
}

/// Maps the whole file; closes it before it throws.
Mapping map_whole(int file, const std::string& path) {
    struct stat status {};
    if (::fstat(file, &status) == 0 && status.st_size == static_cast<off_t>(Control::kBytes))
        return Mapping::of_file(file, Control::kBytes, true, named(path));
    ::close(file);
    throw_damaged(path);
}

}  // namespace

void Control::prepare(const Mapping& mapping, std::uint64_t id) {
    mapping.back(0, kSlotsByte);
    auto* const words = reinterpret_cast<sync::Word*>(mapping.base());
    make_mutex(reinterpret_cast<pthread_mutex_t*>(mapping.base() + kMutexByte));
    words[kOwnIdWord].store_relaxed(id);
    words[kOwnMagicWord].store_release(kMagic);
}

Control::Control(int file, std::uint64_t id, const std::string& path)
    : mapping_(map_whole(file, path)), file_(file) {
    if (!is_of(mapping_, id))
        throw_damaged(path);
    mine_ = take_slot(path);
}

Control::~Control() {
    if (is_reopened_)
        ::close(file_);
}

bool Control::take_own_slot() noexcept {
    // Locks belong to the open file description, which the parent shares: the file is reopened.
    std::array<char, 32> name{};
    std::snprintf(name.data(), name.size(), "/proc/self/fd/%d", file_);
    const int file = ::open(name.data(), O_RDWR | O_CLOEXEC);
    if (file < 0)
        return false;
    const int before = std::exchange(file_, file);
    try {
        mine_ = take_slot({});
    } catch (...) {
        file_ = before;
        ::close(file);
        return false;
    }
    if (std::exchange(is_reopened_, true))
        ::close(before);
    return true;
}

bool Control::is_of(const Mapping& mapping, std::uint64_t id) noexcept {
    return word_of(mapping, kOwnMagicWord).load_acquire() == kMagic &&
           word_of(mapping, kOwnIdWord).load_relaxed() == id;
}

void Control::notify_removal(const Mapping& mapping) noexcept {
    word_of(mapping, kRemovedWord).store_release(1);
    sync::EventCount(word_of(mapping, kCommitEventWord)).notify();
    sync::EventCount(word_of(mapping, kClockEventWord)).notify();
}

unsigned Control::take_slot(const std::string& path) {
    for (unsigned i = 0; i < kSlots; ++i) {
        if (!set_lock(file_, i, F_WRLCK))
            continue;
        mapping_.back(kSlotsByte + std::size_t{i} * kSlotWords * 8,
                      kSlotsByte + (std::size_t{i} + 1) * kSlotWords * 8);
        clear(i);
        slot(i)[kProcessWord].store_relaxed(this_process());
        std::uint64_t known = word(kSlotsWord).load_relaxed();
        while (known <= i && !word(kSlotsWord).compare_exchange(known, i + 1)) {
        }
        return i;
    }
    throw CapacityExceeded("the store " + named(path) + " is already open in " +
                           std::to_string(kSlots) + " processes, the limit");
}

unsigned Control::slots() const noexcept {
    return static_cast<unsigned>(std::min<std::uint64_t>(word(kSlotsWord).load_acquire(), kSlots));
}
sync::Word* Control::slot(unsigned index) const noexcept {
    return reinterpret_cast<sync::Word*>(mapping_.base() + kSlotsByte) +
           std::size_t{index} * kSlotWords;
}

void Control::clear(unsigned index) const noexcept {
    for (unsigned w = 0; w < kSlotWords; ++w)
        slot(index)[w].store_relaxed(0);
}

bool Control::free_if_dead(unsigned index) const noexcept {
    // Locked while it is cleared, so that no starting process takes it.
    if (index == mine_ || !set_lock(file_, index, F_WRLCK))
        return false;
    clear(index);
    set_lock(file_, index, F_UNLCK);
    return true;
}

unsigned Control::count_processes() const {
    std::vector<std::uint64_t> known;
    unsigned unknown = 0;
    for (unsigned i = 0; i < slots(); ++i) {
        struct flock lock = lock_of(i, F_WRLCK);
        if (i != mine_ && ::fcntl(file_, F_OFD_GETLK, &lock) == 0 && lock.l_type == F_UNLCK)
            continue;
        if (const std::uint64_t process = slot(i)[kProcessWord].load_relaxed(); process != 0)
            known.push_back(process);
        else
            ++unknown;  // a process has just taken it
    }
    std::sort(known.begin(), known.end());
    const auto end = std::unique(known.begin(), known.end());
    return unknown + static_cast<unsigned>(end - known.begin());
}

pthread_mutex_t* Control::mutex() const noexcept {
    return reinterpret_cast<pthread_mutex_t*>(mapping_.base() + kMutexByte);
}
std::int64_t Control::holder() const noexcept {
    return static_cast<std::int64_t>(word(kHolderWord).load_relaxed());
}

bool Control::is_held_elsewhere() const noexcept {
    const std::int64_t pid = holder();
    return pid != 0 && pid != ::getpid();
}

/// Any other kind of mutex would not report deaths, or might kill the process.
bool Control::is_mutex() const noexcept {
    static const MutexWords fresh = fresh_mutex();
    const auto* const words = reinterpret_cast<const std::uint32_t*>(mutex());
    bool same = true;
    for (std::size_t i = 0; i < fresh.size(); ++i)
        same = same && (fresh[i] == 0 || fresh[i] == words[i]);
    return same;
}

Control::Taken Control::took(int result) noexcept {
    if (result == EBUSY || result == ETIMEDOUT)
        return Taken::kNo;
    if (result != 0 && result != EOWNERDEAD)
        return Taken::kBroken;
    // Querying the pid costs more than the rest of the lock.
    if (const std::uint64_t forks = sync::forks(); pid_ == 0 || pid_forks_ != forks) {
        pid_ = static_cast<std::uint64_t>(::getpid());
        pid_forks_ = forks;
    }
    word(kHolderWord).store_relaxed(pid_);
    return result == 0 ? Taken::kYes : Taken::kAfterDeath;
}

Control::Taken Control::try_lock() noexcept {
    return is_mutex() ? took(::pthread_mutex_trylock(mutex())) : Taken::kBroken;
}

Control::Taken Control::lock(std::int64_t longest_ns) noexcept {
    for (int spin = 0; spin < kSpins; ++spin) {
        if (holder() == 0) {
            if (const Taken taken = try_lock(); taken != Taken::kNo)
                return taken;
        }
        sync::spin_pause();
    }
    const std::int64_t until = sync::steady_now() + longest_ns;
    if (!is_mutex())
        return Taken::kBroken;
    return took(lock_until(mutex(), until));
}

void Control::consistent() noexcept {
    ::pthread_mutex_consistent(mutex());
}

void Control::unlock() noexcept {
    word(kHolderWord).store_relaxed(0);
    ::pthread_mutex_unlock(mutex());
}

}  // namespace tfdb::memory
