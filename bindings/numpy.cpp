#include "numpy.hpp"

#include <nanobind/stl/string.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <memory>
#include <string>

namespace tfdb::python {
namespace {

// Constants of numpy's headers, equal for numpy 1 and 2: type numbers, flags, the first fields of
// an array, and indices in the function table that it exports to other extensions.
enum TypeNumber : int { kBool = 0, kInt64 = 7, kFloat32 = 11, kFloat64 = 12 };
static_assert(sizeof(bool) == 1, "as numpy's");
static_assert(sizeof(long) == sizeof(clock::StampNs), "7 is the number of a long");
constexpr int kContiguous = 0x0001;
constexpr int kAligned = 0x0100;
constexpr int kWriteable = 0x0400;
constexpr int kWarnsOnWrite = static_cast<int>(1U << 31U);

struct ArrayFields {
    PyObject_HEAD char* data;
    int axes;
    Py_ssize_t* extents;
    Py_ssize_t* strides;
    PyObject* base;
    PyObject* dtype;
    int flags;
};

using GetVersion = unsigned (*)();
using MakeArray = PyObject* (*)(PyTypeObject*, int, const Py_ssize_t*, int, const Py_ssize_t*,
                                void*, int, int, PyObject*);
constexpr std::size_t kGetVersion = 0;
constexpr std::size_t kArrayType = 2;
constexpr std::size_t kMakeArray = 93;

/// The used parts of numpy; references for the life of the process.
struct Numpy {
    PyTypeObject* array_type;
    MakeArray make;
    PyObject* ascontiguousarray;
    PyObject* float64;
    PyObject* int64;
};
// Set once, at the first use, so that programs without arrays do not import numpy.
std::atomic<const Numpy*> g_numpy{nullptr};

const Numpy& find_numpy() {
    const nb::module_ numpy = nb::module_::import_("numpy");
    const bool first = nb::cast<std::string>(numpy.attr("__version__")).starts_with("1.");
    const nb::object capsule = nb::module_::import_(first ? "numpy.core._multiarray_umath"
                                                          : "numpy._core._multiarray_umath")
                                   .attr("_ARRAY_API");
    auto* const table = static_cast<void**>(PyCapsule_GetPointer(capsule.ptr(), nullptr));
    if (table == nullptr) {
        throw nb::python_error();
    }
    const unsigned abi = reinterpret_cast<GetVersion>(table[kGetVersion])() >> 24U;
    if (abi != 1 && abi != 2) {
        PyErr_SetString(PyExc_ImportError,
                        "tfdb needs numpy 1 or 2: this one has another C interface");
        throw nb::python_error();
    }
    auto found = std::make_unique<Numpy>();
    found->array_type = static_cast<PyTypeObject*>(table[kArrayType]);
    found->make = reinterpret_cast<MakeArray>(table[kMakeArray]);
    nb::object contiguous = numpy.attr("ascontiguousarray");
    nb::object float64 = numpy.attr("dtype")("float64");
    nb::object int64 = numpy.attr("dtype")("int64");
    found->ascontiguousarray = contiguous.ptr();
    found->float64 = float64.ptr();
    found->int64 = int64.ptr();
    // Another thread may have set it meanwhile, to equal values.
    const Numpy* known = nullptr;
    if (!g_numpy.compare_exchange_strong(known, found.get())) {
        return *known;
    }
    static_cast<void>(contiguous.release());
    static_cast<void>(float64.release());
    static_cast<void>(int64.release());
    return *found.release();
}

const Numpy& numpy() {
    const Numpy* const known = g_numpy.load();
    return known != nullptr ? *known : find_numpy();
}

ArrayFields& fields_of(nb::handle array) {
    return *reinterpret_cast<ArrayFields*>(array.ptr());
}

/// Null unless it is an array with exactly this number of axes, this type, and these flags.
const ArrayFields* plain_fields(nb::handle object, std::size_t axes, PyObject* Numpy::*dtype,
                                int flags) {
    const Numpy& known = numpy();
    if (Py_TYPE(object.ptr()) != known.array_type) {
        return nullptr;
    }
    const ArrayFields& fields = fields_of(object);
    const int needed = kContiguous | kAligned | flags;
    const bool plain = static_cast<std::size_t>(fields.axes) == axes &&
                       fields.dtype == known.*dtype &&
                       (fields.flags & (needed | kWarnsOnWrite)) == needed;
    return plain ? &fields : nullptr;
}

template <class T>
NewArray<T> make_array(TypeNumber type, std::initializer_list<std::size_t> shape) {
    std::array<Py_ssize_t, 3> extents{};
    std::transform(shape.begin(), shape.end(), extents.begin(),
                   [](std::size_t extent) { return static_cast<Py_ssize_t>(extent); });
    const Numpy& known = numpy();
    nb::object array = nb::steal(known.make(known.array_type, static_cast<int>(shape.size()),
                                            extents.data(), type, nullptr, nullptr, 0, 0, nullptr));
    if (!array.is_valid()) {
        throw nb::python_error();
    }
    T* const data = reinterpret_cast<T*>(fields_of(array).data);
    return {std::move(array), data};
}

}  // namespace

NewArray<double> new_doubles(std::initializer_list<std::size_t> shape) {
    return make_array<double>(kFloat64, shape);
}

NewArray<float> new_floats(std::initializer_list<std::size_t> shape) {
    return make_array<float>(kFloat32, shape);
}

NewArray<clock::StampNs> new_stamps(std::size_t count) {
    return make_array<clock::StampNs>(kInt64, {count});
}

NewArray<bool> new_flags(std::size_t count) {
    return make_array<bool>(kBool, {count});
}

std::optional<std::span<const clock::StampNs>> plain_stamps(nb::handle object) {
    const ArrayFields* const fields = plain_fields(object, 1, &Numpy::int64, 0);
    if (fields == nullptr) {
        return std::nullopt;
    }
    return std::span(reinterpret_cast<const clock::StampNs*>(fields->data),
                     static_cast<std::size_t>(fields->extents[0]));
}

double* plain_doubles(nb::handle object, std::span<const std::size_t> shape) {
    const ArrayFields* const fields =
        plain_fields(object, shape.size(), &Numpy::float64, kWriteable);
    const auto fits = [](std::size_t wanted, Py_ssize_t extent) {
        return static_cast<Py_ssize_t>(wanted) == extent;
    };
    if (fields == nullptr || !std::equal(shape.begin(), shape.end(), fields->extents, fits)) {
        return nullptr;
    }
    return reinterpret_cast<double*>(fields->data);
}

nb::object read_only(nb::object array) {
    fields_of(array).flags &= ~kWriteable;
    return array;
}

bool is_plain_array(nb::handle object) {
    const Numpy* const known = g_numpy.load();
    return known != nullptr && Py_TYPE(object.ptr()) == known->array_type;
}

nb::object contiguous_doubles(nb::handle object) {
    const Numpy& known = numpy();
    const std::array<PyObject*, 2> arguments = {object.ptr(), known.float64};
    return nb::steal(
        PyObject_Vectorcall(known.ascontiguousarray, arguments.data(), arguments.size(), nullptr));
}

}  // namespace tfdb::python
