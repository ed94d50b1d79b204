// Creates the dataclasses of tfdb.types from the core's structs.
#pragma once

#include <nanobind/nanobind.h>

#include <string>
#include <vector>

#include "tfdb/store/buffer.hpp"

namespace nb = nanobind;

namespace tfdb::python {

/// A class of the module tfdb.types.
nb::object record_type(const char* name);

nb::object frame_info_record(const FrameInfo& info);
nb::list frame_info_records(const std::vector<FrameInfo>& infos);
nb::object tree_columns_record(const TreeColumns& columns);
/// Consecutive equal names become one object.
nb::list name_list(const std::vector<std::string>& names);
/// (stamps, poses, parents' names).
nb::tuple samples_record(const Samples& found);
nb::object twist_record(const Twist& twist);
nb::object stamp_array(const std::vector<StampNs>& stamps);
nb::object memory_record(const MemoryUse& use);
nb::object counters_record(const Counters& counters);

}  // namespace tfdb::python
