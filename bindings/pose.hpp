// Translations and rotations from Python objects.
#pragma once

#include <nanobind/nanobind.h>

#include "arguments.hpp"
#include "tfdb/geometry/pose.hpp"

namespace nb = nanobind;

namespace tfdb::python {

/// Three numbers: a tuple, list or array, or an object with x, y, z. Throws InvalidArray.
geometry::Vec3 vector_of(PyObject* object, const char* role);

/// Four numbers x, y, z, w: a tuple, list or array, or an object with x, y, z, w, or with
/// as_quat().
geometry::Quat quaternion_of(PyObject* object, const char* role);

/// A pose as arguments; null or None: not given.
struct PoseArguments {
    PyObject* translation;
    PyObject* rotation;
    PyObject* rpy = nullptr;
    PyObject* wxyz = nullptr;
    PyObject* target = nullptr;  // of the edge, to compare with those of a Transform
    PyObject* source = nullptr;

    [[nodiscard]] bool plain() const {
        return is_given(rotation) && !is_given(rpy) && !is_given(wxyz);
    }
};

/// What is not plain: a rotation in another form or none, or all of the pose in `translation`.
geometry::Pose other_pose_of(const PoseArguments& given);

/// Throws InvalidArray, InvalidTransform, InvalidArgument.
inline geometry::Pose pose_of(const PoseArguments& given) {
    if (given.plain()) [[likely]] {
        return {vector_of(given.translation, "translation"),
                quaternion_of(given.rotation, "rotation")};
    }
    return other_pose_of(given);
}

/// Throws InvalidArray, InvalidTransform.
geometry::Pose pose_of_matrix(PyObject* matrix);

/// ((x, y, z), (x, y, z, w)) where a rotation is given, or a whole pose; else None.
/// Throws InvalidArray, InvalidTransform, InvalidArgument.
nb::object pose_parts(nb::handle parent, nb::handle child, nb::handle translation, nb::handle rpy,
                      nb::handle wxyz);

/// (N, 7) of (N, 4, 4), NaN of NaN if they may be missing. Throws InvalidArray, InvalidTransform
/// with `index`.
nb::object poses_of_matrices(nb::handle matrices, bool missing);

}  // namespace tfdb::python
