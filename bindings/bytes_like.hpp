// Bytes passed by a caller.
#pragma once

#include <nanobind/nanobind.h>

#include <cstddef>
#include <span>

#include "arguments.hpp"
#include "errors.hpp"

namespace nb = nanobind;

namespace tfdb::python {

using Bytes = std::span<const std::byte>;

/// The bytes of a bytes-like object. Mutable ones are copied, because decoding relies on earlier
/// checks.
/// Threads: constructed and destroyed with the GIL. Guarantee: the bytes do not change.
class BytesLike {
public:
    explicit BytesLike(nb::handle object, const char* what = "a message") {
        if (PyBytes_Check(object.ptr())) {
            object_ = nb::borrow(object);
        } else if (Py_buffer view; PyObject_GetBuffer(object.ptr(), &view, PyBUF_SIMPLE) == 0) {
            object_ =
                nb::steal(PyBytes_FromStringAndSize(static_cast<const char*>(view.buf), view.len));
            PyBuffer_Release(&view);
        }
        if (!object_.is_valid()) {
            forget_error();
            PyErr_Format(PyExc_TypeError, "%s must be bytes-like, got %s", what,
                         type_name_of(object).c_str());
            throw nb::python_error();
        }
        bytes_ = {reinterpret_cast<const std::byte*>(PyBytes_AsString(object_.ptr())),
                  static_cast<std::size_t>(PyBytes_Size(object_.ptr()))};
    }

    [[nodiscard]] Bytes bytes() const { return bytes_; }

private:
    nb::object object_;
    Bytes bytes_;
};

}  // namespace tfdb::python
