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
    PyObject* target = nullptr;  // of the edge, for a comparison with a Transform's frames
    PyObject* source = nullptr;

    [[nodiscard]] bool plain() const {
        return is_given(rotation) && !is_given(rpy) && !is_given(wxyz);
    }
};

/// The less common forms: a rotation in another form or none, or the whole pose in `translation`.
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

/// ((x, y, z), (x, y, z, w)) if a rotation or a whole pose is given; otherwise None.
/// Throws InvalidArray, InvalidTransform, InvalidArgument.
nb::object pose_parts(nb::handle parent, nb::handle child, nb::handle translation, nb::handle rpy,
                      nb::handle wxyz);

/// (N, 7) from (N, 4, 4); NaN stays NaN if poses may be missing. Throws InvalidArray,
/// InvalidTransform
/// with `index`.
nb::object poses_of_matrices(nb::handle matrices, bool missing);

}  // namespace tfdb::python
