// numpy arrays, through numpy's C interface.
#pragma once

#include <nanobind/nanobind.h>

#include <cstddef>
#include <initializer_list>
#include <optional>
#include <span>

#include "tfdb/clock/stamp.hpp"

namespace nb = nanobind;

namespace tfdb::python {

/// A new, uninitialised numpy array and its memory.
template <class T>
struct NewArray {
    nb::object array;
    T* data;
};
/// At most three axes. Throws the errors of the numpy import, which the first call runs, and
/// MemoryError.
NewArray<double> new_doubles(std::initializer_list<std::size_t> shape);
NewArray<float> new_floats(std::initializer_list<std::size_t> shape);
NewArray<clock::StampNs> new_stamps(std::size_t count);
NewArray<bool> new_flags(std::size_t count);

/// Makes a new array read-only for Python.
nb::object read_only(nb::object array);

/// The content of an ordinary numpy array, read without the buffer protocol, which costs as much as
/// a lookup. Null or empty if it is not an array of exactly that type and shape with native numbers
/// in C order, or if it must be writable and is not. The memory does not move while a reference is
/// held.
std::optional<std::span<const clock::StampNs>> plain_stamps(nb::handle object);
double* plain_doubles(nb::handle object, std::span<const std::size_t> shape);

/// Whether it is known to be a numpy array, and not of a derived class.
bool is_plain_array(nb::handle object);

/// numpy.ascontiguousarray(object, float64); null with its error.
nb::object contiguous_doubles(nb::handle object);

}  // namespace tfdb::python
