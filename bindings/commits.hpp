// What Python gets of a position.
#pragma once

#include "reads.hpp"

namespace tfdb::python {

/// A record `Position`.
nb::object position_record(const Position& position);

}  // namespace tfdb::python
