// New arrays of numpy, by its C interface.
#pragma once

#include <nanobind/nanobind.h>

#include <cstddef>
#include <initializer_list>

#include "tfdb/clock/stamp.hpp"

namespace nb = nanobind;

namespace tfdb::python {

/// A new, uninitialised array of numpy and its memory.
template <class T>
struct NewArray {
    nb::object array;
    T* data;
};
/// At most three axes. They throw what the import of numpy raises, which the first call does, and
/// MemoryError.
NewArray<double> new_doubles(std::initializer_list<std::size_t> shape);
NewArray<float> new_floats(std::initializer_list<std::size_t> shape);
NewArray<clock::StampNs> new_stamps(std::size_t count);

/// The array just made, which Python may not write to from here on.
nb::object read_only(nb::object array);

/// numpy.ascontiguousarray(object, float64); null with the error that it raised.
nb::object contiguous_doubles(nb::handle object);

}  // namespace tfdb::python
