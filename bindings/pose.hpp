// Translations and rotations from Python objects.
#pragma once

#include <nanobind/nanobind.h>

#include "tfdb/geometry/pose.hpp"

namespace nb = nanobind;

namespace tfdb::python {

/// Three numbers: a tuple, list or array, or an object with x, y, z. Throws InvalidArray.
geometry::Vec3 vector_of(PyObject* object, const char* role);

/// Four numbers x, y, z, w: a tuple, list or array, or an object with x, y, z, w.
geometry::Quat quaternion_of(PyObject* object, const char* role);

}  // namespace tfdb::python
