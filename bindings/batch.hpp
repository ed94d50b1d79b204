// Common parts of batches and velocities of a store and of a transaction.
#pragma once

#include <nanobind/nanobind.h>

#include <cstddef>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "arrays.hpp"
#include "reads.hpp"

namespace nb = nanobind;

namespace tfdb::python {

/// From this size on a batch takes so long that other threads should run: about 0.1 ms.
inline constexpr std::size_t kReleaseFromRows = 8192;
/// The same for edges at one stamp.
inline constexpr std::size_t kReleaseFromEdges = 1024;
/// Below this size a batch ends before a signal could matter.
inline constexpr std::size_t kQuickRows = 128;

/// The arguments of `lookup_velocity`, with checked types.
struct VelocityWanted {
    VelocityWanted(nb::handle target, nb::handle source, nb::handle when, nb::handle interval,
                   nb::handle reference, nb::handle point, nb::handle point_frame);

    /// The answer of `reads`, a store or a transaction.
    template <class From>
    [[nodiscard]] Twist of(From& reads) const {
        return reads.lookup_velocity(target, source, stamp, interval, reference, point,
                                     point_frame);
    }

    std::string_view target;
    std::string_view source;
    std::optional<StampNs> stamp;
    StampNs interval;
    std::string_view reference;
    geometry::Vec3 point;
    std::string_view point_frame;
};

/// Points in the core's form: rows of three adjacent numbers.
struct Points {
    ArrayView view;
    nb::object array;
    std::size_t count;
    std::size_t stride;  // in elements
};

/// The checked arguments of `transform_points`, and the output points.
struct PointsWanted {
    PointsWanted(nb::handle target, nb::handle source, nb::handle points, nb::handle stamps,
                 nb::handle policy, nb::handle out, nb::handle missing);

    /// Transforms the points by `reads`, a store or a transaction.
    template <class From>
    void move_with(From& reads) const {
        if (from.view.kind() == Kind::kFloat32) {
            move_as<float>(reads);
        } else {
            move_as<double>(reads);
        }
    }

    std::string_view target;
    std::string_view source;
    Policy policy;
    Missing missing;
    Points from;
    std::optional<Stamps> many;
    StampNs one = 0;
    Points to;

private:
    template <class Real, class From>
    void move_as(From& reads) const {
        const std::span<const StampNs> when =
            many ? many->values() : std::span<const StampNs>(&one, 1);
        reads.transform_points(target, source, from.view.data<const Real>(), from.stride,
                               from.count, when, policy, missing, to.view.data<Real>(), to.stride);
    }
};

/// Binds `lookup_velocity` to a class, with the common signature of all reads.
template <class Type, class Function>
void bind_velocity(Type& type, Function function, const char* doc) {
    type.def("lookup_velocity", function, nb::arg("target").none(), nb::arg("source").none(),
             nb::arg("stamp") = nb::none(), nb::arg("interval").none() = 0.1, nb::kw_only(),
             nb::arg("reference") = nb::none(), nb::arg("point").none() = nb::make_tuple(0, 0, 0),
             nb::arg("point_frame") = nb::none(),
             nb::sig("def lookup_velocity(self, target: str, source: str, stamp: "
                     "tfdb.types.StampLike | None = None, interval: float = 0.1, *, reference: "
                     "str | None = None, point: tfdb.types.VectorLike = (0, 0, 0), point_frame: "
                     "str | None = None) -> tfdb.types.Twist"),
             doc);
}

/// Binds `transform_points` to a class, with the common signature of all reads.
template <class Type, class Function>
void bind_transform_points(Type& type, Function function, const char* doc) {
    type.def("transform_points", function, nb::arg("target").none(), nb::arg("source").none(),
             nb::arg("points").none(), nb::arg("stamps").none(), nb::arg("policy") = nb::none(),
             nb::kw_only(), nb::arg("out") = nb::none(), nb::arg("missing") = "raise",
             nb::sig("def transform_points(self, target: str, source: str, points: "
                     "numpy.typing.ArrayLike, stamps: tfdb.types.StampsLike | "
                     "tfdb.types.StampLike, policy: Policy | None = None, *, out: "
                     "numpy.typing.NDArray[typing.Any] | None = None, missing: "
                     "typing.Literal['raise', 'nan'] = 'raise') -> "
                     "numpy.typing.NDArray[typing.Any]"),
             doc);
}

/// The checked arguments of `lookup_edges`, and the output rows.
class EdgesWanted {
public:
    /// Throws TypeError, InvalidName, InvalidArgument, InvalidStamp, InvalidArray.
    EdgesWanted(nb::handle names, nb::handle when, nb::handle how, nb::handle out, nb::handle dtype,
                nb::handle absent);

    [[nodiscard]] std::size_t size() const { return frames_.size(); }
    [[nodiscard]] const nb::object& array() const { return array_; }
    /// Fills the rows from `reads`, a store or a transaction.
    template <class From>
    void fill_from(From& reads) {
        if (doubles_ != nullptr) {
            fill_rows(reads, doubles_);
        } else {
            fill_rows(reads, floats_);
        }
    }

private:
    void read_names(nb::handle names);
    void make_rows(nb::handle out, nb::handle dtype);
    template <class From, class Real>
    void fill_rows(From& reads, Real* rows) {
        reads.lookup_edges(std::span(frames_), stamp_, policy_, missing_,
                           std::span(rows, 7 * frames_.size()));
    }

    nb::object kept_;  // the names
    std::vector<FrameRef> frames_;
    std::optional<StampNs> stamp_;
    Policy policy_;
    Missing missing_;
    std::optional<ArrayView> view_;  // of `out`, held so that its memory does not move
    nb::object array_;
    double* doubles_ = nullptr;  // exactly one of the two is set
    float* floats_ = nullptr;
};

/// Binds `lookup_edges` to a class, with the common signature of all reads.
template <class Type, class Function>
void bind_lookup_edges(Type& type, Function function, const char* doc) {
    type.def("lookup_edges", function, nb::arg("frames").none(), nb::arg("stamp") = nb::none(),
             nb::arg("policy") = nb::none(), nb::kw_only(), nb::arg("out") = nb::none(),
             nb::arg("dtype") = nb::none(), nb::arg("missing").none() = "nan",
             nb::sig("def lookup_edges(self, frames: collections.abc.Iterable[str], stamp: "
                     "tfdb.types.StampLike | None = None, policy: Policy | None = None, *, out: "
                     "numpy.typing.NDArray[typing.Any] | None = None, dtype: "
                     "numpy.typing.DTypeLike = None, missing: typing.Literal['raise', 'nan'] = "
                     "'nan') -> numpy.typing.NDArray[typing.Any]"),
             doc);
}

/// The checked arguments of `lookup_transforms`, and the output rows.
struct RowsWanted {
    /// The last three may be null for their defaults. Throws InvalidArgument, InvalidStamp,
    /// InvalidArray.
    RowsWanted(nb::handle target, nb::handle source, nb::handle stamps, nb::handle policy,
               nb::handle layout, nb::handle out, nb::handle missing);

    std::string_view target;
    std::string_view source;
    Layout layout;
    Missing missing;
    Policy policy;
    Stamps stamps;
    std::optional<ArrayView> kept;  // of `out`, held so that its memory does not move
    NewArray<double> result;

    [[nodiscard]] std::span<double> rows() const {
        return {result.data, stamps.values().size() * (layout == Layout::kPose ? 7 : 16)};
    }
};

}  // namespace tfdb::python
