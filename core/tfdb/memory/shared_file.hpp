// The files of a store that processes share: made whole, found by name, refused when they are not.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "tfdb/memory/control.hpp"
#include "tfdb/memory/mapping.hpp"

namespace tfdb::memory {

/// An open store that lies in a file: its data, and the control file beside it.
/// Threads: a value. Guarantee: none.
struct SharedFile {
    static constexpr std::int64_t kLockTimeoutNs = 10'000'000'000;

    Mapping data;
    std::unique_ptr<Control> control;  // null: frozen, or this process may not write even there
    std::string path;
    bool writable = false;
    bool frozen = false;                            // it has no writers: see frozen_file.hpp
    std::int64_t lock_timeout_ns = kLockTimeoutNs;  // how long writers here wait for others
};

/// Opens the store at a path. `layout`: what the data must look like for this program.
/// Throws NoSuchStore, CorruptStore (no store, or of another version or machine), ReadOnly (no
/// permission), CapacityExceeded.
SharedFile open_shared(const std::string& given, bool writable, std::uint64_t layout);

/// A new store under way. Others find it from `publish` on, whole or not at all. Otherwise nothing
/// of it remains; if its maker was killed, the next process that makes it removes the rest.
/// Threads: one. Guarantee: as the file system's.
class NewSharedFile {
public:
    /// `mode`: permissions of both files; `group`: of their group, or -1 for that of the process.
    /// Throws StoreExists, NoSuchStore (no such folder), ReadOnly, CapacityExceeded.
    NewSharedFile(std::string path, std::size_t bytes, unsigned mode, std::int64_t group);
    ~NewSharedFile();
    NewSharedFile(const NewSharedFile&) = delete;
    NewSharedFile& operator=(const NewSharedFile&) = delete;
    NewSharedFile(NewSharedFile&&) = delete;
    NewSharedFile& operator=(NewSharedFile&&) = delete;

    /// The data, to be filled; once.
    [[nodiscard]] Mapping map() const;
    void publish(std::uint64_t layout);

private:
    [[nodiscard]] int open_new(const std::string& name, std::size_t bytes) const;
    [[nodiscard]] bool begin();

    std::string path_;
    std::uint64_t id_ = 0;
    std::string data_;     // its name until it is published
    std::string control_;  // its name
    std::size_t bytes_;
    unsigned mode_;
    std::int64_t group_;
    int made_ = -1;  // the control file, locked: its maker is at work
    bool published_ = false;
};

/// Removes a store's files; processes that have it open go on. Throws NoSuchStore, CorruptStore (it
/// is none), ReadOnly.
void unlink_shared(const std::string& path);

}  // namespace tfdb::memory
