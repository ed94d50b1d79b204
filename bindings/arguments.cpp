#include "arguments.hpp"

#include <algorithm>
#include <string>
#include <vector>

#include "errors.hpp"

namespace tfdb::python {
namespace {

[[noreturn]] void throw_type_error(const std::string& message) {
    PyErr_SetString(PyExc_TypeError, message.c_str());
    throw nb::python_error();
}

/// Throws tfdb's own message about a call that does not match its parameters.
[[noreturn]] void throw_misfit(const ParameterList& list, std::size_t count, PyObject* keywords) {
    nb::list names;
    for (const std::string_view name : list.names) {
        names.append(nb::str(name.data(), name.size()));
    }
    const nb::object given =
        keywords == nullptr ? nb::object(nb::tuple()) : nb::borrow(nb::handle(keywords));
    const nb::object describe = nb::module_::import_("tfdb.data.signatures").attr("refusal");
    const nb::object text = describe(nb::str(list.function), names, list.required, list.positional,
                                     nb::make_tuple(count, given));
    PyErr_SetObject(PyExc_TypeError, text.ptr());
    throw nb::python_error();
}

/// Index of the parameter of that name; the number of parameters if it is missing.
std::size_t find_parameter(const ParameterList& list, PyObject* keyword) {
    Py_ssize_t size = 0;
    const char* const text = PyUnicode_AsUTF8AndSize(keyword, &size);
    if (text == nullptr) {
        forget_error();
        return list.names.size();
    }
    const std::string_view name(text, static_cast<std::size_t>(size));
    const auto found = std::find(list.names.begin(), list.names.end(), name);
    return static_cast<std::size_t>(found - list.names.begin());
}

}  // namespace

void ParameterList::bind_slowly(PyObject* const* args, std::size_t count, PyObject* keywords,
                                PyObject** out) const {
    if (count > positional) {
        throw_misfit(*this, count, keywords);
    }
    for (std::size_t i = 0; i < count; ++i) {
        out[i] = args[i];
    }
    const Py_ssize_t named = keywords == nullptr ? 0 : NB_TUPLE_GET_SIZE(keywords);
    for (Py_ssize_t k = 0; k < named; ++k) {
        const std::size_t i = find_parameter(*this, NB_TUPLE_GET_ITEM(keywords, k));
        if (i == names.size() || out[i] != nullptr) {
            throw_misfit(*this, count, keywords);
        }
        out[i] = args[count + static_cast<std::size_t>(k)];
    }
    for (std::size_t i = 0; i < required; ++i) {
        if (out[i] == nullptr) {
            throw_misfit(*this, count, keywords);
        }
    }
}

void bind_tuple(const ParameterList& list, nb::handle args, PyObject* keywords, PyObject** out) {
    const auto count = static_cast<std::size_t>(NB_TUPLE_GET_SIZE(args.ptr()));
    std::vector<PyObject*> given(count);  // references borrowed from both
    for (std::size_t i = 0; i < count; ++i) {
        given[i] = NB_TUPLE_GET_ITEM(args.ptr(), static_cast<Py_ssize_t>(i));
    }
    if (keywords == nullptr || PyDict_Size(keywords) == 0) {
        list.bind_slowly(given.data(), count, nullptr, out);
        return;
    }
    nb::list names;
    PyObject* key = nullptr;
    PyObject* value = nullptr;
    for (Py_ssize_t at = 0; PyDict_Next(keywords, &at, &key, &value) != 0;) {
        names.append(nb::handle(key));
        given.push_back(value);
    }
    list.bind_slowly(given.data(), count, nb::tuple(names).ptr(), out);
}

void add_raw_method(nb::handle type, PyMethodDef& method) {
    const nb::object descriptor =
        nb::steal(PyDescr_NewMethod(reinterpret_cast<PyTypeObject*>(type.ptr()), &method));
    nb::setattr(type, method.ml_name, descriptor);
}

void add_raw_function(nb::module_& module, PyMethodDef& function) {
    const nb::str owner("tfdb");
    const nb::object made = nb::steal(PyCFunction_NewEx(&function, nullptr, owner.ptr()));
    if (!made.is_valid()) {
        throw nb::python_error();
    }
    module.attr(function.ml_name) = made;
}

bool flag_of(PyObject* flag, const char* role) {
    if (flag != nullptr && !PyBool_Check(flag)) {
        throw_type_error(std::string(role) + " must be a bool, got " + type_name_of(flag));
    }
    return flag == Py_True;
}

void throw_not_a_name(PyObject* object, const char* role) {
    throw_type_error(std::string(role) + " must be a str, got " + type_name_of(object));
}

void check_many(nb::handle object, const char* role, const char* wanted) {
    if (!nb::hasattr(object, "__iter__") && PySequence_Check(object.ptr()) == 0)
        throw_type_error(std::string(role) + " must be " + wanted + ", got " +
                         type_name_of(object));
}

std::string option_of(nb::handle object, const char* role) {
    if (!PyUnicode_Check(object.ptr())) {
        throw_not_a_name(object.ptr(), role);
    }
    Py_ssize_t size = 0;
    const char* const bytes = PyUnicode_AsUTF8AndSize(object.ptr(), &size);
    if (bytes == nullptr) {
        forget_error();
        return short_repr(object);
    }
    return {bytes, static_cast<std::size_t>(size)};
}

void throw_not_one_of(const char* role, std::initializer_list<const char*> words,
                      nb::handle given) {
    nb::list valid;
    for (const char* word : words) {
        valid.append(nb::str(word));
    }
    const nb::object refuse = nb::module_::import_("tfdb.data.argument_checks").attr("refuse_word");
    refuse(nb::str(role), given, nb::tuple(valid));
    throw nb::type_error("the word is one of those that there are");  // never reached
}

std::uint64_t count_of(nb::handle number, const char* name, std::uint64_t least,
                       std::uint64_t most) {
    if (!PyBool_Check(number.ptr()) && PyIndex_Check(number.ptr()) != 0) {
        const nb::object whole = nb::steal(PyNumber_Index(number.ptr()));
        const unsigned long long value =
            whole.is_valid() ? PyLong_AsUnsignedLongLong(whole.ptr()) : ~0ULL;
        if (value == ~0ULL && PyErr_Occurred() != nullptr) {
            forget_error();
        } else if (value >= least && value <= most) {
            return value;
        }
    }
    throw_error("InvalidArgument",
                std::string(name) + " must be an integer from " + std::to_string(least) + " to " +
                    std::to_string(most) + ", got " + short_repr(number),
                {{"value", nb::borrow(number)}});
}

std::string_view other_name(PyObject* object, const char* role) {
    Py_ssize_t size = 0;
    const char* bytes = PyUnicode_AsUTF8AndSize(object, &size);
    if (bytes == nullptr) {
        forget_error();
        throw_error("InvalidName",
                    std::string(role) + " cannot be written as UTF-8: " + short_repr(object),
                    {{"value", nb::borrow(object)}, {"reason", nb::str("not valid UTF-8")}});
    }
    return {bytes, static_cast<std::size_t>(size)};
}

}  // namespace tfdb::python
