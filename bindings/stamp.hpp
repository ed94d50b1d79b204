// Stamps and durations from Python objects.
#pragma once

#include <nanobind/nanobind.h>

#include <cstdint>
#include <optional>

#include "arguments.hpp"
#include "tfdb/clock/stamp.hpp"

namespace nb = nanobind;

namespace tfdb::python {

using clock::StampNs;

/// The stamp of an object other than an int from 0 to kMaxStamp: numpy integers, datetime64,
/// messages with sec and nanosec. All others are refused with InvalidStamp.
StampNs stamp_of_object(PyObject* object);

/// Nanoseconds of an int, or of a ROS message or time object with plain ints; may be negative.
/// Empty for other objects, or out of range.
std::optional<std::int64_t> plain_nanoseconds(PyObject* object);
/// The same for two plain ints; null stands for a missing one.
std::optional<std::int64_t> plain_nanoseconds(PyObject* seconds, PyObject* nanoseconds);

/// Nanoseconds of a stamp. Throws InvalidStamp.
inline StampNs stamp_of(PyObject* object) {
    if (PyLong_CheckExact(object)) {
        int overflow = 0;
        const long long value = PyLong_AsLongLongAndOverflow(object, &overflow);
        if (clock::is_stamp(value)) {
            return value;
        }
    }
    return stamp_of_object(object);
}

/// The same; None or null stands for the latest common time.
inline std::optional<StampNs> optional_stamp_of(PyObject* object) {
    return is_given(object) ? std::optional<StampNs>(stamp_of(object)) : std::nullopt;
}

/// A duration in seconds (int or float) as nanoseconds >= 0. Throws InvalidArgument.
StampNs duration_of(nb::handle seconds, const char* role);

inline std::optional<StampNs> optional_duration_of(nb::handle seconds, const char* role) {
    return is_given(seconds.ptr()) ? std::optional<StampNs>(duration_of(seconds, role))
                                   : std::nullopt;
}

}  // namespace tfdb::python
