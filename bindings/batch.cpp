// Batches of stamps and points: checks the arrays, then calls the core once.
#include <algorithm>
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "arrays.hpp"
#include "batch.hpp"
#include "errors.hpp"
#include "pose.hpp"
#include "reads.hpp"
#include "stamp.hpp"

namespace tfdb::python {
namespace {

Layout layout_of(nb::handle layout) {
    if (!layout.is_valid()) {
        return Layout::kPose;
    }
    const std::string name = option_of(layout, "layout");
    if (name != "pose" && name != "matrix") {
        throw_not_one_of("layout", {"pose", "matrix"}, layout);
    }
    return name == "pose" ? Layout::kPose : Layout::kMatrix;
}

Missing missing_of(nb::handle missing) {
    if (!missing.is_valid()) {
        return Missing::kThrow;
    }
    const std::string name = option_of(missing, "missing");
    if (name != "raise" && name != "nan") {
        throw_not_one_of("missing", {"raise", "nan"}, missing);
    }
    return name == "raise" ? Missing::kThrow : Missing::kNan;
}

/// A new array for the rows, or `out` if it has the right type and shape; `kept` then holds it.
NewArray<double> rows_for(nb::handle out, std::size_t count, Layout layout,
                          std::optional<ArrayView>& kept) {
    const std::array<std::size_t, 3> matrices = {count, 4, 4};
    const std::array<std::size_t, 2> poses = {count, 7};
    const bool as_matrices = layout == Layout::kMatrix;
    if (!is_given(out.ptr())) {
        return as_matrices ? new_doubles({count, 4, 4}) : new_doubles({count, 7});
    }
    const std::span<const std::size_t> shape =
        as_matrices ? std::span<const std::size_t>(matrices) : poses;
    if (double* const plain = plain_doubles(out, shape); plain != nullptr) {
        return {nb::borrow(out), plain};
    }
    kept = ArrayView::of(out, true);
    bool fits = kept && kept->kind() == Kind::kFloat64 && kept->contiguous() &&
                kept->dimensions() == static_cast<int>(shape.size());
    for (std::size_t i = 0; fits && i < shape.size(); ++i) {
        fits = kept->extent(static_cast<int>(i)) == shape[i];
    }
    if (!fits) {
        const std::string text =
            std::to_string(count) + (as_matrices ? std::string(", 4, 4)") : std::string(", 7)"));
        throw_bad_array("out", "a writable, C-contiguous array of float64 (" + text, describe(out));
    }
    return {nb::borrow(out), kept->data<double>()};
}

constexpr std::array<std::string_view, 7> kBatchNames = {"target", "source", "stamps", "policy",
                                                         "layout", "out",    "missing"};

PyObject* lookup_transforms(PyObject* self, PyObject* const* args, Py_ssize_t count,
                            PyObject* keywords) {
    return guarded([&]() -> PyObject* {
        constexpr ParameterList kList{"lookup_transforms", kBatchNames, 3, 4};
        const auto [target, source, stamps, policy, layout, out, missing] =
            bind<7>(kList, args, count, keywords);
        const StoreReaderObject& object = made_reads(self);
        const Pinned pinned = pin(self, object);
        const RowsWanted wanted(target, source, stamps, policy, layout, out, missing);
        const std::span<const StampNs> when = wanted.stamps.values();
        FrameRef into = object.names->find(target, "target");
        FrameRef from = object.names->find(source, "source");
        into.name = wanted.target;
        from.name = wanted.source;
        {
            std::optional<LongWork> work;
            if (pinned.may_wait() || when.size() > kQuickRows) {
                work.emplace(pinned.may_wait() || when.size() >= kReleaseFromRows);
            }
            pinned.reads.lookup_many(into, from, when, wanted.policy, wanted.layout, wanted.missing,
                                     wanted.rows());
        }
        object.names->remember(target, into.handle);
        object.names->remember(source, from.handle);
        return Py_NewRef(wanted.result.array.ptr());
    });
}

bool is_integer(const ArrayView& view) {
    return view.kind() == Kind::kInt64 || view.kind() == Kind::kOtherInteger;
}

/// `writable` points must fit as they are. Others become float64 if they are integers or no array.
Points points_of(nb::handle object, const char* role, bool writable) {
    const char* expected = writable ? "an array (N, 3) of float32 or float64"
                                    : "an array (N, 3) of float32, float64 or integers";
    nb::object array = nb::borrow(object);
    std::optional<ArrayView> view = ArrayView::of(array, writable);
    if (!writable && (!view || is_integer(*view))) {
        view.emplace(as_doubles(object, role, array));
    }
    if (!view) {
        throw_bad_array(role, std::string(expected) + ", writable", describe(object));
    }
    const bool floats = view->kind() == Kind::kFloat32 || view->kind() == Kind::kFloat64;
    if (!floats || view->dimensions() != 2 || view->extent(1) != 3) {
        throw_bad_array(role, expected, describe(object));
    }
    const Py_ssize_t item = view->kind() == Kind::kFloat32 ? sizeof(float) : sizeof(double);
    const std::size_t count = view->extent(0);
    const bool whole = count == 0 || (view->stride(1) == item && view->stride(0) % item == 0 &&
                                      (count == 1 || view->stride(0) >= 3 * item));
    if (!whole) {
        throw_bad_array(
            role,
            std::string(expected) + " whose rows do not overlap and whose x, y, z lie side by side",
            describe(object) + " with strides (" + std::to_string(view->stride(0)) + ", " +
                std::to_string(view->stride(1)) + ")");
    }
    const std::size_t stride =
        count == 0 ? 3 : static_cast<std::size_t>(std::max(view->stride(0), 3 * item) / item);
    return {std::move(*view), std::move(array), count, stride};
}

/// `out` may be the points themselves or memory apart from them, but must not overlap them partly.
void check_out(const Points& points, const Points& out, nb::handle object) {
    const char* dtype = points.view.kind() == Kind::kFloat32 ? "float32" : "float64";
    if (out.view.kind() != points.view.kind() || out.count != points.count) {
        throw_bad_array(
            "out",
            "an array (" + std::to_string(points.count) + ", 3) of " + dtype + " like the points",
            describe(object));
    }
    const auto [low, high] = points.view.range();
    const auto [out_low, out_high] = out.view.range();
    const bool apart = out_high <= low || high <= out_low;
    const bool same = low == out_low && points.stride == out.stride;
    if (!apart && !same) {
        throw_bad_array("out", "the points themselves or memory that does not overlap them",
                        "memory that overlaps them in part");
    }
}

/// Zero-dimensional arrays only look iterable.
bool is_one_stamp(nb::handle stamps) {
    if (nb::hasattr(stamps, "ndim")) {
        return nb::object(stamps.attr("ndim")).equal(nb::int_(0));
    }
    return !PySequence_Check(stamps.ptr()) && !nb::hasattr(stamps, "__iter__");
}

/// An array like the points, if none is given.
Points points_out(const Points& from, nb::handle out) {
    nb::object array = nb::borrow(out);
    if (out.is_none()) {
        array = from.view.kind() == Kind::kFloat32 ? new_floats({from.count, 3}).array
                                                   : new_doubles({from.count, 3}).array;
    }
    Points to = points_of(array, "out", true);
    check_out(from, to, array);
    return to;
}

nb::object transform_points(nb::handle self, nb::handle target, nb::handle source,
                            nb::handle points, nb::handle stamps, nb::handle policy, nb::handle out,
                            nb::handle missing) {
    const Pinned pinned = pin(self, object_of<StoreReaderObject>(self));
    const PointsWanted wanted(target, source, points, stamps, policy, out, missing);
    {
        const LongWork work(pinned.may_wait() || wanted.from.count >= kReleaseFromRows);
        wanted.move_with(pinned.reads);
    }
    return wanted.to.array;
}

nb::object lookup_edges(nb::handle self, nb::handle frames, nb::handle stamp, nb::handle policy,
                        nb::handle out, nb::handle dtype, nb::handle missing) {
    const Pinned pinned = pin(self, object_of<StoreReaderObject>(self));
    EdgesWanted wanted(frames, stamp, policy, out, dtype, missing);
    {
        const LongWork work(pinned.may_wait() || wanted.size() >= kReleaseFromEdges);
        wanted.fill_from(pinned.reads);
    }
    return wanted.array();
}

/// Whether float32 is requested; none: no type is given. Throws InvalidArgument for other types.
std::optional<bool> wants_floats(nb::handle dtype) {
    if (dtype.is_none()) {
        return std::nullopt;
    }
    const nb::object make = nb::module_::import_("numpy").attr("dtype");
    const nb::object given =
        nb::steal(PyObject_CallFunctionObjArgs(make.ptr(), dtype.ptr(), nullptr));
    if (!given.is_valid()) {
        forget_error();
    }
    const bool floats = given.is_valid() && given.equal(make("float32"));
    if (!floats && !(given.is_valid() && given.equal(make("float64")))) {
        throw_error("InvalidArgument",
                    "dtype must be numpy.float64 or numpy.float32, got " + short_repr(dtype),
                    {{"value", nb::borrow(dtype)}});
    }
    return floats;
}

std::string_view optional_name_of(nb::handle name, const char* role) {
    return name.is_none() ? std::string_view() : name_of(name, role);
}

constexpr const char* kLookupTransformsDoc =
    R"(lookup_transforms($self, target, source, stamps, policy=None, *, layout='pose', out=None, missing='raise')
--

T[target<-source] at each of N stamps, all from one snapshot.

Row i equals `lookup_transform(target, source, stamps[i], policy)` in that snapshot, bit for bit, on
every processor. A result that is a single stored sample equals that sample.

Parameters
----------
target, source
    Frame names.
stamps
    (N,) int64 nanoseconds or datetime64, or a list of stamps; in any order.
policy
    How a pose between samples is computed. None: Interpolate().
layout
    `pose`: rows x y z qx qy qz qw. `matrix`: homogeneous 4x4 matrices, as `Transform.matrix`.
out
    Array to write to: float64, C-contiguous, (N, 7) or (N, 4, 4), apart from the stamps in memory.
    An error, or Ctrl-C, may leave it partly written.
missing
    `raise`: raise the error of the first stamp without a pose, with its `index`. `nan`: its row
    becomes NaN, for any reason except an unknown frame, which raises.

Returns
-------
numpy.ndarray
    `out`, or a new float64 array (N, 7) or (N, 4, 4).

Raises InvalidArray, InvalidStamp, InvalidArgument, and what `lookup_transform` raises.)";

PyMethodDef g_lookup_transforms = {"lookup_transforms", as_function(lookup_transforms),
                                   METH_FASTCALL | METH_KEYWORDS, kLookupTransformsDoc};

constexpr const char* kLookupEdgesDoc =
    R"(T[parent<-frame] of many frames at one stamp, all from one snapshot.

Row i equals `lookup_transform(parent, frames[i], stamp, policy)` in that snapshot, bit for bit.
`parent` is the frame's parent at that stamp: `parent_of(frames[i], stamp)`, or
`tree_columns(stamp).parents` for all. Frames above the parent are not read.

Parameters
----------
frames
    Frame names.
stamp
    Nanoseconds, the same for all. None: each edge's newest sample.
policy
    How a pose between samples is computed. None: Interpolate().
out
    Array to write to: float64 or float32, C-contiguous, (N, 7). An error, or Ctrl-C, may leave it
    partly written.
dtype
    `numpy.float64` or `numpy.float32`, which rounds. None: that of `out`, or float64.
missing
    `nan`: NaN in the row of a frame that does not exist, is a root at that stamp or has no data
    there. `raise`: the error of the first of them, with its `index`.

Returns
-------
numpy.ndarray
    `out`, or a new array (N, 7): x y z qx qy qz qw.

Raises InvalidArray, InvalidArgument, InvalidStamp; with `missing="raise"` UnknownFrame, Disconnected
(a root), and what else `lookup_transform` raises.)";

constexpr const char* kTransformPointsDoc =
    R"(Map points of `source` into `target`, each at its own stamp.

Undoes the motion during a scan: `p_target[i] = T[target<-source](stamps[i]) p_source[i]`, all from
one snapshot. Row i equals `lookup_transform(target, source, stamps[i], policy).apply(points[i])`
there, bit for bit. NaN coordinates stay NaN. A result too large for the points' dtype is infinite
or NaN; `apply` raises for it.

Parameters
----------
target, source
    Frame names.
points
    (N, 3), float32 or float64; integers become float64. Rows may be strided, as in `cloud[:, :3]`.
stamps
    (N,) int64 nanoseconds, or one stamp for all points.
policy
    How a pose between samples is computed. None: Interpolate().
out
    Array to write to, with the shape and dtype of the points; float64 for integers. It may be the
    points themselves. It must not overlap a part of them, nor the stamps.
missing
    `raise`: raise the error of the first stamp without a pose, with its `index`. `nan`: its points
    become NaN, for any reason except an unknown frame, which raises.

Returns
-------
numpy.ndarray
    `out`, or a new array (N, 3) of the points' dtype. Computed in float64.

Raises InvalidArray, InvalidStamp, InvalidArgument, and what `lookup_transform` raises, with
`index`.)";

}  // namespace

RowsWanted::RowsWanted(nb::handle target_name, nb::handle source_name, nb::handle when,
                       nb::handle how, nb::handle rows, nb::handle out, nb::handle absent)
    : target(name_of(target_name, "target")),
      source(name_of(source_name, "source")),
      layout(layout_of(rows)),
      missing(missing_of(absent)),
      policy(policy_of(how.ptr())),
      stamps(when),
      result(rows_for(out, stamps.values().size(), layout, kept)) {
    if (is_given(out.ptr())) {
        stamps.check_apart(out);
    }
}

PointsWanted::PointsWanted(nb::handle target_name, nb::handle source_name, nb::handle points,
                           nb::handle stamps, nb::handle how, nb::handle out, nb::handle absent)
    : policy(policy_of(how.ptr())),
      missing(Missing::kThrow),
      from(points_of(points, "points", false)),
      to{} {
    if (is_one_stamp(stamps)) {
        one = stamp_of(stamps.ptr());
    } else {
        many.emplace(stamps);
        if (const std::size_t given = many->values().size(); given != from.count) {
            throw_bad_array(
                "stamps",
                "one stamp, or one for each of the " + std::to_string(from.count) + " points",
                std::to_string(given) + " stamps");
        }
    }
    to = points_out(from, out);
    if (many && !out.is_none()) {
        many->check_apart(out);
    }
    target = name_of(target_name, "target");
    source = name_of(source_name, "source");
    missing = missing_of(absent);
}

EdgesWanted::EdgesWanted(nb::handle names, nb::handle when, nb::handle how, nb::handle out,
                         nb::handle dtype, nb::handle absent)
    : stamp_(optional_stamp_of(when.ptr())),
      policy_(policy_of(how.ptr())),
      missing_(missing_of(absent)) {
    read_names(names);
    make_rows(out, dtype);
}

void EdgesWanted::read_names(nb::handle names) {
    constexpr const char* kWanted = "a sequence of frames' names";
    if (PyUnicode_Check(names.ptr())) {
        PyErr_SetString(PyExc_TypeError,
                        "frames must be a sequence of frames' names, got a single str: for one "
                        "frame write [frame]");
        throw nb::python_error();
    }
    check_many(names, "frames", kWanted);
    kept_ = read_items(names, frames_,
                       [](PyObject* item) { return FrameRef{name_of(item, "frames")}; });
}

void EdgesWanted::make_rows(nb::handle out, nb::handle dtype) {
    const std::optional<bool> floats = wants_floats(dtype);
    const std::size_t count = frames_.size();
    if (out.is_none()) {
        if (floats.value_or(false)) {
            const NewArray<float> made = new_floats({count, 7});
            array_ = made.array;
            floats_ = made.data;
        } else {
            const NewArray<double> made = new_doubles({count, 7});
            array_ = made.array;
            doubles_ = made.data;
        }
        return;
    }
    view_ = ArrayView::of(out, true);
    const bool fits = view_ && view_->contiguous() && view_->dimensions() == 2 &&
                      view_->extent(0) == count && view_->extent(1) == 7;
    const bool single = fits && view_->kind() == Kind::kFloat32;
    if (!fits || (!single && view_->kind() != Kind::kFloat64) ||
        floats.value_or(single) != single) {
        const std::string type = !floats ? "float64 or float32" : *floats ? "float32" : "float64";
        throw_bad_array(
            "out",
            "a writable, C-contiguous array of " + type + " (" + std::to_string(count) + ", 7)",
            describe(out));
    }
    array_ = nb::borrow(out);
    if (single) {
        floats_ = view_->data<float>();
    } else {
        doubles_ = view_->data<double>();
    }
}

VelocityWanted::VelocityWanted(nb::handle target_name, nb::handle source_name, nb::handle when,
                               nb::handle length, nb::handle axes, nb::handle where,
                               nb::handle where_frame)
    : target(name_of(target_name, "target")),
      source(name_of(source_name, "source")),
      stamp(optional_stamp_of(when.ptr())),
      interval(duration_of(length, "interval")),
      reference(optional_name_of(axes, "reference")),
      point(vector_of(where.ptr(), "point")),
      point_frame(optional_name_of(where_frame, "point_frame")) {}

void add_raw_batch(nb::handle type) {
    add_raw_method(type, g_lookup_transforms);
}

void bind_batch(nb::class_<StoreReaderObject>& type) {
    bind_lookup_edges(type, &lookup_edges, kLookupEdgesDoc);
    bind_transform_points(type, &transform_points, kTransformPointsDoc);
}

}  // namespace tfdb::python
