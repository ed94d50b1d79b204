// The address range of a region: private memory, or a file that processes share.
#pragma once

#include <cstddef>
#include <string>

#include "tfdb/base/types.hpp"

namespace tfdb::memory {

inline constexpr std::size_t kHugePage = std::size_t{1} << 21;

/// A mapped address range, and the calls that back it with memory.
/// Threads: one makes and destroys it; `back` the holder of the region's lock.
/// Guarantee: writes to backed addresses cannot fail.
class Mapping {
public:
    /// Private addresses, which get memory when they are first touched, in small pages unless they
    /// are backed. Throws CapacityExceeded if the system has none left.
    static Mapping reserve();
    /// The whole of an open file; the mapping owns and closes the file. Throws CapacityExceeded.
    /// `reach`: total size including private memory behind the file, initially zero, where offsets
    /// from a damaged file do no harm.
    static Mapping of_file(int file, std::size_t bytes, bool writable, std::string name,
                           std::size_t reach = 0);

    ~Mapping();
    Mapping(Mapping&& other) noexcept;
    Mapping(const Mapping&) = delete;
    Mapping& operator=(const Mapping&) = delete;
    Mapping& operator=(Mapping&&) = delete;

    [[nodiscard]] std::byte* base() const noexcept { return base_; }
    [[nodiscard]] std::size_t bytes() const noexcept { return bytes_; }
    [[nodiscard]] bool is_file() const noexcept { return file_ >= 0; }

    /// The number of bytes that are backed at a time.
    [[nodiscard]] std::size_t step() const noexcept;
    /// Backs addresses with memory: huge pages if they are private, disk blocks if they are a
    /// file's. A write into a full file system cannot return an error; it kills the process. Throws
    /// CapacityExceeded and then changes nothing.
    void back(Offset from, Offset to) const;
    /// Returns memory to the system. The addresses then read as zeros; a file's must be backed
    /// before the next write. False: the system does not support it.
    [[nodiscard]] bool give_back(Offset from, Offset to) const noexcept;

private:
    Mapping(std::byte* base, std::size_t bytes, std::size_t reserved, int file, std::string name)
        : base_(base), bytes_(bytes), reserved_(reserved), file_(file), name_(std::move(name)) {}

    std::byte* base_;
    std::size_t bytes_;
    std::size_t reserved_;  // of addresses
    int file_ = -1;
    std::string name_;
};

}  // namespace tfdb::memory
