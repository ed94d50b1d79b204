#include "pose.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <cstring>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>

#include "arrays.hpp"
#include "errors.hpp"
#include "fields.hpp"
#include "tfdb/geometry/from_matrix.hpp"
#include "transform.hpp"

namespace tfdb::python {
namespace {

template <std::size_t N>
[[noreturn]] void refuse(PyObject* object, const char* role) {
    constexpr const char* kExpected = N == 3   ? "3 numbers (x, y, z)"
                                      : N == 4 ? "4 numbers (x, y, z, w)"
                                               : "7 numbers (x, y, z, qx, qy, qz, qw)";
    std::string expected = kExpected;
    if (std::string_view(role) == "wxyz") {
        expected = "4 numbers (w, x, y, z)";
    } else if (std::string_view(role) == "translation") {
        expected += ", or a whole pose without a rotation beside it";
    }
    throw_bad_array(role, expected, short_repr(object));
}

bool read_number(PyObject* object, double& out) {
    out = PyFloat_AsDouble(object);
    if (out == -1.0 && PyErr_Occurred() != nullptr) {
        forget_error();
        return false;
    }
    return true;
}

template <std::size_t N>
bool read_tuple(PyObject* items, std::array<double, N>& out) {
    if (NB_TUPLE_GET_SIZE(items) != N) {
        return false;
    }
    for (std::size_t i = 0; i < N; ++i) {
        if (!read_number(NB_TUPLE_GET_ITEM(items, static_cast<Py_ssize_t>(i)), out[i])) {
            return false;
        }
    }
    return true;
}

template <std::size_t N>
bool read_array(PyObject* object, const char* role, std::array<double, N>& out) {
    nb::object keep;
    std::optional<ArrayView> view = ArrayView::of(object, false);
    if (!view || view->kind() != Kind::kFloat64) {
        view.emplace(as_doubles(object, role, keep));
    }
    if (view->dimensions() != 1 || view->extent(0) != N) {
        return false;
    }
    for (std::size_t i = 0; i < N; ++i) {
        const auto step = static_cast<Py_ssize_t>(i) * view->stride(0);
        std::memcpy(&out[i], view->data<const char>() + step, sizeof(double));
    }
    return true;
}

template <std::size_t N>
bool read_fields(PyObject* object, std::array<double, N>& out) {
    const std::array<PyObject*, 4> names = {g_fields.x, g_fields.y, g_fields.z, g_fields.w};
    if (N > names.size()) {
        return false;
    }
    for (std::size_t i = 0; i < N; ++i) {
        const nb::object value = find(object, names[i]);
        if (!value.is_valid() || !read_number(value.ptr(), out[i])) {
            return false;
        }
    }
    return true;
}

/// x, y, z, w of a scipy Rotation or a similar object; empty for other objects.
nb::object as_quat(PyObject* object) {
    const nb::object method = find(object, g_fields.as_quat);
    if (!method.is_valid()) {
        return {};
    }
    PyObject* const made = PyObject_CallNoArgs(method.ptr());
    if (made == nullptr) {
        forget_error();
        return nb::none();  // refused by its actual type
    }
    return nb::steal(made);
}

template <std::size_t N>
std::array<double, N> numbers_of(PyObject* object, const char* role) {
    std::array<double, N> out{};
    bool read = false;
    if (PyTuple_CheckExact(object)) {
        read = read_tuple<N>(object, out);
    } else if (PyList_CheckExact(object)) {
        // An item's __float__ may change the list, so a copy of its items is read.
        const nb::object items = nb::steal(PyList_AsTuple(object));
        read = items.is_valid() && read_tuple<N>(items.ptr(), out);
    } else if (PyObject_CheckBuffer(object) != 0) {
        read = read_array<N>(object, role, out);
    } else if (const nb::object turned = as_quat(object); turned.is_valid()) {
        read = N == 4 && read_array<N>(turned.ptr(), role, out);
    } else if (PySequence_Check(object) != 0 && !PyUnicode_Check(object)) {
        const nb::object items = nb::steal(PySequence_Tuple(object));
        if (!items.is_valid()) {
            throw nb::python_error();
        }
        read = read_tuple<N>(items.ptr(), out);
    } else {
        read = read_fields<N>(object, out);
    }
    if (!read) {
        refuse<N>(object, role);
    }
    return out;
}

using geometry::RigidFault;

std::string described(const RigidFault& fault, std::span<const double, 16> matrix) {
    std::array<char, 32> number{};
    std::snprintf(number.data(), number.size(), "%.6g", fault.amount);
    const std::string by(number.data());
    switch (fault.kind) {
        case RigidFault::kNotFinite:
            return "it contains " + by;
        case RigidFault::kLastRow:
            return "its last row must be 0 0 0 1, but differs by " + by +
                   (matrix[15] == 1.0 && matrix[3] == 0.0 && matrix[7] == 0.0 && matrix[11] == 0.0
                        ? "; transpose the matrix if it is in row-vector convention"
                        : "");
        case RigidFault::kReflection:
            return "its determinant is " + by + ", but must be 1: an axis is mirrored";
        case RigidFault::kScale:
            return "it scales by " + by + "; the scale must be 1";
        default:
            return "its axes are not orthogonal unit vectors: the error is " + by +
                   ", at most 0.005 is valid";
    }
}

Pose rigid_pose(const double* rows, std::optional<std::size_t> index) {
    const std::span<const double, 16> matrix(rows, 16);
    const RigidFault fault = geometry::rigid_fault(matrix);
    if (fault.kind == RigidFault::kNone) {
        return geometry::pose_of_matrix(matrix);
    }
    const std::string reason = described(fault, matrix);
    const std::string which = index ? "matrices[" + std::to_string(*index) + "]" : "matrix";
    throw_error("InvalidTransform", which + " is not a rigid transform: " + reason,
                {{"reason", nb::str(reason.c_str())},
                 {"index", index ? nb::object(nb::int_(*index)) : nb::none()}});
}

/// The lengths of an array's axes, up to two; for nested lists, according to their first members.
std::pair<Py_ssize_t, Py_ssize_t> shape_of(PyObject* object) {
    constexpr std::pair<Py_ssize_t, Py_ssize_t> kNone{-1, -1};
    if (PyTuple_CheckExact(object) || PyList_CheckExact(object)) {
        const Py_ssize_t length = PySequence_Size(object);
        if (length < 1) {
            return kNone;
        }
        const nb::object first = nb::steal(PySequence_GetItem(object, 0));
        if (!first.is_valid()) {
            throw nb::python_error();
        }
        const bool nested = PySequence_Check(first.ptr()) != 0 && !PyUnicode_Check(first.ptr());
        return {length, nested ? PySequence_Size(first.ptr()) : 0};
    }
    if (PyObject_CheckBuffer(object) == 0) {
        return kNone;
    }
    const std::optional<ArrayView> view = ArrayView::of(object, false);
    if (!view || view->dimensions() < 1 || view->dimensions() > 2) {
        return kNone;
    }
    return {static_cast<Py_ssize_t>(view->extent(0)),
            view->dimensions() == 1 ? 0 : static_cast<Py_ssize_t>(view->extent(1))};
}

/// Throws InvalidArgument if a pose's own frames differ from the given ones.
void check_frames(const PoseArguments& given, PyObject* target, PyObject* source,
                  const char* remedy) {
    const auto same = [](PyObject* a, PyObject* b) {
        return b == nullptr || nb::handle(a).equal(nb::handle(b));
    };
    if (same(target, given.target) && same(source, given.source)) {
        return;
    }
    throw_error("InvalidArgument",
                transform_name(target, source) + " was given for " +
                    transform_name(given.target, given.source) + remedy,
                {{"value", nb::borrow(given.translation)}});
}

Pose pose_of_transform(const PoseArguments& given) {
    const TransformObject& whole = *reinterpret_cast<TransformObject*>(given.translation);
    check_frames(given, whole.target, whole.source,
                 ": give its inverse() for the other direction, or its pose if the frames have "
                 "other names");
    return whole.pose;
}

/// The pose of an object that holds translation and rotation; empty for other objects.
std::optional<Pose> whole_pose_of(const PoseArguments& given) {
    PyObject* const object = given.translation;
    if (is_transform(object)) {
        return pose_of_transform(given);
    }
    const auto [rows, columns] = shape_of(object);
    if (rows == 7 && columns == 0) {
        const auto [x, y, z, qx, qy, qz, qw] = numbers_of<7>(object, "pose");
        return Pose{{x, y, z}, {qx, qy, qz, qw}};
    }
    if (columns > 0) {
        return pose_of_matrix(object);
    }
    if (rows >= 0) {
        return std::nullopt;
    }
    const nb::object translation = find(object, g_fields.translation);
    const nb::object rotation =
        translation.is_valid() ? find(object, g_fields.rotation) : nb::object();
    if (!rotation.is_valid()) {
        return std::nullopt;
    }
    const nb::object parent = find(object, g_fields.parent);
    const nb::object child = find(object, g_fields.child);
    if (parent.is_valid() && child.is_valid()) {  // a TransformStamped
        check_frames(given, parent.ptr(), child.ptr(),
                     ": give its translation and its rotation if the frames have other names");
    }
    return Pose{vector_of(translation.ptr(), "translation"),
                quaternion_of(rotation.ptr(), "rotation")};
}

geometry::Quat rotation_of(const PoseArguments& given) {
    if (is_given(given.rpy)) {
        return geometry::quaternion_of_rpy(vector_of(given.rpy, "rpy"));
    }
    if (is_given(given.wxyz)) {
        // An object with named or differently ordered parts is invalid for this argument.
        if (PySequence_Check(given.wxyz) == 0 || find(given.wxyz, g_fields.as_quat).is_valid()) {
            refuse<4>(given.wxyz, "wxyz");
        }
        const auto [w, x, y, z] = numbers_of<4>(given.wxyz, "wxyz");
        return {x, y, z, w};
    }
    return quaternion_of(given.rotation, "rotation");
}

}  // namespace

geometry::Pose other_pose_of(const PoseArguments& given) {
    const int rotations =
        int{is_given(given.rotation)} + int{is_given(given.rpy)} + int{is_given(given.wxyz)};
    if (rotations > 1) {
        throw_error("InvalidArgument",
                    "rotation (x, y, z, w), rpy (radians) and wxyz exclude each other; pass one",
                    {});
    }
    if (rotations == 1) {
        return {vector_of(given.translation, "translation"), rotation_of(given)};
    }
    if (const std::optional<Pose> whole = whole_pose_of(given)) {
        return *whole;
    }
    return {vector_of(given.translation, "translation"), geometry::identity().rotation};
}

geometry::Pose pose_of_matrix(PyObject* matrix) {
    nb::object keep;
    const ArrayView view = as_doubles(matrix, "matrix", keep);
    if (view.dimensions() != 2 || view.extent(0) != 4 || view.extent(1) != 4) {
        throw_bad_array("matrix", "an array (4, 4) of float64", describe(keep));
    }
    return rigid_pose(view.data<const double>(), std::nullopt);
}

nb::object pose_parts(nb::handle parent, nb::handle child, nb::handle translation, nb::handle rpy,
                      nb::handle wxyz) {
    const PoseArguments given{translation.ptr(), nullptr,      rpy.ptr(),
                              wxyz.ptr(),        parent.ptr(), child.ptr()};
    const bool turned = is_given(given.rpy) || is_given(given.wxyz);
    const std::optional<Pose> pose = turned ? other_pose_of(given) : whole_pose_of(given);
    if (!pose) {
        return nb::none();
    }
    const auto& [t, q] = *pose;
    return nb::make_tuple(nb::make_tuple(t.x, t.y, t.z), nb::make_tuple(q.x, q.y, q.z, q.w));
}

nb::object poses_of_matrices(nb::handle matrices, bool missing) {
    nb::object keep;
    const ArrayView view = as_doubles(matrices, "matrices", keep);
    if (view.dimensions() != 3 || view.extent(1) != 4 || view.extent(2) != 4) {
        throw_bad_array("matrices", "an array (N, 4, 4) of float64", describe(keep));
    }
    NewArray<double> made = new_doubles({view.extent(0), 7});
    for (std::size_t i = 0; i < view.extent(0); ++i) {
        look_for_signals(i);
        const double* const rows = view.data<const double>() + 16 * i;
        if (missing && std::all_of(rows, rows + 16, [](double each) { return std::isnan(each); })) {
            std::fill_n(made.data + 7 * i, 7, std::numeric_limits<double>::quiet_NaN());
            continue;
        }
        const Pose pose = rigid_pose(rows, i);
        std::memcpy(made.data + 7 * i, &pose, sizeof pose);
    }
    return std::move(made.array);
}

geometry::Vec3 vector_of(PyObject* object, const char* role) {
    const auto [x, y, z] = numbers_of<3>(object, role);
    return {x, y, z};
}

geometry::Quat quaternion_of(PyObject* object, const char* role) {
    const auto [x, y, z, w] = numbers_of<4>(object, role);
    return {x, y, z, w};
}

}  // namespace tfdb::python
