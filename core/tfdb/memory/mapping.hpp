// A stretch of addresses for a region to lie in: this process's own, or a file's that many share.
#pragma once

#include <cstddef>
#include <string>

#include "tfdb/base/types.hpp"

namespace tfdb::memory {

inline constexpr std::size_t kHugePage = std::size_t{1} << 21;

/// Mapped addresses, and how they become memory.
/// Threads: one makes and destroys it; `back` the holder of the region's lock.
/// Guarantee: what was backed can be written without fail.
class Mapping {
public:
    /// Addresses of this process alone, which become memory when they are first touched, in small
    /// pages where they are not backed. Throws CapacityExceeded if none are to be had.
    static Mapping reserve();
    /// The whole of an open file, which it closes in the end. Throws CapacityExceeded. `reach`:
    /// behind it, up to so many bytes in all, is memory of this process, zeros at first, where
    /// what a damaged file says does no harm.
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

    /// How much is backed at a time.
    [[nodiscard]] std::size_t step() const noexcept;
    /// Readies addresses for use: huge pages where they are private, and where they are a file's
    /// the blocks for them, for a write into a full file system cannot fail, only end the process.
    /// Throws CapacityExceeded; nothing is changed then.
    void back(Offset from, Offset to) const;
    /// Gives their memory to the system; they read as zeros, and a file's must be backed before
    /// they are written to. False: the system does not take it.
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
