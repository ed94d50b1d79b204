// The file of a frozen store: written completely, verified, mapped by any number of processes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "tfdb/base/types.hpp"
#include "tfdb/memory/shared_file.hpp"

namespace tfdb::memory {

/// Opening a file always checks this many bytes at its front against their checksum. The rest is
/// checked on request only: that takes as long as reading it.
inline constexpr std::size_t kFrozenHeaderBytes = 16384;

/// Opens the frozen store at a path. `layout`: the data layout that this program requires.
/// `verify`: read all of it and check its checksum.
/// Throws NoSuchStore, CorruptStore (no frozen store, other version or machine, truncated,
/// damaged), ReadOnly (no permission), CapacityExceeded.
SharedFile open_frozen(const std::string& path, std::uint64_t layout, bool verify);

/// A frozen store being written. `publish` gives it its name and replaces a file of that name;
/// without `publish` nothing remains. `in_place`: it has its name, which must be free, from the
/// start.
/// Threads: one. Guarantee: that of the file system.
class NewFrozenFile {
public:
    /// Throws NoSuchStore (no such folder), StoreExists (`in_place`), ReadOnly, CapacityExceeded.
    NewFrozenFile(std::string path, bool in_place);
    ~NewFrozenFile();
    NewFrozenFile(const NewFrozenFile&) = delete;
    NewFrozenFile& operator=(const NewFrozenFile&) = delete;
    NewFrozenFile(NewFrozenFile&&) = delete;
    NewFrozenFile& operator=(NewFrozenFile&&) = delete;

    /// Throws CapacityExceeded: the disk is full.
    void write(Offset at, std::span<const std::uint64_t> words);
    /// Writes the front with the file's words, sets the file's size to `bytes`, syncs it to disk,
    /// and renames it. Throws as `write`.
    void publish(std::vector<std::uint64_t> front, std::size_t bytes, std::uint64_t layout);

private:
    [[noreturn]] void fail(int error) const;

    std::string path_;
    std::string made_;  // its name until it is published
    int file_;
    bool published_ = false;
};

}  // namespace tfdb::memory
