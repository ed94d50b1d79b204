// The file of a frozen store: written whole, checked, mapped by any number of processes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "tfdb/base/types.hpp"
#include "tfdb/memory/shared_file.hpp"

namespace tfdb::memory {

/// So much at the front is compared with its checksum whenever the file is opened; the rest only if
/// it is asked for, for that takes as long as to read it.
inline constexpr std::size_t kFrozenHeaderBytes = 16384;

/// Opens the frozen store at a path. `layout`: what the data must look like for this program.
/// `verify`: read all of it, and compare it with its checksum.
/// Throws NoSuchStore, CorruptStore (no frozen store, of another version or machine, cut, damaged),
/// ReadOnly (no permission), CapacityExceeded.
SharedFile open_frozen(const std::string& path, std::uint64_t layout, bool verify);

/// A frozen store under way. It takes its name, and the place of a file that has it, in `publish`;
/// otherwise nothing of it remains. `in_place`: it has its name, which was free, from the start.
/// Threads: one. Guarantee: as the file system's.
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
    /// Writes what stands at the front, its file's words included, makes the file `bytes` long,
    /// brings it to the disk, and gives it its name. Throws as `write`.
    void publish(std::vector<std::uint64_t> front, std::size_t bytes, std::uint64_t layout);

private:
    [[noreturn]] void fail(int error) const;

    std::string path_;
    std::string made_;  // its name until it is published
    int file_;
    bool published_ = false;
};

}  // namespace tfdb::memory
