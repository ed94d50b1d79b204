// Recorded transforms in order of arrival, as arrays.
#pragma once

#include <nanobind/nanobind.h>

namespace nb = nanobind;

namespace tfdb::python {

/// Adds the class ArrivalLog to the module.
void bind_arrivals(nb::module_& module);

}  // namespace tfdb::python
