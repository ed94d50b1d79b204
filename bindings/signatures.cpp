#include "signatures.hpp"

#include <structmember.h>

#include <cstddef>

#include "errors.hpp"

namespace tfdb::python {
namespace {

/// Wraps a function of nanobind or Python and adds a signature. A call that does not match its
/// parameters raises an error with tfdb's own message.
struct MethodObject {
    PyObject_HEAD PyObject* made;  // immortal, like its class or module
    vectorcallfunc call;
    PyObject* weak;
};

PyTypeObject* g_type = nullptr;

MethodObject& as_method(PyObject* object) {
    return *reinterpret_cast<MethodObject*>(object);
}

/// Why the call does not match the parameters; none if it does.
nb::object misfit(PyObject* made, PyObject* const* args, std::size_t count, PyObject* keywords,
                  nb::handle said) {
    const nb::object names =
        keywords == nullptr ? nb::object(nb::tuple()) : nb::borrow(nb::handle(keywords));
    nb::list given;
    for (std::size_t i = 0; i < count + nb::len(names); ++i) {
        given.append(nb::handle(args[i]));
    }
    const nb::object describe = nb::module_::import_("tfdb.data.signatures").attr("misfit");
    return describe(nb::handle(made), nb::tuple(given), names, nb::str(said));
}

/// Rewords a TypeError about the arguments. An error with a traceback came from inside the
/// function, and stays unchanged.
void reword(PyObject* made, PyObject* const* args, std::size_t count, PyObject* keywords) {
    nb::python_error raised;  // it takes the current error
    if (!raised.traceback().is_valid()) {
        try {
            const nb::object text = misfit(made, args, count, keywords, raised.value());
            if (!text.is_none()) {
                PyErr_SetObject(PyExc_TypeError, text.ptr());
                return;
            }
        } catch (nb::python_error& error) {
            error.discard_as_unraisable("tfdb.data.signatures.misfit");
        }
    }
    raised.restore();
}

PyObject* call(PyObject* self, PyObject* const* args, std::size_t count, PyObject* keywords) {
    PyObject* const made = as_method(self).made;
    PyObject* const result = PyObject_Vectorcall(made, args, count, keywords);
    if (result == nullptr && PyErr_ExceptionMatches(PyExc_TypeError) != 0) [[unlikely]] {
        reword(made, args, static_cast<std::size_t>(PyVectorcall_NARGS(count)), keywords);
    }
    return result;
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

PyObject* get_signature(PyObject* self, void* /*closure*/) {
    return guarded([&] {
        const nb::object read = nb::module_::import_("tfdb.data.signatures").attr("read_signature");
        return read(nb::handle(as_method(self).made)).release().ptr();
    });
}

PyObject* get_doc(PyObject* self, void* /*closure*/) {
    return guarded([&] {
        const nb::handle made = as_method(self).made;
        // nanobind's own docstring begins with the signature.
        const nb::object written = nb::getattr(made, "__nb_signature__", nb::none());
        nb::object text = made.attr("__doc__");
        if (!written.is_none()) {
            text = written[0][1];
        }
        return text.release().ptr();
    });
}

PyObject* get_made(PyObject* self, void* /*closure*/) {
    return Py_NewRef(as_method(self).made);
}

PyObject* get_same(PyObject* self, void* name) {
    return PyObject_GetAttrString(as_method(self).made, static_cast<const char*>(name));
}

/// All other attributes of the function: annotations, code, marks.
PyObject* get_attribute(PyObject* self, PyObject* name) {
    PyObject* const found = PyObject_GenericGetAttr(self, name);
    if (found != nullptr || PyErr_ExceptionMatches(PyExc_AttributeError) == 0) {
        return found;
    }
    PyErr_Clear();
    return PyObject_GetAttr(as_method(self).made, name);
}

/// Pickled by name.
PyObject* reduce(PyObject* self, PyObject* /*unused*/) {
    return PyObject_GetAttrString(as_method(self).made, "__qualname__");
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

PyMethodDef g_methods[] = {
    {"__reduce__", reduce, METH_NOARGS, nullptr},
    {nullptr, nullptr, 0, nullptr},
};

PyMemberDef g_members[] = {
    {"__weaklistoffset__", T_PYSSIZET, offsetof(MethodObject, weak), READONLY, nullptr},
    {"__vectorcalloffset__", T_PYSSIZET, offsetof(MethodObject, call), READONLY, nullptr},
    {nullptr, 0, 0, 0, nullptr},
};

PyType_Slot g_slots[] = {
    {Py_tp_members, g_members},
    {Py_tp_getset, g_attributes},
    {Py_tp_methods, g_methods},
    {Py_tp_getattro, reinterpret_cast<void*>(get_attribute)},
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

nb::object checked_function(nb::handle made) {
    auto* const method = PyObject_New(MethodObject, g_type);
    if (method == nullptr) {
        throw nb::python_error();
    }
    method->made = Py_NewRef(made.ptr());
    method->call = call;
    method->weak = nullptr;
    return nb::steal(reinterpret_cast<PyObject*>(method));
}

void add_signatures(nb::module_& module) {
    g_type = reinterpret_cast<PyTypeObject*>(PyType_FromSpec(&g_spec));
    if (g_type == nullptr) {
        throw nb::python_error();
    }
    module.def("checked", &checked_function, nb::arg("function"),
               nb::sig("def checked(function: collections.abc.Callable[..., Any]) -> Any"),
               "The function, with tfdb's errors for calls that do not fit its parameters.");
    for (const nb::handle name :
         nb::make_tuple("Policy", "StoreReader", "NativeBuffer", "NativeSnapshot",
                        "NativeTransaction", "Watch", "Clock")) {
        const nb::object owner = module.attr(name);
        const nb::object names =
            nb::module_::import_("builtins").attr("list")(nb::object(owner.attr("__dict__")));
        for (const nb::handle attribute : names) {
            const nb::object made = owner.attr("__dict__")[attribute];
            if (!nb::hasattr(made, "__nb_signature__")) {
                continue;
            }
            owner.attr(attribute) = checked_function(made);
        }
    }
}

}  // namespace tfdb::python
