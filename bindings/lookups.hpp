// Lookups for other bindings: they create no Python objects and report no reason for a failure.
#pragma once

#include <nanobind/nanobind.h>

#include <optional>

#include "tfdb/store/question.hpp"

namespace nb = nanobind;

namespace tfdb::python {

struct Found {
    geometry::Pose pose;
    StampNs stamp = 0;
};

/// T[target<-source] of a Buffer at a stamp (none: the latest common time); names are exact str.
/// Empty without an answer. Throws the errors of a read of a buffer.
std::optional<Found> find_pose(PyObject* buffer, PyObject* target, PyObject* source,
                               std::optional<StampNs> stamp);

/// Whether it has an answer.
bool can_find_pose(PyObject* buffer, PyObject* target, PyObject* source,
                   std::optional<StampNs> stamp);

}  // namespace tfdb::python
