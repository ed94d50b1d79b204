// Dataclasses of tfdb.types, made from the core's structs.
#pragma once

#include <nanobind/nanobind.h>

#include "tfdb/store/buffer.hpp"

namespace nb = nanobind;

namespace tfdb::python {

/// A class of the module tfdb.types.
nb::object record_type(const char* name);

nb::object memory_record(const MemoryUse& use);
nb::object counters_record(const Counters& counters);

}  // namespace tfdb::python
