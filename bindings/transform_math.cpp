// The computing methods of Transform.
#include <algorithm>
#include <cstring>
#include <optional>
#include <string>
#include <vector>

#include "arrays.hpp"
#include "errors.hpp"
#include "tfdb/store/validate.hpp"
#include "transform.hpp"

namespace tfdb::python {
namespace {

TransformObject& as_transform(PyObject* object) {
    return *reinterpret_cast<TransformObject*>(object);
}

/// The older of two, where 0 means "at all times".
template <class T>
T older(T a, T b) {
    return a == 0 ? b : b == 0 ? a : std::min(a, b);
}

/// The store's error for a lookup whose result is not finite; `row`: index of the point.
[[noreturn]] void throw_not_finite(PyObject* target, PyObject* source, clock::StampNs stamp,
                                   std::optional<std::size_t> row = std::nullopt) {
    const std::string of_row = row ? " of points[" + std::to_string(*row) + "]" : std::string();
    throw_error("InvalidTransform",
                transform_name(target, source) + of_row +
                    " is not finite: the numbers are too large for floating point",
                {{"target", nb::borrow(target)},
                 {"source", nb::borrow(source)},
                 {"stamp", nb::int_(stamp)},
                 {"index", row ? nb::object(nb::int_(*row)) : nb::none()},
                 {"reason", nb::str("not finite")}});
}

bool is_finite(const geometry::Vec3& point) {
    return geometry::is_finite(Pose{point, {}});
}

template <class T>
nb::object apply_rows(TransformObject& transform, const ArrayView& points, NewArray<T> result) {
    const Pose& pose = transform.pose;
    const int last = points.dimensions() - 1;
    const std::size_t count = last == 0 ? 1 : points.extent(0);
    const Py_ssize_t row = last == 0 ? 0 : points.stride(0);
    const Py_ssize_t column = points.stride(last);
    const char* from = points.data<const char>();
    T* out = result.data;
    for (std::size_t i = 0; i < count; ++i, from += row, out += 3) {
        const auto at = [&](int axis) {
            T value;
            std::memcpy(&value, from + axis * column, sizeof value);  // may be unaligned
            return static_cast<double>(value);
        };
        const geometry::Vec3 point{at(0), at(1), at(2)};
        const geometry::Vec3 moved = geometry::apply(pose, point);
        out[0] = static_cast<T>(moved.x);
        out[1] = static_cast<T>(moved.y);
        out[2] = static_cast<T>(moved.z);
        if (!is_finite({out[0], out[1], out[2]}) && is_finite(point)) {
            throw_not_finite(transform.target, transform.source, transform.stamp, i);
        }
    }
    return std::move(result.array);
}

/// The names of the edges in reverse order.
nb::object reversed_names(PyObject* names) {
    nb::list pairs;
    for (Py_ssize_t i = names == nullptr ? 0 : NB_TUPLE_GET_SIZE(names); i > 0; i -= 2) {
        pairs.append(nb::handle(NB_TUPLE_GET_ITEM(names, i - 2)));
        pairs.append(nb::handle(NB_TUPLE_GET_ITEM(names, i - 1)));
    }
    return nb::tuple(pairs);
}

/// For `T @ other` if `other` is not a transform.
PyObject* no_chain(PyObject* other) {
    const bool numbers =
        PyList_Check(other) != 0 || PyTuple_Check(other) != 0 || nb::hasattr(other, "__array__");
    if (!numbers || nb::hasattr(other, "target")) {  // a Trajectory has frames, too
        Py_RETURN_NOTIMPLEMENTED;                    // it may implement the operation
    }
    PyErr_Format(PyExc_TypeError,
                 "'@' chains two transforms, got a %s: T.apply(points) maps points, "
                 "T.matrix @ array multiplies numbers",
                 type_name_of(other).c_str());
    return nullptr;
}

}  // namespace

PyObject* transform_inverse(PyObject* self) {
    return guarded([&]() -> PyObject* {
        TransformObject& from = as_transform(self);
        std::vector<EdgeUse> edges(from.edges().rbegin(), from.edges().rend());
        for (EdgeUse& edge : edges) {
            edge.inverted = !edge.inverted;
        }
        const Pose inverse = geometry::inverse(from.pose);
        if (!geometry::is_finite(inverse)) {
            throw_not_finite(from.source, from.target, from.stamp);
        }
        return new_transform(inverse, from.stamp, from.commit, edges, from.source, from.target,
                             reversed_names(from.names).ptr());
    });
}

PyObject* transform_multiply(PyObject* left, PyObject* right) {
    if (!is_transform(left) || !is_transform(right)) {
        return no_chain(is_transform(left) ? right : left);
    }
    return guarded([&]() -> PyObject* {
        TransformObject& a = as_transform(left);
        TransformObject& b = as_transform(right);
        const int equal = PyObject_RichCompareBool(a.source, b.target, Py_EQ);
        if (equal < 0) {
            return nullptr;
        }
        if (equal == 0) {
            throw_error(
                "InvalidArgument",
                transform_name(a.target, a.source) + " @ " + transform_name(b.target, b.source) +
                    " do not chain: the first maps from " + store::quoted(text_of(a.source)) +
                    ", the second into " + store::quoted(text_of(b.target)),
                {{"source", nb::borrow(a.source)}, {"target", nb::borrow(b.target)}});
        }
        const Pose product = geometry::compose(a.pose, b.pose);
        const clock::StampNs stamp = older(a.stamp, b.stamp);
        if (!geometry::is_finite(product)) {
            throw_not_finite(a.target, b.source, stamp);
        }
        return new_transform(product, stamp, older(a.commit, b.commit), {}, a.target, b.source,
                             nullptr);
    });
}

PyObject* transform_apply(PyObject* self, PyObject* points) {
    return guarded([&]() -> PyObject* {
        nb::object keep;
        std::optional<ArrayView> view = ArrayView::of(points, false);
        if (!view || (view->kind() != Kind::kFloat32 && view->kind() != Kind::kFloat64)) {
            view.emplace(as_doubles(points, "points", keep));
        }
        const int axes = view->dimensions();
        if (axes < 1 || axes > 2 || view->extent(axes - 1) != 3) {
            throw_bad_array("points", "an array (3,) or (N, 3)", view->describe());
        }
        TransformObject& transform = as_transform(self);
        const std::size_t count = view->extent(0);
        nb::object moved;
        if (view->kind() == Kind::kFloat32) {
            moved =
                apply_rows(transform, *view, axes == 1 ? new_floats({3}) : new_floats({count, 3}));
        } else {
            moved = apply_rows(transform, *view,
                               axes == 1 ? new_doubles({3}) : new_doubles({count, 3}));
        }
        return moved.release().ptr();
    });
}

}  // namespace tfdb::python
