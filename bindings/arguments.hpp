// Arguments of the raw (METH_FASTCALL | METH_KEYWORDS) methods: binding them to parameters, and
// frame names as bytes.
#pragma once

#include <nanobind/nanobind.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "errors.hpp"

namespace nb = nanobind;

namespace tfdb::python {

using RawMethod = PyObject* (*)(PyObject* self, PyObject* const* args, Py_ssize_t count,
                                PyObject* keywords);

/// A raw method as PyMethodDef requires it; the flags METH_FASTCALL
/// METH_KEYWORDS state its true type.
inline PyCFunction as_function(RawMethod method) {
    return reinterpret_cast<PyCFunction>(reinterpret_cast<void (*)()>(method));
}

/// Adds it to the type's methods. The definition must outlive the type.
void add_raw_method(nb::handle type, PyMethodDef& method);

/// Adds it to the functions of `tfdb`. The definition must outlive the module.
void add_raw_function(nb::module_& module, PyMethodDef& function);

/// A parameter list as in `def`: the first `required` are required, those from `positional` on are
/// keyword-only.
struct ParameterList {
    const char* function;
    std::span<const std::string_view> names;
    std::size_t required;
    std::size_t positional;

    /// Fills `out` (one borrowed reference per name, null if omitted), or throws TypeError.
    void bind_slowly(PyObject* const* args, std::size_t count, PyObject* keywords,
                     PyObject** out) const;
};

/// Binds a constructor's arguments, a tuple and a dict or null, into `out`.
void bind_tuple(const ParameterList& list, nb::handle args, PyObject* keywords, PyObject** out);

/// Binds the arguments of a vectorcall. The common call, all positional, is only a copy.
template <std::size_t N>
std::array<PyObject*, N> bind(const ParameterList& list, PyObject* const* args, Py_ssize_t count,
                              PyObject* keywords) {
    std::array<PyObject*, N> out{};
    const auto given = static_cast<std::size_t>(count);
    if (keywords != nullptr || given < list.required || given > list.positional) {
        list.bind_slowly(args, given, keywords, out.data());
        return out;
    }
    for (std::size_t i = 0; i < given; ++i) {
        out[i] = args[i];
    }
    return out;
}

[[noreturn]] void throw_not_a_name(PyObject* object, const char* role);
std::string_view other_name(PyObject* object, const char* role);

/// The bytes of a str, valid as long as the object. Throws TypeError if it is not a str, and
/// InvalidName for lone surrogates, which have no UTF-8.
inline std::string_view name_of(PyObject* object, const char* role) {
    if (!PyUnicode_Check(object)) {
        throw_not_a_name(object, role);
    }
#ifndef Py_LIMITED_API
    if (PyUnicode_IS_COMPACT_ASCII(object)) {
        return {static_cast<const char*>(PyUnicode_DATA(object)),
                static_cast<std::size_t>(PyUnicode_GET_LENGTH(object))};
    }
#endif
    return other_name(object, role);
}

inline std::string_view name_of(nb::handle object, const char* role) {
    return name_of(object.ptr(), role);
}

/// The value of an option with a few valid words. It rejects no word; a word without UTF-8 becomes
/// its repr, which matches none of them. Throws TypeError if it is not a str.
std::string option_of(nb::handle object, const char* role);

/// Throws InvalidArgument with the valid `words`, and suggests the nearest one.
[[noreturn]] void throw_not_one_of(const char* role, std::initializer_list<const char*> words,
                                   nb::handle given);

/// Throws TypeError if it is not iterable; `wanted` names the expected type.
void check_many(nb::handle object, const char* role, const char* wanted);

/// Reads each item of a sequence; an error gets the item's index. Returns a tuple that keeps the
/// items, because reading one may run code that changes the sequence.
template <class Item, class Read>
[[nodiscard]] nb::object read_items(nb::handle sequence, std::vector<Item>& items, Read read) {
    nb::object kept = nb::steal(PySequence_Tuple(sequence.ptr()));
    if (!kept.is_valid()) {
        throw nb::python_error();
    }
    items.resize(static_cast<std::size_t>(NB_TUPLE_GET_SIZE(kept.ptr())));
    for (std::size_t i = 0; i < items.size(); ++i) {
        look_for_signals(i);
        PyObject* const item = NB_TUPLE_GET_ITEM(kept.ptr(), static_cast<Py_ssize_t>(i));
        at_index(i, [&] { items[i] = read(item); });
    }
    return kept;
}

/// True or False; False if omitted. Throws TypeError for other types.
bool flag_of(PyObject* flag, const char* role);

/// An integer from `least` to `most`. Throws InvalidArgument for other values.
std::uint64_t count_of(nb::handle number, const char* name, std::uint64_t least,
                       std::uint64_t most);

inline bool is_given(PyObject* argument) noexcept {
    return argument != nullptr && argument != Py_None;
}

}  // namespace tfdb::python
