#include "writes.hpp"

#include <array>
#include <cstring>
#include <string>

#include "arguments.hpp"
#include "arrays.hpp"
#include "errors.hpp"
#include "fields.hpp"
#include "pose.hpp"
#include "stamp.hpp"

namespace tfdb::python {
namespace {

/// Above this a commit takes longer than handing the GIL over and back.
constexpr std::size_t kReleaseFrom = 1024;

constexpr std::array kSetNames = {"parent",      "child",    "stamp",
                                  "translation", "rotation", "authority"};

std::string_view authority_of(PyObject* authority) {
    return authority == nullptr ? std::string_view() : name_of(authority, "authority");
}

BufferObject& buffer_of(PyObject* self) {
    return static_cast<BufferObject&>(reads_of(self));
}

PyObject* set_transform(PyObject* self, PyObject* const* args, Py_ssize_t count,
                        PyObject* keywords) {
    return guarded([&]() -> PyObject* {
        constexpr ParameterList kList{"set_transform", kSetNames, 5, 5};
        const auto [parent, child, stamp, translation, rotation, authority] =
            bind<6>(kList, args, count, keywords);
        TransformView view;
        view.parent = name_of(parent, "parent");
        view.child = name_of(child, "child");
        view.stamp = stamp_of(stamp);
        view.pose = {vector_of(translation, "translation"), quaternion_of(rotation, "rotation")};
        return PyLong_FromUnsignedLongLong(
            commit_transforms(buffer_of(self), {&view, 1}, false, authority_of(authority)));
    });
}

PyMethodDef g_set_transform = {
    "set_transform", as_function(set_transform), METH_FASTCALL | METH_KEYWORDS,
    "set_transform($self, parent, child, stamp, translation, rotation, *, authority='')\n--\n\n"
    "Store where `child` was in `parent` at a stamp: T[parent<-child].\n\n"
    "Parameters\n----------\n"
    "parent, child\n    Frame names; new ones become frames.\n"
    "stamp\n    Nanoseconds (or an object that holds a stamp).\n"
    "translation\n    Metres, x y z: a sequence, an array, or an object with x, y, z.\n"
    "rotation\n    Unit quaternion, x y z w, likewise. Normalised if slightly off.\n"
    "authority\n    Who writes.\n\n"
    "Returns\n-------\nint\n    Number of the commit.\n\n"
    "Raises\n------\nInvalidName, InvalidStamp, InvalidArray, InvalidTransform, TooOld,\n"
    "StaticConflict, CycleError, CapacityExceeded. Then nothing was stored."};

/// (N, width) of float64, side by side.
ArrayView matrix_of(const nb::object& object, std::size_t width, const char* role,
                    nb::object& keep) {
    ArrayView view = as_doubles(object, role, keep);
    if (view.dimensions() != 2 || view.extent(1) != width) {
        throw_bad_array(role, "an array (N, " + std::to_string(width) + ") of float64",
                        describe(object));
    }
    return view;
}

void check_rows(std::size_t rows, std::size_t expected, const char* role) {
    if (rows != expected) {
        throw_bad_array(role, std::to_string(expected) + " rows, one for each transform",
                        std::to_string(rows));
    }
}

void read_poses(nb::handle columns, std::vector<TransformView>& views) {
    nb::object keep;
    const ArrayView poses = matrix_of(nb::object(columns.attr("poses")), 7, "poses", keep);
    check_rows(poses.extent(0), views.size(), "poses");
    const auto* from = poses.data<const double>();
    for (TransformView& view : views) {
        std::memcpy(&view.pose, from, sizeof view.pose);
        from += 7;
    }
}

}  // namespace

CommitNumber commit_transforms(BufferObject& buffer, std::span<const TransformView> batch,
                               bool is_static, std::string_view authority) {
    CommitNumber commit = 0;
    if (batch.size() < kReleaseFrom &&
        buffer.store.try_set_transforms(batch, is_static, authority, commit)) {
        return commit;
    }
    const nb::gil_scoped_release released;
    return buffer.store.set_transforms(batch, is_static, authority);
}

std::string_view Transforms::keep_name(nb::object name, const char* role) {
    const std::string_view bytes = name_of(name, role);
    kept_.push_back(std::move(name));
    return bytes;
}

void Transforms::read_message(PyObject* item, nb::object child) {
    const nb::object header = get(item, g_fields.header);
    const nb::object transform = get(item, g_fields.transform);
    const auto part = [&](PyObject* name) { return get(transform.ptr(), name); };
    TransformView view;
    view.parent = keep_name(get(header.ptr(), g_fields.frame_id), "header.frame_id");
    view.child = keep_name(std::move(child), "child_frame_id");
    view.stamp = stamp_of(get(header.ptr(), g_fields.stamp).ptr());
    view.pose = {vector_of(part(g_fields.translation).ptr(), "transform.translation"),
                 quaternion_of(part(g_fields.rotation).ptr(), "transform.rotation")};
    views.push_back(view);
}

void Transforms::read_object(PyObject* item) {
    nb::object child = find(item, g_fields.child);
    if (!child.is_valid()) {
        child = find(item, g_fields.child_frame_id);
        if (child.is_valid()) {
            read_message(item, std::move(child));
            return;
        }
        PyErr_Format(PyExc_TypeError,
                     "transforms must be tfdb.TransformStamped, or messages with header, "
                     "child_frame_id and transform; item %zu is of type %s",
                     views.size(), Py_TYPE(item)->tp_name);
        throw nb::python_error();
    }
    TransformView view;
    view.parent = keep_name(get(item, g_fields.parent), "parent");
    view.child = keep_name(std::move(child), "child");
    view.stamp = stamp_of(get(item, g_fields.stamp).ptr());
    view.pose = {vector_of(get(item, g_fields.translation).ptr(), "translation"),
                 quaternion_of(get(item, g_fields.rotation).ptr(), "rotation")};
    views.push_back(view);
}

Transforms Transforms::from_objects(nb::handle batch) {
    const nb::object items = nb::steal(PySequence_Tuple(batch.ptr()));
    if (!items.is_valid()) {
        throw nb::python_error();
    }
    Transforms result;
    const auto count = static_cast<std::size_t>(PyTuple_GET_SIZE(items.ptr()));
    result.views.reserve(count);
    result.kept_.reserve(2 * count);
    for (std::size_t i = 0; i < count; ++i) {
        PyObject* const item = PyTuple_GET_ITEM(items.ptr(), static_cast<Py_ssize_t>(i));
        at_index(i, [&] { result.read_object(item); });
    }
    return result;
}

Transforms Transforms::from_columns(nb::handle columns, bool is_static) {
    Transforms result;
    const nb::object children = columns.attr("children");
    const nb::object parents = columns.attr("parents");
    std::optional<Stamps> stamps;
    if (const nb::object given = columns.attr("stamps"); !is_static || !given.is_none()) {
        stamps.emplace(given);
    }
    const auto fill = [&](const nb::object& names, std::string_view TransformView::*field,
                          const char* role) {
        if (nb::isinstance<nb::str>(names)) {
            const std::string_view name = result.keep_name(names, role);
            for (TransformView& view : result.views) {
                view.*field = name;
            }
            return;
        }
        const nb::object items = nb::steal(PySequence_Tuple(names.ptr()));
        if (!items.is_valid()) {
            throw nb::python_error();
        }
        const auto count = static_cast<std::size_t>(PyTuple_GET_SIZE(items.ptr()));
        check_rows(count, result.views.size(), role);
        for (std::size_t i = 0; i < count; ++i) {
            PyObject* const item = PyTuple_GET_ITEM(items.ptr(), static_cast<Py_ssize_t>(i));
            at_index(i, [&] { result.views[i].*field = name_of(item, role); });
        }
        result.kept_.push_back(items);
    };
    result.views.resize(nb::len(nb::object(columns.attr("poses"))));
    fill(parents, &TransformView::parent, "parents");
    fill(children, &TransformView::child, "children");
    if (stamps) {
        check_rows(stamps->values().size(), result.views.size(), "stamps");
        for (std::size_t i = 0; i < result.views.size(); ++i) {
            result.views[i].stamp = stamps->values()[i];
        }
    }
    read_poses(columns, result.views);
    return result;
}

void add_raw_writes(nb::handle type) {
    const nb::object descriptor =
        nb::steal(PyDescr_NewMethod(reinterpret_cast<PyTypeObject*>(type.ptr()), &g_set_transform));
    nb::setattr(type, g_set_transform.ml_name, descriptor);
}

}  // namespace tfdb::python
