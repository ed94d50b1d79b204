#include "paths.hpp"

#include <string>
#include <utility>

#include "errors.hpp"

namespace tfdb::python {
namespace {

/// Empty if the slot was reused since.
nb::object name_of_frame(const StoreReader& reads, FrameHandle frame) {
    const std::string name = reads.frame_name(frame.id, frame.generation);
    if (!reads.is_current(frame)) {
        return {};
    }
    return str_of_name(name);
}

}  // namespace

nb::object PathNames::make(const StoreReader& reads, std::span<const EdgeUse> edges) {
    nb::list names;
    std::vector<Frames> frames;
    frames.reserve(edges.size());
    for (const EdgeUse& edge : edges) {
        const Frames& both = frames.emplace_back(edge);
        for (const FrameHandle frame : {both.child, both.parent}) {
            const nb::object name = name_of_frame(reads, frame);
            if (!name.is_valid()) {
                return {};
            }
            names.append(name);
        }
    }
    nb::object made = nb::tuple(names);
#ifndef Py_GIL_DISABLED
    Entry& entry = entries_[slot(edges)];
    entry.frames = std::move(frames);
    std::swap(entry.names, made);
    return entry.names;
#else
    return made;
#endif
}

}  // namespace tfdb::python
