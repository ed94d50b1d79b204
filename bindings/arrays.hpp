// Input arrays through the buffer protocol, and output arrays of numpy.
#pragma once

#include <nanobind/nanobind.h>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "numpy.hpp"
#include "tfdb/clock/stamp.hpp"

namespace nb = nanobind;

namespace tfdb::python {

using clock::StampNs;

enum class Kind : std::uint8_t { kFloat32, kFloat64, kInt64, kOtherInteger, kOther };

/// A view of an object's memory. Threads: one. Guarantee: the memory does not move while the view
/// lives, even without the GIL; the view must be destroyed with the GIL.
class ArrayView {
public:
    ArrayView() = default;
    ArrayView(ArrayView&& other) noexcept;
    ArrayView& operator=(ArrayView&& other) noexcept;
    ~ArrayView();

    /// A view of the object's own memory, writable if requested; empty if the object does not
    /// export it.
    static std::optional<ArrayView> of(nb::handle object, bool writable);

    [[nodiscard]] Kind kind() const { return kind_; }
    [[nodiscard]] int dimensions() const { return view_.ndim; }
    [[nodiscard]] std::size_t extent(int axis) const {
        return static_cast<std::size_t>(view_.shape[axis]);
    }
    [[nodiscard]] Py_ssize_t stride(int axis) const { return view_.strides[axis]; }
    [[nodiscard]] bool contiguous() const { return PyBuffer_IsContiguous(&view_, 'C') != 0; }
    template <class T>
    [[nodiscard]] T* data() const {
        return static_cast<T*>(view_.buf);
    }
    /// First byte and end of the viewed memory.
    [[nodiscard]] std::pair<const char*, const char*> range() const;
    /// "float64 (3, 7)"
    [[nodiscard]] std::string describe() const;

private:
    void take(ArrayView& other);
    void give_back();

    Py_buffer view_{};
    Kind kind_ = Kind::kOther;
};

/// Stamps from an array or a sequence. Guarantee: every stamp is >= 0.
class Stamps {
public:
    /// Throws InvalidArray (shape, dtype) and InvalidStamp (with index).
    explicit Stamps(nb::handle object);

    [[nodiscard]] std::span<const StampNs> values() const { return values_; }
    /// Throws InvalidArgument if writing to `out` would change the given array, even if these
    /// stamps are a copy of it.
    void check_apart(nb::handle out) const;

private:
    void read_array(nb::handle object);
    void read_sequence(nb::handle object);

    std::optional<ArrayView> view_;
    std::vector<StampNs> copy_;
    nb::object array_;   // the given array, or its conversion
    nb::object copied_;  // the given array, if `values_` are a copy
    std::span<const StampNs> values_;
};

/// Whether a store accepts all of these stamps.
bool are_in_range(std::span<const StampNs> stamps);

/// A contiguous view of `object` as float64, converted and kept in `keep` if necessary. Throws
/// InvalidArray, which names the expected value of `role`.
ArrayView as_doubles(nb::handle object, const std::string& role, nb::object& keep);

[[noreturn]] void throw_bad_array(const std::string& role, const std::string& expected,
                                  const std::string& got);
/// A description for "got ...": dtype and shape, or the type.
std::string describe(nb::handle object);

}  // namespace tfdb::python
