// The native part of tfdb.tf2.
#pragma once

#include <nanobind/nanobind.h>

namespace nb = nanobind;

namespace tfdb::python {

/// Adds the classes CoreCalls and BufferCalls to the module.
void bind_tf2_calls(nb::module_& module);

}  // namespace tfdb::python
