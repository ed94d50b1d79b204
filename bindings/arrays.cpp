#include "arrays.hpp"

#include <algorithm>
#include <cstring>
#include <string_view>

#include "errors.hpp"
#include "stamp.hpp"

namespace tfdb::python {
namespace {

// Format characters of the struct module, native size and order.
Kind kind_of(const Py_buffer& view) {
    std::string_view format = view.format == nullptr ? "B" : view.format;
    if (!format.empty() && (format[0] == '@' || format[0] == '=')) {
        format.remove_prefix(1);
    }
    if (format.size() != 1) {
        return Kind::kOther;
    }
    switch (format[0]) {
        case 'd':
            return Kind::kFloat64;
        case 'f':
            return Kind::kFloat32;
        case 'q':
            return Kind::kInt64;
        case 'l':
            return view.itemsize == 8 ? Kind::kInt64 : Kind::kOtherInteger;
        case 'b':
        case 'B':
        case 'h':
        case 'H':
        case 'i':
        case 'I':
        case 'L':
        case 'Q':
            return Kind::kOtherInteger;
        default:
            return Kind::kOther;
    }
}

const char* name_of_kind(const Py_buffer& view, Kind kind) {
    switch (kind) {
        case Kind::kFloat32:
            return "float32";
        case Kind::kFloat64:
            return "float64";
        case Kind::kInt64:
            return "int64";
        default:
            return view.format == nullptr ? "bytes" : view.format;
    }
}

/// A masked array exposes masked numbers as well; so do classes derived from numpy.ma's.
bool is_masked(nb::handle object) {
    if (is_plain_array(object)) {
        return false;
    }
    for (const nb::handle type : object.type().attr("__mro__")) {
        const nb::object name = type.attr("__name__");
        if (PyUnicode_CompareWithASCIIString(name.ptr(), "MaskedArray") == 0) {
            return true;
        }
    }
    return false;
}

}  // namespace

bool are_in_range(std::span<const StampNs> stamps) {
    // An OR over all stamps is a loop that compilers vectorise; the limit is all ones.
    static_assert((clock::kMaxStamp & (clock::kMaxStamp + 1)) == 0);
    StampNs bits = 0;
    for (const StampNs stamp : stamps) {
        bits |= stamp;
    }
    return clock::is_stamp(bits);
}

ArrayView::ArrayView(ArrayView&& other) noexcept {
    take(other);
}

ArrayView& ArrayView::operator=(ArrayView&& other) noexcept {
    if (this != &other) {
        give_back();
        take(other);
    }
    return *this;
}

ArrayView::~ArrayView() {
    give_back();
}

/// Exporters of one axis may point shape and strides into the view itself, as CPython does.
void ArrayView::take(ArrayView& other) {
    view_ = other.view_;
    kind_ = other.kind_;
    if (view_.shape == &other.view_.len) {
        view_.shape = &view_.len;
    }
    if (view_.strides == &other.view_.itemsize) {
        view_.strides = &view_.itemsize;
    }
    other.view_.obj = nullptr;
}

void ArrayView::give_back() {
    if (view_.obj != nullptr) {
        PyBuffer_Release(&view_);
    }
}

std::optional<ArrayView> ArrayView::of(nb::handle object, bool writable) {
    ArrayView result;
    const int flags = PyBUF_FORMAT | PyBUF_STRIDES | (writable ? PyBUF_WRITABLE : 0);
    if (PyObject_CheckBuffer(object.ptr()) == 0 || is_masked(object) ||
        PyObject_GetBuffer(object.ptr(), &result.view_, flags) != 0) {
        result.view_.obj = nullptr;
        forget_error();
        return std::nullopt;
    }
    result.kind_ = kind_of(result.view_);
    return result;
}

std::pair<const char*, const char*> ArrayView::range() const {
    const char* low = data<const char>();
    const char* high = low + view_.itemsize;
    for (int axis = 0; axis < view_.ndim; ++axis) {
        if (view_.shape[axis] == 0) {
            return {low, low};
        }
        const Py_ssize_t reach = (view_.shape[axis] - 1) * view_.strides[axis];
        (reach < 0 ? low : high) += reach;
    }
    return {low, high};
}

std::string ArrayView::describe() const {
    std::string text = name_of_kind(view_, kind_);
    text += " (";
    for (int axis = 0; axis < view_.ndim; ++axis) {
        text += (axis == 0 ? "" : ", ") + std::to_string(view_.shape[axis]);
    }
    return text + (view_.ndim == 1 ? ",)" : ")");
}

void throw_bad_array(const std::string& role, const std::string& expected, const std::string& got) {
    const std::string reason = "expected " + expected + ", got " + got;
    throw_error("InvalidArray", role + ": " + reason, {{"reason", nb::str(reason.c_str())}});
}

std::string describe(nb::handle object) {
    const nb::object dtype = nb::getattr(object, "dtype", nb::none());
    const nb::object shape = nb::getattr(object, "shape", nb::none());
    if (dtype.is_none() || shape.is_none()) {
        return type_name_of(object);
    }
    return text_of(dtype) + " " + text_of(shape);
}

Stamps::Stamps(nb::handle object) {
    if (PyList_Check(object.ptr()) || PyTuple_Check(object.ptr())) {
        read_sequence(object);
    } else if (PyAnySet_Check(object.ptr())) {
        throw_bad_array("stamps", "an array (N,) of int64 nanoseconds or a list of stamps",
                        "a " + type_name_of(object) + ", which has no order");
    } else if (const auto plain = plain_stamps(object)) {
        array_ = nb::borrow(object);
        values_ = *plain;
    } else if (nb::hasattr(object, "__array__") || PyObject_CheckBuffer(object.ptr()) != 0) {
        read_array(object);
    } else if (PyUnicode_Check(object.ptr()) || !nb::hasattr(object, "__iter__")) {
        throw_bad_array("stamps", "an array (N,) of int64 nanoseconds or a list of stamps",
                        type_name_of(object));
    } else {
        read_sequence(object);
    }
    if (!are_in_range(values_)) {
        const auto first = std::find_if_not(values_.begin(), values_.end(), clock::is_stamp);
        at_index(static_cast<std::size_t>(first - values_.begin()),
                 [&] { stamp_of_object(nb::int_(*first).ptr()); });
    }
}

void Stamps::read_array(nb::handle object) {
    view_ = ArrayView::of(object, false);
    if (!view_ || view_->kind() != Kind::kInt64 || view_->dimensions() != 1) {
        array_ = nb::module_::import_("tfdb.data.stamps").attr("as_nanoseconds")(object);
        view_ = ArrayView::of(array_, false);
        copied_ = nb::borrow(object);
    }
    if (view_->contiguous()) {
        values_ = {view_->data<const StampNs>(), view_->extent(0)};
        return;
    }
    copy_.resize(view_->extent(0));
    const char* from = view_->data<const char>();
    for (StampNs& stamp : copy_) {
        std::memcpy(&stamp, from, sizeof stamp);
        from += view_->stride(0);
    }
    values_ = copy_;
    copied_ = nb::borrow(object);
}

void Stamps::check_apart(nb::handle out) const {
    if (!copied_.is_valid()) {
        return;
    }
    // Compared by byte ranges: the stamps of a point cloud lie between its points.
    const nb::module_ numpy = nb::module_::import_("numpy");
    if (nb::cast<bool>(numpy.attr("shares_memory")(copied_, out))) {
        throw_error("InvalidArgument",
                    "out overlaps the stamps in memory: they would be written over");
    }
}

void Stamps::read_sequence(nb::handle object) {
    (void)read_items(object, copy_, [](PyObject* item) { return stamp_of(item); });
    values_ = copy_;
}

ArrayView as_doubles(nb::handle object, const std::string& role, nb::object& keep) {
    const std::optional<ArrayView> view = ArrayView::of(object, false);
    if (view && (view->kind() == Kind::kFloat32 || view->kind() == Kind::kFloat64)) {
        keep = contiguous_doubles(object);
    } else {  // may hold other objects than numbers, or masked ones
        const nb::object doubles = nb::module_::import_("tfdb.data.poses").attr("doubles");
        keep = nb::steal(PyObject_CallFunctionObjArgs(doubles.ptr(), object.ptr(), nullptr));
    }
    if (!keep.is_valid()) {
        if (PyErr_ExceptionMatches(PyExc_ValueError) == 0 &&
            PyErr_ExceptionMatches(PyExc_TypeError) == 0) {
            throw nb::python_error();
        }
        PyErr_Clear();
        throw_bad_array(role, "an array of float64", describe(object));
    }
    return std::move(*ArrayView::of(keep, false));
}

}  // namespace tfdb::python
