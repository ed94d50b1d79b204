// Signatures of the classes and methods created by nanobind.
#pragma once

#include <nanobind/nanobind.h>

#include <string>
#include <utility>

namespace nb = nanobind;

namespace tfdb::python {

/// Adds a `__signature__` to the methods of the classes of `tfdb`, and a docstring without one.
/// Both come from the bindings' texts, which the stub uses as well.
void add_signatures(nb::module_& module);

/// The function for its class or module: a call that does not match its parameters raises TypeError
/// with tfdb's own message.
nb::object checked_function(nb::handle made);

/// Refuses construction of a class; `how` names the calls that return its objects.
template <class Object, class Class>
void refuse_construction(Class& type, const char* how) {
    type.def(
        "__init__",
        [how](nb::pointer_and_handle<Object>, const nb::args&, const nb::kwargs&) {
            throw nb::type_error(how);
        },
        nb::sig("def __init__(self) -> None"));
}

/// A class offered by `tfdb`, with `tfdb` as its module.
template <class Class, class... Rest>
Class offered_class(nb::module_& module, const char* name, const char* doc, Rest&&... rest) {
    const nb::object own = module.attr("__name__");
    module.attr("__name__") = "tfdb";
    Class made(module, name, doc, std::forward<Rest>(rest)...);
    module.attr("__name__") = own;
    return made;
}

/// The native base of a Python class offered by `tfdb`: its methods name that class.
template <class Class, class... Rest>
Class native_class(nb::module_& module, const std::string& offered, Rest&&... rest) {
    const std::string name = "Native" + offered;
    const std::string doc = "The native part of `" + offered + "`.";
    Class made =
        offered_class<Class>(module, name.c_str(), doc.c_str(), std::forward<Rest>(rest)...);
    made.attr("__qualname__") = offered;
    return made;
}

}  // namespace tfdb::python
