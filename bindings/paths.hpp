// Names of the frames on the paths of answers.
#pragma once

#include <nanobind/nanobind.h>

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "tfdb/store/buffer.hpp"

namespace nb = nanobind;

namespace tfdb::python {

/// The tuple (child, parent, child, parent, ...) of an answer's edges. It keeps the answer's report
/// correct after frames are removed and the store is freed. Answers over the same path share it.
/// Threads: the holder of the GIL; without a GIL, any, and nothing is shared.
/// Guarantee: the names are the frames' names in the state of the answer.
class PathNames {
public:
    PathNames() = default;
    PathNames(const PathNames&) = delete;
    PathNames& operator=(const PathNames&) = delete;

    /// The tuple if it is cached; a borrowed reference.
    [[nodiscard]] PyObject* find(std::span<const EdgeUse> edges) const {
#ifdef Py_GIL_DISABLED
        static_cast<void>(edges);
        return nullptr;
#else
        const Entry& entry = entries_[slot(edges)];
        bool same = entry.frames.size() == edges.size();
        for (std::size_t i = 0; same && i < edges.size(); ++i) {
            same = entry.frames[i] == Frames(edges[i]);
        }
        return same ? entry.names.ptr() : nullptr;
#endif
    }
    /// Creates and caches it. Empty if a frame's slot was reused since: look up again. May run
    /// Python code; other lookups must not write to `edges`.
    [[nodiscard]] nb::object make(const StoreReader& reads, std::span<const EdgeUse> edges);

private:
    struct Frames {
        explicit Frames(const EdgeUse& edge)
            : child{edge.child, edge.generation}, parent{edge.parent, edge.parent_generation} {}
        bool operator==(const Frames& other) const {
            return child.id == other.child.id && child.generation == other.child.generation &&
                   parent.id == other.parent.id && parent.generation == other.parent.generation;
        }
        FrameHandle child;
        FrameHandle parent;
    };
    struct Entry {
        std::vector<Frames> frames;
        nb::object names;
    };
    static constexpr std::size_t kEntries = 64;

    static std::size_t slot(std::span<const EdgeUse> edges) {
        return edges.empty() ? 0 : (edges.front().child + 31 * edges.back().child) % kEntries;
    }

    std::array<Entry, kEntries> entries_{};
};

}  // namespace tfdb::python
