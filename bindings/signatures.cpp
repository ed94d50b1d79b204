#include "signatures.hpp"

#include <structmember.h>

#include <cstddef>

#include "errors.hpp"

namespace tfdb::python {
namespace {

/// A method of nanobind's that says what it is, called as that one is.
struct MethodObject {
    PyObject_HEAD PyObject* made;  // by nanobind; kept for ever, as its class is
    vectorcallfunc call;
};

MethodObject& as_method(PyObject* object) {
    return *reinterpret_cast<MethodObject*>(object);
}

PyObject* call(PyObject* self, PyObject* const* args, std::size_t count, PyObject* keywords) {
    return PyObject_Vectorcall(as_method(self).made, args, count, keywords);
}

PyObject* bind_to(PyObject* self, PyObject* object, PyObject* /*type*/) {
    if (object == nullptr || object == Py_None) {
        return Py_NewRef(self);
    }
    return guarded([&] {
        const nb::object bound = nb::module_::import_("types").attr("MethodType");
        return bound(nb::handle(self), nb::handle(object)).release().ptr();
    });
}

/// What the binding says of it: its signature, its docstring.
nb::object written(PyObject* self, int what) {
    return nb::object(nb::handle(as_method(self).made).attr("__nb_signature__"))[0][what];
}

PyObject* get_signature(PyObject* self, void* /*closure*/) {
    return guarded([&] {
        const nb::object make = nb::module_::import_("tfdb.signatures").attr("signature_of");
        return make(written(self, 0)).release().ptr();
    });
}

PyObject* get_doc(PyObject* self, void* /*closure*/) {
    return guarded([&] { return written(self, 1).release().ptr(); });
}

PyObject* get_made(PyObject* self, void* /*closure*/) {
    return Py_NewRef(as_method(self).made);
}

PyObject* get_same(PyObject* self, void* name) {
    return PyObject_GetAttrString(as_method(self).made, static_cast<const char*>(name));
}

PyObject* represent(PyObject* self) {
    return guarded([&]() -> PyObject* {
        const nb::handle made = as_method(self).made;
        const nb::object module = made.attr("__module__");
        const nb::object name = made.attr("__qualname__");
        return PyUnicode_FromFormat("<method %S.%S>", module.ptr(), name.ptr());
    });
}

void* same(const char* name) {
    return const_cast<char*>(name);
}

PyGetSetDef g_attributes[] = {
    {"__signature__", get_signature, nullptr, nullptr, nullptr},
    {"__doc__", get_doc, nullptr, nullptr, nullptr},
    {"__wrapped__", get_made, nullptr, nullptr, nullptr},
    {"__name__", get_same, nullptr, nullptr, same("__name__")},
    {"__qualname__", get_same, nullptr, nullptr, same("__qualname__")},
    {"__module__", get_same, nullptr, nullptr, same("__module__")},
    {nullptr, nullptr, nullptr, nullptr, nullptr},
};

PyMemberDef g_members[] = {
    {"__vectorcalloffset__", T_PYSSIZET, offsetof(MethodObject, call), READONLY, nullptr},
    {nullptr, 0, 0, 0, nullptr},
};

PyType_Slot g_slots[] = {
    {Py_tp_members, g_members},
    {Py_tp_getset, g_attributes},
    {Py_tp_descr_get, reinterpret_cast<void*>(bind_to)},
    {Py_tp_call, reinterpret_cast<void*>(PyVectorcall_Call)},
    {Py_tp_repr, reinterpret_cast<void*>(represent)},
    {0, nullptr},
};

PyType_Spec g_spec = {"tfdb.Method", sizeof(MethodObject), 0,
                      Py_TPFLAGS_DEFAULT | Py_TPFLAGS_HAVE_VECTORCALL |
                          Py_TPFLAGS_METHOD_DESCRIPTOR | Py_TPFLAGS_DISALLOW_INSTANTIATION,
                      g_slots};

}  // namespace

void add_signatures(nb::module_& module) {
    const nb::object type = nb::steal(PyType_FromSpec(&g_spec));
    if (!type.is_valid()) {
        throw nb::python_error();
    }
    for (const nb::handle name :
         nb::make_tuple("Policy", "Reads", "Buffer", "Snapshot", "Transaction")) {
        const nb::object owner = module.attr(name);
        const nb::object names =
            nb::module_::import_("builtins").attr("list")(nb::object(owner.attr("__dict__")));
        for (const nb::handle attribute : names) {
            const nb::object made = owner.attr("__dict__")[attribute];
            if (!nb::hasattr(made, "__nb_signature__")) {
                continue;
            }
            auto* const method =
                PyObject_New(MethodObject, reinterpret_cast<PyTypeObject*>(type.ptr()));
            if (method == nullptr) {
                throw nb::python_error();
            }
            method->made = Py_NewRef(made.ptr());
            method->call = call;
            owner.attr(attribute) = nb::steal(reinterpret_cast<PyObject*>(method));
        }
    }
}

}  // namespace tfdb::python
