// Commits as the messages of a recording.
#pragma once

#include <nanobind/nanobind.h>

namespace tfdb::python {

void bind_commit_messages(nanobind::module_& module);

}  // namespace tfdb::python
