// Rewriting of recorded messages into another recording.
#pragma once

#include <nanobind/nanobind.h>

namespace nb = nanobind;

namespace tfdb::python {

/// Adds the classes MessageRewriter and MessageChunk to the module.
void bind_rewriting(nb::module_& module);

}  // namespace tfdb::python
