// Batches of transforms from Python objects and from columns.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <optional>
#include <string>
#include <utility>

#include "arguments.hpp"
#include "arrays.hpp"
#include "errors.hpp"
#include "fields.hpp"
#include "pose.hpp"
#include "records.hpp"
#include "stamp.hpp"
#include "transform.hpp"
#include "writes.hpp"

namespace tfdb::python {
namespace {

/// A contiguous (N, width) array of float64.
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

nb::object tuple_of(nb::handle sequence) {
    nb::object items = nb::steal(PySequence_Tuple(sequence.ptr()));
    if (!items.is_valid()) {
        throw nb::python_error();
    }
    return items;
}

/// Whether it is a str that can be encoded in UTF-8.
bool is_text(const nb::object& object) {
    if (!PyUnicode_Check(object.ptr())) {
        return false;
    }
    Py_ssize_t size = 0;
    const bool has_bytes = PyUnicode_AsUTF8AndSize(object.ptr(), &size) != nullptr;
    if (!has_bytes) {
        forget_error();
    }
    return has_bytes;
}

bool is_aligned(const void* data) {
    return reinterpret_cast<std::uintptr_t>(data) % alignof(double) == 0;
}

/// The record of a member whose Python error is known.
nb::object record_of(std::size_t index, const nb::object& error) {
    const nb::object reason = error.attr("reason");
    const nb::str message(error);
    return record_type("Refused")(index, nb::object(error.type().attr("__name__")), message,
                                  reason.is_none() ? nb::object(message) : reason);
}

}  // namespace

/// Runs a function that reads one member; a tfdb error from it makes the member unreadable.
template <class Function>
void Transforms::collecting(std::size_t index, Function&& function) {
    try {
        function();
    } catch (nb::python_error& error) {
        add_index(error, index);
        if (!is_tfdb_error(error)) {
            throw;
        }
        unreadable_.push_back({index, nb::borrow(error.value())});
    }
}

void Transforms::put_placeholders() {
    const auto by_index = [](const Unreadable& a, const Unreadable& b) {
        return a.index < b.index;
    };
    const auto same = [](const Unreadable& a, const Unreadable& b) { return a.index == b.index; };
    std::stable_sort(unreadable_.begin(), unreadable_.end(), by_index);
    unreadable_.erase(std::unique(unreadable_.begin(), unreadable_.end(), same), unreadable_.end());
    for (const Unreadable& member : unreadable_) {
        TransformView none;  // invalid names, invalid numbers
        none.pose.translation.x = std::numeric_limits<double>::quiet_NaN();
        views[member.index] = none;
    }
}

nb::list Transforms::refused(const std::vector<RefusedMember>& by_core) const {
    nb::list records;
    auto next = unreadable_.begin();
    for (const RefusedMember& member : by_core) {
        for (; next != unreadable_.end() && next->index < member.index; ++next) {
            records.append(record_of(next->index, next->error));
        }
        if (next == unreadable_.end() || next->index != member.index) {
            records.append(refused_record(member));
        }
    }
    for (; next != unreadable_.end(); ++next) {
        records.append(record_of(next->index, next->error));
    }
    return records;
}

void Transforms::throw_refused(const Error& error) const {
    const std::vector<RefusedMember>& by_core = error.detail().refused;
    const Unreadable& first = unreadable_.front();
    const bool core_first = !by_core.empty() && by_core.front().index < first.index;
    const nb::object value = core_first ? error_object(error) : first.error;
    nb::setattr(value, "refused", nb::tuple(refused(by_core)));
    throw_object(value);
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
    // One leading '/' is dropped, as in messages read from bytes.
    const auto keep = [this](nb::object name, const char* role) {
        const std::string_view bytes = keep_name(std::move(name), role);
        return bytes.starts_with('/') ? bytes.substr(1) : bytes;
    };
    view.parent = keep(get(header.ptr(), g_fields.frame_id), "header.frame_id");
    view.child = keep(std::move(child), "child_frame_id");
    view.stamp = stamp_of(get(header.ptr(), g_fields.stamp).ptr());
    view.pose = {vector_of(part(g_fields.translation).ptr(), "transform.translation"),
                 quaternion_of(part(g_fields.rotation).ptr(), "transform.rotation")};
    views.push_back(view);
}

void Transforms::read_transform(PyObject* item, bool is_static) {
    const auto& given = *reinterpret_cast<TransformObject*>(item);
    if (given.stamp == 0 && !is_static) {
        const nb::object repr = nb::steal(PyObject_Repr(item));
        throw_error("InvalidStamp",
                    text_of(repr.ptr()) +
                        " has no stamp (0: it holds at all times): store it with "
                        "set_transforms([T], static=True), or give the stamp: "
                        "set_transform(T.target, T.source, stamp, T)",
                    {{"value", nb::borrow(item)}});
    }
    TransformView view;
    view.parent = keep_name(nb::borrow(given.target), "target");
    view.child = keep_name(nb::borrow(given.source), "source");
    view.stamp = given.stamp;
    view.pose = given.pose;
    views.push_back(view);
}

void Transforms::read_object(PyObject* item, bool is_static) {
    if (is_transform(item)) {
        read_transform(item, is_static);
        return;
    }
    nb::object child = find(item, g_fields.child);
    if (!child.is_valid()) {
        child = find(item, g_fields.child_frame_id);
        if (child.is_valid()) {
            read_message(item, std::move(child));
            return;
        }
        PyErr_Format(
            PyExc_TypeError,
            "transforms must be tfdb.Transform, tfdb.TransformStamped, or messages with header, "
            "child_frame_id and transform; item %zu is of type %s",
            views.size(), type_name_of(item).c_str());
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

void Transforms::read_objects(nb::handle batch, bool is_static, bool collect) {
    if (!PySequence_Check(batch.ptr()) && !nb::hasattr(batch, "__iter__")) {
        const std::string message =
            "batch must be an iterable of transforms, or Columns; got a "
            "single " +
            type_name_of(batch.ptr()) + ": for one transform write [transform]";
        throw nb::type_error(message.c_str());
    }
    const nb::object items = tuple_of(batch);
    const auto count = static_cast<std::size_t>(NB_TUPLE_GET_SIZE(items.ptr()));
    views.reserve(count);
    kept_.reserve(2 * count);
    for (std::size_t i = 0; i < count; ++i) {
        look_for_signals(i);
        PyObject* const item = NB_TUPLE_GET_ITEM(items.ptr(), static_cast<Py_ssize_t>(i));
        if (collect) {
            collecting(i, [&] { read_object(item, is_static); });
            views.resize(i + 1);
        } else {
            at_index(i, [&] { read_object(item, is_static); });
        }
    }
    put_placeholders();
}

void Transforms::read_names(const nb::object& names, std::string_view TransformView::*field,
                            const char* role) {
    if (nb::isinstance<nb::str>(names)) {
        const std::string_view name = keep_name(names, role);
        for (TransformView& view : views) {
            view.*field = name;
        }
        return;
    }
    const nb::object items = tuple_of(names);
    const auto count = static_cast<std::size_t>(NB_TUPLE_GET_SIZE(items.ptr()));
    check_rows(count, views.size(), role);
    for (std::size_t i = 0; i < count; ++i) {
        look_for_signals(i);
        PyObject* const item = NB_TUPLE_GET_ITEM(items.ptr(), static_cast<Py_ssize_t>(i));
        collecting(i, [&] { views[i].*field = name_of(item, role); });
    }
    kept_.push_back(items);
}

void Transforms::read_stamps(const nb::object& given) {
    try {
        const Stamps stamps(given);
        check_rows(stamps.values().size(), views.size(), "stamps");
        for (std::size_t i = 0; i < views.size(); ++i) {
            views[i].stamp = stamps.values()[i];
        }
    } catch (nb::python_error& error) {
        const nb::object index = nb::getattr(error.value(), "index", nb::none());
        if (index.is_none()) {
            throw;  // an error of the whole column
        }
        const nb::object items = tuple_of(given);
        const auto count = static_cast<std::size_t>(NB_TUPLE_GET_SIZE(items.ptr()));
        check_rows(count, views.size(), "stamps");
        for (std::size_t i = 0; i < count; ++i) {
            look_for_signals(i);
            PyObject* const item = NB_TUPLE_GET_ITEM(items.ptr(), static_cast<Py_ssize_t>(i));
            collecting(i, [&] { views[i].stamp = stamp_of(item); });
        }
    }
}

void Transforms::read_columns(nb::handle columns, bool is_static) {
    views.resize(nb::len(nb::object(columns.attr("poses"))));
    read_names(columns.attr("parents"), &TransformView::parent, "parents");
    read_names(columns.attr("children"), &TransformView::child, "children");
    if (const nb::object stamps = columns.attr("stamps"); !is_static || !stamps.is_none()) {
        read_stamps(stamps);
    }
    read_poses(columns, views);
    put_placeholders();
}

std::optional<OneEdge> OneEdge::of(nb::handle batch) {
    if (!nb::isinstance(batch, record_type("Columns"))) {
        return std::nullopt;
    }
    OneEdge edge;
    edge.parent_ = batch.attr("parents");
    edge.child_ = batch.attr("children");
    if (!is_text(edge.parent_) || !is_text(edge.child_)) {
        return std::nullopt;
    }
    auto stamps = ArrayView::of(nb::object(batch.attr("stamps")), false);
    auto poses = ArrayView::of(nb::object(batch.attr("poses")), false);
    const auto is_plain = [](const std::optional<ArrayView>& view, Kind kind, int dimensions) {
        return view && view->kind() == kind && view->dimensions() == dimensions &&
               view->contiguous() && is_aligned(view->data<const void>());
    };
    if (!is_plain(stamps, Kind::kInt64, 1) || !is_plain(poses, Kind::kFloat64, 2) ||
        poses->extent(1) != 7 || stamps->extent(0) != poses->extent(0) ||
        !are_in_range({stamps->data<const StampNs>(), stamps->extent(0)})) {
        return std::nullopt;
    }
    edge.stamps_ = std::move(*stamps);
    edge.poses_ = std::move(*poses);
    return edge;
}

EdgeColumns OneEdge::columns() const {
    const std::size_t rows = stamps_.extent(0);
    return {name_of(parent_, "parents"),
            name_of(child_, "children"),
            {stamps_.data<const StampNs>(), rows},
            {poses_.data<const Pose>(), rows}};
}

Transforms Transforms::for_message(nb::handle batch) {
    Transforms result;
    if (!nb::isinstance(batch, record_type("Columns"))) {
        result.read_objects(batch, true, false);
        return result;
    }
    result.read_columns(batch, true);
    if (!result.unreadable_.empty()) {
        throw_object(result.unreadable_.front().error);
    }
    return result;
}

Transforms Transforms::from_one(PyObject* transform) {
    Transforms result;
    result.read_object(transform, false);
    return result;
}

Transforms Transforms::from_batch(nb::handle batch, bool is_static) {
    Transforms result;
    if (nb::isinstance(batch, record_type("Columns"))) {
        result.read_columns(batch, is_static);
    } else {
        result.read_objects(batch, is_static, true);
    }
    return result;
}

}  // namespace tfdb::python
