// tfdb.Transform: the result of a lookup, a Python type of our own so that making one is cheap.
#pragma once

#include <nanobind/nanobind.h>

#include <span>
#include <string>

#include "tfdb/geometry/pose.hpp"
#include "tfdb/lookup/answer.hpp"

namespace nb = nanobind;

namespace tfdb::python {

using geometry::Pose;
using lookup::Answer;
using lookup::EdgeUse;

/// The object: fixed part, then `ob_size` EdgeUse records.
/// Threads: immutable, any. Guarantee: names of edges are looked up only when `report` is read.
struct TransformObject {
    PyObject_VAR_HEAD Pose pose;
    clock::StampNs stamp;
    CommitNumber commit;
    PyObject* target;
    PyObject* source;
    PyObject* origin;  // the Buffer that knows the edges' names; or a tuple of rows; or None

    [[nodiscard]] std::span<EdgeUse> edges() {
        return {reinterpret_cast<EdgeUse*>(this + 1), static_cast<std::size_t>(Py_SIZE(this))};
    }
};
static_assert(sizeof(TransformObject) % alignof(EdgeUse) == 0);

/// Adds the type to the module.
void bind_transform(nb::module_& module);

/// A new reference; null with MemoryError. Takes new references to the three objects.
PyObject* new_transform(const Pose& pose, clock::StampNs stamp, CommitNumber commit,
                        std::span<const EdgeUse> edges, PyObject* target, PyObject* source,
                        PyObject* origin);

inline PyObject* new_transform(const Answer& answer, PyObject* target, PyObject* source,
                               PyObject* buffer) {
    return new_transform(answer.pose, answer.stamp, answer.commit, answer.edges, target, source,
                         buffer);
}

/// The methods that compute: inverse(), @, apply().
PyObject* transform_inverse(PyObject* self, PyObject* unused);
PyObject* transform_multiply(PyObject* left, PyObject* right);
PyObject* transform_apply(PyObject* self, PyObject* points);

bool is_transform(PyObject* object);

/// What a report says of one edge: (child, parent, used, before, after, inverted).
nb::tuple edge_row(const EdgeUse& edge, const std::string& child, const std::string& parent);
/// One row for each edge.
nb::tuple edge_rows(TransformObject& self);

}  // namespace tfdb::python
