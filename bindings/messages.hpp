// Messages of any library, created without running Python code.
#pragma once

#include <nanobind/nanobind.h>

#include <cstdint>
#include <optional>

#include "lookups.hpp"

namespace nb = nanobind;

namespace tfdb::python {

/// Adds the class MessageMaker to the module.
void bind_messages(nb::module_& module);

bool is_message_maker(nb::handle object);

/// The message T[target<-source] as a new reference; null with a Python error. `maker` is a
/// MessageMaker; the names are exact str.
PyObject* make_message(PyObject* maker, PyObject* target, PyObject* source, const Found& found);

/// As plain_nanoseconds, and faster for the stamp class of a maker's messages.
std::optional<std::int64_t> message_time(PyObject* maker, PyObject* time);

}  // namespace tfdb::python
