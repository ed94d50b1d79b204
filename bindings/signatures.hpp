// Signatures of the classes and methods that nanobind makes.
#pragma once

#include <nanobind/nanobind.h>

#include <string>
#include <utility>

namespace nb = nanobind;

namespace tfdb::python {

/// Gives the methods of the classes that `tfdb` offers a `__signature__`, and a docstring without
/// one, both from what their bindings say, of which the stub is made too.
void add_signatures(nb::module_& module);

/// The function as its class or module offers it: a call that does not fit its parameters raises
/// TypeError in our words.
nb::object checked_function(nb::handle made);

/// Refuses calls of a class without a constructor; `how` names the calls that return its objects.
template <class Object, class Class>
void refuse_construction(Class& type, const char* how) {
    type.def(
        "__init__",
        [how](nb::pointer_and_handle<Object>, const nb::args&, const nb::kwargs&) {
            throw nb::type_error(how);
        },
        nb::sig("def __init__(self) -> None"));
}

/// A class that `tfdb` offers, with `tfdb` as its module.
template <class Class, class... Rest>
Class offered_class(nb::module_& module, const char* name, const char* doc, Rest&&... rest) {
    const nb::object own = module.attr("__name__");
    module.attr("__name__") = "tfdb";
    Class made(module, name, doc, std::forward<Rest>(rest)...);
    module.attr("__name__") = own;
    return made;
}

/// The native base of a class of Python that `tfdb` offers: its methods say that they are of that.
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
