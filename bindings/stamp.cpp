#include "stamp.hpp"

#include <string>

#include "errors.hpp"
#include "fields.hpp"

namespace tfdb::python {
namespace {

constexpr const char* kValid =
    "a stamp is an integer number of nanoseconds from 0 to 2**61 - 1 (the year 2043), a message with sec and "
    "nanosec, a numpy.datetime64 or a datetime with a time zone; tfdb.stamp() converts seconds and "
    "text";

/// `shown`: the object as shown in the message.
[[noreturn]] void refuse(PyObject* object, const std::string& problem, PyObject* shown) {
    throw_error("InvalidStamp", "stamp " + short_repr(shown) + " is " + problem + ": " + kValid,
                {{"value", nb::borrow(object)}, {"reason", nb::str(problem.c_str())}});
}

[[noreturn]] void refuse(PyObject* object, const std::string& problem) {
    refuse(object, problem, object);
}

/// Reads integers of all types in the same way.
StampNs from_integer(PyObject* object, PyObject* integer) {
    PyObject* const shown = PyIndex_Check(object) ? integer : object;
    int overflow = 0;
    const long long value = PyLong_AsLongLongAndOverflow(integer, &overflow);
    if (overflow > 0 || value > clock::kMaxStamp) {
        refuse(object, "too large", shown);
    }
    if (overflow < 0 || value < 0) {
        refuse(object, "negative", shown);
    }
    return value;
}

long long part(PyObject* object, const nb::object& value, const char* name) {
    if (PyBool_Check(value.ptr()) || !PyIndex_Check(value.ptr())) {
        refuse(object, std::string("not a stamp, because its ") + name + " is not an integer");
    }
    const nb::object integer = nb::steal(PyNumber_Index(value.ptr()));
    int overflow = 0;
    const long long number =
        integer.is_valid() ? PyLong_AsLongLongAndOverflow(integer.ptr(), &overflow) : -1;
    if (!integer.is_valid() || overflow != 0) {
        forget_error();
        refuse(object, std::string("not a stamp, because its ") + name + " is out of range");
    }
    return number;
}

StampNs from_parts(PyObject* object, const nb::object& seconds, const nb::object& nanoseconds,
                   const char* seconds_name, const char* nanoseconds_name) {
    const auto stamp = clock::stamp_from_parts(part(object, seconds, seconds_name),
                                               part(object, nanoseconds, nanoseconds_name));
    if (!stamp || *stamp > clock::kMaxStamp) {
        refuse(object, std::string("out of range in ") + seconds_name + " or " + nanoseconds_name);
    }
    return *stamp;
}

bool is_datetime64(PyObject* object) {
    const nb::object dtype = find(object, g_fields.dtype);
    if (!dtype.is_valid()) {
        return false;
    }
    const nb::object axes = nb::getattr(object, "ndim", nb::none());
    if (!axes.equal(nb::int_(0))) {
        return false;
    }
    const nb::object kind = find(dtype.ptr(), g_fields.kind);
    return kind.is_valid() && nb::isinstance<nb::str>(kind) && kind.equal(nb::str("M"));
}

StampNs from_datetime64(PyObject* object) {
    const nb::object value = nb::borrow(object);
    const nb::object fine = value.attr("astype")("datetime64[ns]");
    // numpy wraps around silently if a date does not fit into 64 bits of nanoseconds.
    if (!nb::object(fine.attr("astype")(value.attr("dtype"))).equal(value)) {
        refuse(object, "not a time, or beyond the range of nanoseconds");
    }
    const nb::object integer = nb::steal(PyNumber_Index(fine.attr("astype")("int64").ptr()));
    if (!integer.is_valid()) {
        throw nb::python_error();
    }
    return from_integer(object, integer.ptr());
}

/// Messages and time objects of ROS 1 and ROS 2 with two numbers.
std::optional<StampNs> from_message(PyObject* object) {
    nb::object seconds = find(object, g_fields.sec);
    nb::object nanoseconds = find(object, g_fields.nanosec);
    if (seconds.is_valid() && nanoseconds.is_valid()) {
        return from_parts(object, seconds, nanoseconds, "sec", "nanosec");
    }
    seconds = find(object, g_fields.secs);
    nanoseconds = find(object, g_fields.nsecs);
    if (seconds.is_valid() && nanoseconds.is_valid()) {
        return from_parts(object, seconds, nanoseconds, "secs", "nsecs");
    }
    return std::nullopt;
}

/// ... and with one.
std::optional<StampNs> from_whole(PyObject* object) {
    nb::object whole;
    if (const nb::object to_nsec = find(object, g_fields.to_nsec); to_nsec.is_valid()) {
        whole = to_nsec();
    } else {
        whole = find(object, g_fields.nanoseconds);
    }
    if (whole.is_valid() && PyLong_Check(whole.ptr()) && !PyBool_Check(whole.ptr())) {
        return from_integer(object, whole.ptr());
    }
    return std::nullopt;
}

/// A plain int with an absolute value of at most `most`.
bool plain_int(PyObject* object, std::int64_t most, std::int64_t& out) {
    if (object == nullptr || !PyLong_CheckExact(object)) {
        return false;
    }
    int overflow = 0;
    out = PyLong_AsLongLongAndOverflow(object, &overflow);
    return overflow == 0 && -most <= out && out <= most;
}

std::optional<std::int64_t> plain_parts(PyObject* object, PyObject* seconds,
                                        PyObject* nanoseconds) {
    const nb::object whole = find(object, seconds);
    if (!whole.is_valid()) {
        return std::nullopt;
    }
    return plain_nanoseconds(whole.ptr(), find(object, nanoseconds).ptr());
}

}  // namespace

std::optional<std::int64_t> plain_nanoseconds(PyObject* seconds, PyObject* nanoseconds) {
    constexpr std::int64_t kMost = std::int64_t{1} << 32;
    std::int64_t whole = 0;
    std::int64_t beyond = 0;
    if (!plain_int(seconds, kMost, whole) || !plain_int(nanoseconds, kMost, beyond)) {
        return std::nullopt;
    }
    return whole * clock::kNanosPerSecond + beyond;
}

std::optional<std::int64_t> plain_nanoseconds(PyObject* object) {
    constexpr std::int64_t kMost = std::int64_t{1} << 62;
    std::int64_t value = 0;
    if (plain_int(object, kMost, value)) {
        return value;
    }
    if (const auto found = plain_parts(object, g_fields.sec, g_fields.nanosec)) {
        return found;
    }
    if (const auto found = plain_parts(object, g_fields.secs, g_fields.nsecs)) {
        return found;
    }
    const nb::object whole = find(object, g_fields.nanoseconds);
    // A datetime.timedelta's attributes hold only the last digits, if it has them at all.
    if (plain_int(whole.ptr(), kMost, value) && !find(object, g_fields.total_seconds).is_valid()) {
        return value;
    }
    return std::nullopt;
}

StampNs stamp_of_object(PyObject* object) {
    if (PyBool_Check(object)) {
        refuse(object, "a bool");
    }
    if (PyFloat_Check(object)) {
        refuse(object, "a float, which cannot hold nanoseconds");
    }
    if (PyLong_Check(object)) {
        return from_integer(object, object);
    }
    if (const auto stamp = from_message(object)) {
        return *stamp;
    }
    if (is_datetime64(object)) {
        return from_datetime64(object);
    }
    if (PyIndex_Check(object)) {
        const nb::object integer = nb::steal(PyNumber_Index(object));
        if (!integer.is_valid()) {
            forget_error();
            refuse(object, "of type " + type_name_of(object));
        }
        return from_integer(object, integer.ptr());
    }
    const nb::module_ datetime = nb::module_::import_("datetime");
    if (nb::isinstance(object, datetime.attr("datetime"))) {
        const nb::object convert = nb::module_::import_("tfdb.data.stamps").attr("from_datetime");
        return nb::cast<StampNs>(convert(nb::handle(object)));
    }
    // pandas' Timedelta has `nanoseconds`, which is only its last three digits.
    if (!nb::isinstance(object, datetime.attr("timedelta"))) {
        if (const auto stamp = from_whole(object)) {
            return *stamp;
        }
    }
    refuse(object, "of type " + type_name_of(object));
}

StampNs duration_of(nb::handle seconds, const char* role) {
    const double value = PyBool_Check(seconds.ptr()) ? -1.0 : PyFloat_AsDouble(seconds.ptr());
    if (value == -1.0 && PyErr_Occurred() != nullptr) {
        forget_error();
    }
    const auto nanoseconds = clock::nanoseconds_from_seconds(value);
    if (!nanoseconds || !(value >= 0.0)) {
        throw_error("InvalidArgument",
                    std::string(role) +
                        " must be a number of seconds from 0 to 9223372036 (292 years), got " +
                        short_repr(seconds),
                    {{"value", nb::borrow(seconds)}});
    }
    return *nanoseconds;
}

}  // namespace tfdb::python
