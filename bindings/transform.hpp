// tfdb.Transform: the result of a lookup, a custom Python type that is cheap to create.
#pragma once

#include <nanobind/nanobind.h>

#include <span>

#include "tfdb/geometry/pose.hpp"
#include "tfdb/lookup/answer.hpp"

namespace nb = nanobind;

namespace tfdb::python {

using geometry::Pose;
using lookup::Answer;
using lookup::EdgeUse;

/// The object: a fixed part, then `ob_size` EdgeUse records.
/// Threads: immutable, any. Guarantee: it refers only to text, so it outlives its store and is in
/// no reference cycle.
struct TransformObject {
    PyObject_VAR_HEAD Pose pose;
    clock::StampNs stamp;
    CommitNumber commit;
    PyObject* target;
    PyObject* source;
    PyObject* names;  // of the edges: (child, parent, child, parent, ...); null without edges

    [[nodiscard]] std::span<EdgeUse> edges() {
        const Py_ssize_t count = Py_SIZE(reinterpret_cast<PyObject*>(this));
        return {reinterpret_cast<EdgeUse*>(this + 1), static_cast<std::size_t>(count)};
    }
};
static_assert(sizeof(TransformObject) % alignof(EdgeUse) == 0);

/// Adds the type to the module.
void bind_transform(nb::module_& module);

/// A new reference; null with MemoryError. It takes new references to the three objects. `names`
/// holds two exact str per edge; null without edges.
PyObject* new_transform(const Pose& pose, clock::StampNs stamp, CommitNumber commit,
                        std::span<const EdgeUse> edges, PyObject* target, PyObject* source,
                        PyObject* names);

inline PyObject* new_transform(const Answer& answer, PyObject* target, PyObject* source,
                               PyObject* names) {
    return new_transform(answer.pose, answer.stamp, answer.commit, answer.edges, target, source,
                         names);
}

/// The computing methods: inverse(), @, apply().
PyObject* transform_inverse(PyObject* self);
PyObject* transform_multiply(PyObject* left, PyObject* right);
PyObject* transform_apply(PyObject* self, PyObject* points);

bool is_transform(PyObject* object);

}  // namespace tfdb::python
