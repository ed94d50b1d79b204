// From Python objects to transforms, and from transforms to a commit.
#pragma once

#include <nanobind/nanobind.h>

#include <span>
#include <string_view>
#include <vector>

#include "reads.hpp"
#include "tfdb/store/buffer.hpp"

namespace nb = nanobind;

namespace tfdb::python {

/// Commits with the GIL held if no other writer is at it, else waits without the GIL.
CommitNumber commit_transforms(BufferObject& buffer, std::span<const TransformView> batch,
                               bool is_static, std::string_view authority);

/// Transforms read from Python objects; the views in `views` stay valid while it lives.
class Transforms {
public:
    /// A sequence of TransformStamped and of messages like it. Throws with `index`.
    static Transforms from_objects(nb::handle batch);
    /// A tfdb.Columns. Throws InvalidArray; errors of one row have its `index`.
    static Transforms from_columns(nb::handle columns, bool is_static);

    std::vector<TransformView> views;

private:
    std::string_view keep_name(nb::object name, const char* role);
    void read_object(PyObject* item);
    void read_message(PyObject* item, nb::object child);

    std::vector<nb::object> kept_;
};

}  // namespace tfdb::python
