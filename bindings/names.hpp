// From frame names to handles, remembered by the str object.
#pragma once

#include <nanobind/nanobind.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string_view>

#include "arguments.hpp"
#include "tfdb/store/buffer.hpp"

namespace tfdb::python {

/// The handle of a frame by its name; one that no lookup accepts if there is no such frame.
inline FrameHandle handle_of(const Reads& reads, std::string_view name, bool may_wait) {
    FrameHandle handle;
    std::optional<nb::gil_scoped_release> released;
    if (may_wait) [[unlikely]] {
        released.emplace();
    }
    if (!reads.find_frame(name, handle)) {
        return {};
    }
    return handle;
}

#ifdef Py_GIL_DISABLED

/// Without the GIL every name is resolved anew: a cache would need a lock on the way of each read.
class NameCache {
public:
    FrameHandle find(const Reads& reads, PyObject* name, const char* role, bool may_wait) {
        return handle_of(reads, name_of(name, role), may_wait);
    }
    FrameHandle renew(const Reads& reads, PyObject* name, const char* role, bool may_wait) {
        return find(reads, name, role, may_wait);
    }
    static constexpr bool kRemembers = false;
};

#else

/// A direct-mapped cache of handles by the address of the str, which it keeps alive, so that an
/// address never comes to mean another name. Threads: whoever has the GIL.
/// Guarantee: a handle may be out of date; the lookup that takes it says so, then `renew`.
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

    FrameHandle find(const Reads& reads, PyObject* name, const char* role, bool may_wait) {
        const Entry& entry = entries_[slot(name)];
        return entry.name == name ? entry.handle : renew(reads, name, role, may_wait);
    }

    FrameHandle renew(const Reads& reads, PyObject* name, const char* role, bool may_wait) {
        const FrameHandle handle = handle_of(reads, name_of(name, role), may_wait);
        if (handle.id != kNoFrame && PyUnicode_CheckExact(name)) {
            Entry& entry = entries_[slot(name)];
            PyObject* const before = entry.name;
            entry = {Py_NewRef(name), handle};
            Py_XDECREF(before);
        }
        return handle;
    }
    static constexpr bool kRemembers = true;

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
