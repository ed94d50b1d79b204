// From frame names to handles, remembered by the str object.
#pragma once

#include <nanobind/nanobind.h>

#include <array>
#include <cstddef>
#include <cstdint>

#include "arguments.hpp"
#include "tfdb/store/buffer.hpp"

namespace tfdb::python {

#ifdef Py_GIL_DISABLED

/// Without the GIL every name is looked up anew: a cache would need a lock on the way of each read.
class NameCache {
public:
    FrameRef find(PyObject* name, const char* role) { return {.name = name_of(name, role)}; }
    void remember(PyObject*, FrameHandle) {}
};

#else

/// A direct-mapped cache of handles by the address of the str, which it keeps alive, so that an
/// address never comes to mean another name. Threads: the holder of the GIL.
/// Guarantee: a handle may be out of date; the question that takes it reports that.
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

    /// By the handle alone where there is one: then the name need not be looked at.
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
