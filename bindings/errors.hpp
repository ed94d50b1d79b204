// Converts errors of the core, and of argument checks, to Python errors.
#pragma once

#include <nanobind/nanobind.h>

#include <exception>
#include <initializer_list>
#include <new>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "tfdb/base/error.hpp"

namespace nb = nanobind;

namespace tfdb::python {

/// Imports tfdb.errors and lets nanobind translate tfdb::Error.
void bind_errors(nb::module_& module);

/// The Python error for `error`, with all its fields.
nb::object error_object(const Error& error);

/// Raises it.
void set_error(const Error& error) noexcept;

/// Raises an error made before.
[[noreturn]] void throw_object(const nb::object& error);

/// Whether it is one of tfdb's own.
bool is_tfdb_error(const nb::python_error& error);

/// A tfdb.types.Refused.
nb::object refused_record(const RefusedMember& member);

/// Text of the core as a str; bytes that are not UTF-8, from C++ programs or damage, are escaped.
nb::str escaped(std::string_view text);

/// The name of a frame as a str. Throws CorruptStore if it is not UTF-8: such names are never
/// stored.
nb::str str_of_name(std::string_view name);
/// The same; None for an empty optional.
nb::object name_or_none(const std::optional<std::string>& name);

/// Name of the class in tfdb.errors for a code.
const char* class_name(ErrorCode code);

using Field = std::pair<const char*, nb::object>;

/// Throws (as nb::python_error) the class of tfdb.errors with that name.
[[noreturn]] void throw_error(const char* class_name, const std::string& message,
                              std::initializer_list<Field> fields = {});

/// Runs the code for one element of a batch; an error gets the element's position as `index`.
template <class Function>
void at_index(std::size_t index, Function&& function);

void add_index(nb::python_error& error, std::size_t index);

template <class Function>
void at_index(std::size_t index, Function&& function) {
    try {
        function();
    } catch (nb::python_error& error) {
        add_index(error, index);
        throw;
    }
}

/// Sets the Python error of the exception being handled.
void set_current_exception() noexcept;

/// The body of a raw method: C++ exceptions become Python errors, the result is a new reference.
template <class Function>
PyObject* guarded(Function&& function) noexcept {
    try {
        return function();
    } catch (const Error& error) {  // here, without a second throw: failing must be cheap
        set_error(error);
        return nullptr;
    } catch (...) {
        set_current_exception();
        return nullptr;
    }
}

/// Name of an object's type, for messages.
std::string type_name_of(nb::handle object);

/// repr(), shortened for a message.
std::string short_repr(nb::handle object);

/// str() for a message; text without UTF-8 is escaped.
std::string text_of(nb::handle object);

/// T[target<-source] for a message.
std::string transform_name(nb::handle target, nb::handle source);

/// Clears the Python error, because another one will be raised. Throws MemoryError and errors
/// outside of Exception, such as KeyboardInterrupt.
void forget_error();

/// For loops that keep the GIL: runs Python's signal handlers periodically, and throws their
/// errors.
void look_for_signals(std::size_t step);

}  // namespace tfdb::python
