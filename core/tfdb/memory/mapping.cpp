#include "tfdb/memory/mapping.hpp"

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cstdint>
#include <system_error>
#include <utility>

#include "tfdb/base/error.hpp"
#include "tfdb/memory/memory.hpp"
#include "tfdb/sync/word.hpp"

namespace tfdb::memory {
namespace {

constexpr std::size_t kLargestReserve = std::size_t{1} << 38;   // 256 GiB of addresses
constexpr std::size_t kFairReserve = std::size_t{1} << 30;      // 1 GiB: even if stores are many
constexpr std::size_t kSmallestReserve = std::size_t{1} << 28;  // 256 MiB: if no more is available
// A process has 128 TiB of addresses. Half of them are for large stores. Each store takes at most
// this fraction of the remaining half, so that thousands of stores fit.
constexpr std::size_t kShared = std::size_t{1} << 46;
constexpr std::size_t kShareOfStore = 256;
constexpr const char* kMoreAddresses =
    "raise the process's limit of addresses (ulimit -v), or close other stores";
// For files: 2 MiB would delay a commit by 0.2 ms (measured), and an idle store would occupy them.
constexpr std::size_t kFileStep = std::size_t{1} << 18;

sync::Word g_reserved;  // by all stores of this process

/// The number of bytes to reserve. Two concurrent calls may count the same bytes as free: this is
/// an estimate, not a limit.
std::size_t reserve_wanted() {
    const std::size_t taken = g_reserved.load_relaxed();
    const std::size_t left = taken < kShared ? kShared - taken : 0;
    return std::clamp(std::bit_floor(left / kShareOfStore), kFairReserve, kLargestReserve);
}

}  // namespace

Mapping Mapping::reserve() {
    for (std::size_t size = reserve_wanted(); size >= kSmallestReserve; size /= 2) {
        void* mapped = ::mmap(nullptr, size, PROT_READ | PROT_WRITE,
                              MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
        if (mapped == MAP_FAILED)
            continue;
        g_reserved.fetch_add(size);
        // Overrides the system's default, so that a small store stays small: see `back`.
        ::madvise(mapped, size, MADV_NOHUGEPAGE);
        return {static_cast<std::byte*>(mapped), size, size, -1, {}};
    }
    throw CapacityExceeded("cannot reserve 256 MiB of addresses for a store: " +
                           std::string(kMoreAddresses));
}

Mapping Mapping::of_file(int file, std::size_t bytes, bool writable, std::string name,
                         std::size_t reach) {
    const std::size_t reserved = std::max(bytes, reach);
    const int protection = writable ? PROT_READ | PROT_WRITE : PROT_READ;
    void* mapped =
        ::mmap(nullptr, reserved, protection, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    if (mapped == MAP_FAILED ||
        ::mmap(mapped, bytes, protection, MAP_SHARED | MAP_FIXED, file, 0) == MAP_FAILED) {
        const int error = errno;
        if (mapped != MAP_FAILED)
            ::munmap(mapped, reserved);
        ::close(file);
        const std::string reason = error == ENOMEM ? "it needs " + std::to_string(reserved) +
                                                         " bytes of addresses; " + kMoreAddresses
                                                   : std::generic_category().message(error);
        throw CapacityExceeded("cannot map " + std::to_string(bytes) + " bytes of " + name + ": " +
                               reason);
    }
    return {static_cast<std::byte*>(mapped), bytes, reserved, file, std::move(name)};
}

Mapping::Mapping(Mapping&& other) noexcept
    : base_(std::exchange(other.base_, nullptr)),
      bytes_(other.bytes_),
      reserved_(other.reserved_),
      file_(std::exchange(other.file_, -1)),
      name_(std::move(other.name_)) {}

Mapping::~Mapping() {
    if (base_ == nullptr)
        return;
    ::munmap(base_, reserved_);
    if (is_file())
        ::close(file_);
    else
        g_reserved.fetch_add(std::uint64_t{0} - bytes_);
}

std::size_t Mapping::step() const noexcept {
    return is_file() ? kFileStep : kHugePage;
}

void Mapping::back(Offset from, Offset to) const {
    if (!is_file()) {
        // With small pages, page-table misses cost writers of many cold edges a factor of four
        // (measured).
        ::madvise(base_ + from, to - from, MADV_HUGEPAGE);
        return;
    }
    int failed = EINTR;
    while (failed == EINTR)
        failed = ::posix_fallocate(file_, static_cast<off_t>(from), static_cast<off_t>(to - from));
    if (failed != 0) {
        throw CapacityExceeded("no room for " + std::to_string(to - from) + " more bytes of " +
                               name_ + ": " + std::generic_category().message(failed) +
                               "; free memory on its file system, or shorten history");
    }
}

bool Mapping::give_back(Offset from, Offset to) const noexcept {
    if (!is_file())
        return ::madvise(base_ + from, to - from, MADV_DONTNEED) == 0;
    int failed = -1;
    do {
        failed = ::fallocate(file_, FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE,
                             static_cast<off_t>(from), static_cast<off_t>(to - from));
    } while (failed != 0 && errno == EINTR);
    return failed == 0;
}

}  // namespace tfdb::memory
