// Arrays of numpy, by its C interface.
#pragma once

#include <nanobind/nanobind.h>

#include <cstddef>
#include <initializer_list>
#include <optional>
#include <span>

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
NewArray<bool> new_flags(std::size_t count);

/// The array just made, which Python may not write to from here on.
nb::object read_only(nb::object array);

/// What an ordinary array of numpy holds, read without the buffer protocol, which costs as much as
/// a lookup. Null, or nothing, where it is not an array of just that type, shape and native numbers
/// in C order, or may not be written. The memory stays where it is as for any holder of a
/// reference.
std::optional<std::span<const clock::StampNs>> plain_stamps(nb::handle object);
double* plain_doubles(nb::handle object, std::span<const std::size_t> shape);

/// Whether it is known to be numpy's own array, and none of a class that is derived from it.
bool is_plain_array(nb::handle object);

/// numpy.ascontiguousarray(object, float64); null with the error that it raised.
nb::object contiguous_doubles(nb::handle object);

}  // namespace tfdb::python
