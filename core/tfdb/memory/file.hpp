// Common parts of the files of shared and frozen stores.
#pragma once

#include <unistd.h>

#include <bit>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>

#include "tfdb/base/error.hpp"

namespace tfdb::memory {

/// Words of the region that belong to the file: see Region.
enum FileWord : unsigned {
    kMagicWord = 0,  // written last
    kEndWord = 1,    // the region's: end of its last block
    kIdWord = 10,    // of a shared store
    kBytesWord = 11,
    kLayoutWord = 12,
    // Checksums of a frozen store: of its header without this word, and of the rest.
    kHeaderSumWord = 13,
    kDataSumWord = 14,
};
// Read as text on a little-endian machine.
inline constexpr std::uint64_t kSharedMagic = 0x314D485342444654;  // "TFDBSHM1"
inline constexpr std::uint64_t kFrozenMagic = 0x315A524642444654;  // "TFDBFRZ1"

/// The reach of any offset in a file, even in a damaged one: blocks begin inside
/// (`Region::inside`), and the largest blocks that a word can describe are the frame table and
/// directories (`most_entries`).
inline std::size_t reach_of(std::size_t bytes) {
    constexpr std::size_t kLargestTable = std::size_t{1} << 30;
    return 3 * std::bit_ceil(bytes) + kLargestTable;
}

/// Owns an open file until it is handed over. Threads: one. Guarantee: none.
class File {
public:
    explicit File(int file) : file_(file) {}
    ~File() {
        if (file_ >= 0)
            ::close(file_);
    }
    File(const File&) = delete;
    File& operator=(const File&) = delete;
    File(File&&) = delete;
    File& operator=(File&&) = delete;

    [[nodiscard]] int get() const { return file_; }
    int release() { return std::exchange(file_, -1); }

private:
    int file_;
};

inline ErrorDetail detail_of(const std::string& path, std::string reason) {
    ErrorDetail detail;
    detail.path = path;
    detail.reason = std::move(reason);
    return detail;
}

/// The store as users call it: its name if it is found by name, otherwise the path.
inline std::string named(const std::string& path) {
    constexpr std::string_view kByName = "/dev/shm/tfdb.";
    if (path.compare(0, kByName.size(), kByName) != 0)
        return path;
    return "'" + path.substr(kByName.size()) + "'";
}

inline std::string reason_of(int error) {
    return std::generic_category().message(error);
}

[[noreturn]] inline void throw_corrupt(const std::string& path, const std::string& reason) {
    throw CorruptStore("the store " + named(path) + " cannot be opened: " + reason,
                       detail_of(path, reason));
}

}  // namespace tfdb::memory
