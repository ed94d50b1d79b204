// The files of a store shared by processes: created completely, found by name, verified on opening.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "tfdb/memory/control.hpp"
#include "tfdb/memory/mapping.hpp"

namespace tfdb::memory {

/// An open store in a file: its data, and the control file beside it.
/// Threads: a value. Guarantee: none.
struct SharedFile {
    static constexpr std::int64_t kLockTimeoutNs = 10'000'000'000;

    Mapping data;
    // null: frozen, or this process may not write even to the control file
    std::unique_ptr<Control> control;
    std::string path;
    bool writable = false;
    bool frozen = false;  // read-only for all processes: see frozen_file.hpp
    // how long this process's writers wait for other processes
    std::int64_t lock_timeout_ns = kLockTimeoutNs;
};

/// Opens the store at a path. `layout`: the data layout that this program requires.
/// Throws NoSuchStore, CorruptStore (no store, or of another version or machine), ReadOnly (no
/// permission), CapacityExceeded.
SharedFile open_shared(const std::string& given, bool writable, std::uint64_t layout);

/// A store being created. Others find it after `publish`, complete or not at all. Without `publish`
/// nothing remains; if its creator is killed, the next process that creates it removes the
/// leftovers.
/// Threads: one. Guarantee: that of the file system.
class NewSharedFile {
public:
    /// `mode`: permissions of both files; `group`: their group, or -1 for the process's group.
    /// Throws StoreExists, NoSuchStore (no such folder), ReadOnly, CapacityExceeded.
    NewSharedFile(std::string path, std::size_t bytes, unsigned mode, std::int64_t group);
    ~NewSharedFile();
    NewSharedFile(const NewSharedFile&) = delete;
    NewSharedFile& operator=(const NewSharedFile&) = delete;
    NewSharedFile(NewSharedFile&&) = delete;
    NewSharedFile& operator=(NewSharedFile&&) = delete;

    /// The mapping of the data, for filling; call once.
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
    int made_ = -1;  // the control file, locked while its creator works
    bool published_ = false;
};

/// Removes a store's files; processes that have it open keep working. Throws NoSuchStore,
/// CorruptStore (not a store), ReadOnly.
void unlink_shared(const std::string& path);

}  // namespace tfdb::memory
