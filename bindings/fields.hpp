// Attribute names that loops read, interned once: a lookup by C string creates a str.
#pragma once

#include <nanobind/nanobind.h>

namespace nb = nanobind;

namespace tfdb::python {

#define TFDB_FIELDS(name)                                                                        \
    name(x) name(y) name(z) name(w) name(sec) name(nanosec) name(secs) name(nsecs) name(to_nsec) \
        name(nanoseconds) name(parent) name(child) name(stamp) name(translation) name(rotation)  \
            name(header) name(frame_id) name(child_frame_id) name(transform) name(dtype)         \
                name(kind) name(total_seconds) name(as_quat)

/// Strong references for the life of the process, set by bind_fields.
struct Fields {
#define TFDB_DECLARE(name) PyObject* name = nullptr;
    TFDB_FIELDS(TFDB_DECLARE)
#undef TFDB_DECLARE
};
extern Fields g_fields;

void bind_fields();

/// An attribute; throws the error that reading it raises.
inline nb::object get(PyObject* object, PyObject* name) {
    PyObject* value = PyObject_GetAttr(object, name);
    if (value == nullptr) {
        throw nb::python_error();
    }
    return nb::steal(value);
}

/// An attribute; empty if the object does not have it.
inline nb::object find(PyObject* object, PyObject* name) {
    PyObject* value = nullptr;
#if defined(Py_LIMITED_API)
    value = PyObject_GetAttr(object, name);
    const int found = value != nullptr ? 1 : PyErr_ExceptionMatches(PyExc_AttributeError) - 1;
    if (found == 0) {
        PyErr_Clear();
    }
#elif PY_VERSION_HEX >= 0x030D0000
    const int found = PyObject_GetOptionalAttr(object, name, &value);
#else
    const int found = _PyObject_LookupAttr(object, name, &value);
#endif
    if (found < 0) {
        throw nb::python_error();
    }
    return nb::steal(value);
}

}  // namespace tfdb::python
