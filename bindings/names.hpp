// Maps frame names to handles, cached by the str object.
#pragma once

#include <nanobind/nanobind.h>

#include <array>
#include <cstddef>
#include <cstdint>

#include "arguments.hpp"
#include "tfdb/store/buffer.hpp"

namespace tfdb::python {

#ifdef Py_GIL_DISABLED

/// Without the GIL names are not cached: a cache would need a lock in each read.
class NameCache {
public:
    FrameRef find(PyObject* name, const char* role) { return {.name = name_of(name, role)}; }
    void remember(PyObject*, FrameHandle) {}
};

#else

/// A direct-mapped cache of handles by the address of the str. It keeps the str alive, so the
/// address keeps its meaning.
/// Threads: the holder of the GIL.
/// Guarantee: a handle may be outdated; the question that uses it reports that.
class NameCache {
public:
    NameCache() = default;
    NameCache(const NameCache&) = delete;
    NameCache& operator=(const NameCache&) = delete;
    ~NameCache() {
        for (Entry& entry : entries_) {
            Py_XDECREF(entry.name);
        }
    }

    /// Uses only the handle if there is one; the name is then not read.
    FrameRef find(PyObject* name, const char* role) {
        const Entry& entry = entries_[slot(name)];
        if (entry.name == name) {
            return {.handle = entry.handle};
        }
        return {.name = name_of(name, role)};
    }

    void remember(PyObject* name, FrameHandle handle) {
        Entry& entry = entries_[slot(name)];
        if (handle.id == kNoFrame || (entry.name == name && entry.handle == handle) ||
            !PyUnicode_CheckExact(name)) {
            return;
        }
        PyObject* const before = entry.name;
        entry = {Py_NewRef(name), handle};
        Py_XDECREF(before);
    }

private:
    static constexpr std::size_t kEntries = 256;
    struct Entry {
        PyObject* name = nullptr;
        FrameHandle handle;
    };

    static std::size_t slot(PyObject* name) {
        const auto address = reinterpret_cast<std::uintptr_t>(name);
        return ((address >> 4) ^ (address >> 12)) % kEntries;  // objects are 16 bytes apart
    }

    std::array<Entry, kEntries> entries_{};
};

#endif

}  // namespace tfdb::python
