#include "pose.hpp"

#include <array>
#include <cstddef>
#include <cstring>
#include <string>

#include "arrays.hpp"
#include "errors.hpp"
#include "fields.hpp"

namespace tfdb::python {
namespace {

template <std::size_t N>
[[noreturn]] void refuse(PyObject* object, const char* role) {
    constexpr const char* kExpected = N == 3 ? "3 numbers (x, y, z)" : "4 numbers (x, y, z, w)";
    throw_bad_array(role, kExpected, short_repr(object));
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
bool read_array(PyObject* object, std::array<double, N>& out) {
    nb::object keep;
    std::optional<ArrayView> view = ArrayView::of(object, false);
    if (!view || view->dimensions() != 1 || view->extent(0) != N) {
        return false;
    }
    if (view->kind() == Kind::kFloat64) {
        for (std::size_t i = 0; i < N; ++i) {
            const auto step = static_cast<Py_ssize_t>(i) * view->stride(0);
            std::memcpy(&out[i], view->data<const char>() + step, sizeof(double));
        }
        return true;
    }
    const ArrayView converted = as_doubles(object, "array", keep);
    for (std::size_t i = 0; i < N; ++i) {
        out[i] = converted.data<const double>()[i];
    }
    return true;
}

template <std::size_t N>
bool read_fields(PyObject* object, std::array<double, N>& out) {
    const std::array<PyObject*, 4> names = {g_fields.x, g_fields.y, g_fields.z, g_fields.w};
    for (std::size_t i = 0; i < N; ++i) {
        const nb::object value = find(object, names[i]);
        if (!value.is_valid() || !read_number(value.ptr(), out[i])) {
            return false;
        }
    }
    return true;
}

template <std::size_t N>
std::array<double, N> numbers_of(PyObject* object, const char* role) {
    std::array<double, N> out{};
    bool read = false;
    if (PyTuple_CheckExact(object)) {
        read = read_tuple<N>(object, out);
    } else if (PyList_CheckExact(object)) {
        // __float__ of an item may change the list: read from a copy of its items.
        const nb::object items = nb::steal(PyList_AsTuple(object));
        read = items.is_valid() && read_tuple<N>(items.ptr(), out);
    } else if (PyObject_CheckBuffer(object) != 0) {
        read = read_array<N>(object, out);
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

}  // namespace

geometry::Vec3 vector_of(PyObject* object, const char* role) {
    const auto [x, y, z] = numbers_of<3>(object, role);
    return {x, y, z};
}

geometry::Quat quaternion_of(PyObject* object, const char* role) {
    const auto [x, y, z, w] = numbers_of<4>(object, role);
    return {x, y, z, w};
}

}  // namespace tfdb::python
