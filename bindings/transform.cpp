#include "transform.hpp"

#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>

#include <array>
#include <cmath>
#include <cstring>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "arguments.hpp"
#include "arrays.hpp"
#include "errors.hpp"
#include "pose.hpp"
#include "stamp.hpp"
#include "tfdb/geometry/from_matrix.hpp"
#include "tfdb/store/buffer.hpp"

namespace tfdb::python {
namespace {

PyTypeObject* g_type = nullptr;

TransformObject& as_transform(PyObject* object) {
    return *reinterpret_cast<TransformObject*>(object);
}

// In the order of lookup::Used.
constexpr std::array kUsedNames = {"static",  "exact",        "interpolated", "held",
                                   "nearest", "extrapolated", "latest"};

/// A report row per edge: (child, parent, used, before, after, inverted).
nb::tuple edge_rows(TransformObject& self) {
    nb::list rows;
    Py_ssize_t name = 0;
    for (const EdgeUse& edge : self.edges()) {
        const nb::handle child = NB_TUPLE_GET_ITEM(self.names, name++);
        const nb::handle parent = NB_TUPLE_GET_ITEM(self.names, name++);
        rows.append(nb::make_tuple(child, parent, kUsedNames[static_cast<std::size_t>(edge.used)],
                                   edge.before, edge.after, edge.inverted));
    }
    return nb::tuple(rows);
}

PyObject* doubles(const double* values, std::size_t count) {
    return guarded([&]() -> PyObject* {
        NewArray<double> made = new_doubles({count});
        std::memcpy(made.data, values, count * sizeof(double));
        return read_only(std::move(made.array)).release().ptr();
    });
}

PyObject* get_translation(PyObject* self, void* /*closure*/) {
    return doubles(&as_transform(self).pose.translation.x, 3);
}

PyObject* get_rotation(PyObject* self, void* /*closure*/) {
    return doubles(&as_transform(self).pose.rotation.x, 4);
}

PyObject* get_pose(PyObject* self, void* /*closure*/) {
    return doubles(&as_transform(self).pose.translation.x, 7);
}

PyObject* get_matrix(PyObject* self, void* /*closure*/) {
    return guarded([&]() -> PyObject* {
        const Pose& pose = as_transform(self).pose;
        const auto& [r] = geometry::matrix(pose.rotation);
        const geometry::Vec3& t = pose.translation;
        NewArray<double> made = new_doubles({4, 4});
        auto put = [row = made.data](double a, double b, double c, double d) mutable {
            row[0] = a;
            row[1] = b;
            row[2] = c;
            row[3] = d;
            row += 4;
        };
        put(r[0], r[1], r[2], t.x);
        put(r[3], r[4], r[5], t.y);
        put(r[6], r[7], r[8], t.z);
        put(0.0, 0.0, 0.0, 1.0);
        return read_only(std::move(made.array)).release().ptr();
    });
}

PyObject* get_stamp(PyObject* self, void* /*closure*/) {
    return PyLong_FromLongLong(as_transform(self).stamp);
}

PyObject* get_commit(PyObject* self, void* /*closure*/) {
    return PyLong_FromUnsignedLongLong(as_transform(self).commit);
}

PyObject* get_target(PyObject* self, void* /*closure*/) {
    return Py_NewRef(as_transform(self).target);
}

PyObject* get_source(PyObject* self, void* /*closure*/) {
    return Py_NewRef(as_transform(self).source);
}

PyObject* get_report(PyObject* self, void* /*closure*/) {
    return guarded([&]() -> PyObject* {
        TransformObject& transform = as_transform(self);
        const nb::object make = nb::module_::import_("tfdb.store.report").attr("make_report");
        return make(nb::handle(transform.target), nb::handle(transform.source), transform.stamp,
                    edge_rows(transform))
            .release()
            .ptr();
    });
}

/// Throws InvalidName, as the store does.
void check_name(PyObject* name, const char* role) {
    if (const char* fault = store::name_fault(name_of(name, role))) {
        throw_error(
            "InvalidName",
            std::string(role) + " frame name " + short_repr(name) + " " + fault + store::kNameRule,
            {{"value", nb::borrow(name)}, {"reason", nb::str(fault)}});
    }
}

/// The exact str: a subclass instance could refer to other objects. A new reference, or null.
PyObject* new_exact(PyObject* text) {
    return PyUnicode_CheckExact(text) ? Py_NewRef(text) : PyUnicode_FromObject(text);
}

nb::object exact_text(PyObject* text) {
    nb::object exact = nb::steal(new_exact(text));
    if (!exact.is_valid()) {
        throw nb::python_error();
    }
    return exact;
}

/// The pose of a transform created in Python. Throws InvalidTransform.
Pose checked(Pose pose, PyObject* target, PyObject* source, const PoseArguments& given) {
    const double norm = geometry::norm_squared(pose.rotation);
    if (!(std::abs(norm - 1.0) <= 0.01) || !geometry::is_finite(pose)) {
        PyObject* turned = given.rotation;
        turned = is_given(turned) ? turned : is_given(given.rpy) ? given.rpy : given.wxyz;
        throw_error("InvalidTransform",
                    "the translation must be finite and the rotation a unit quaternion "
                    "(x, y, z, w), got " +
                        short_repr(given.translation) + " and " +
                        (is_given(turned) ? short_repr(turned) : "none"),
                    {{"target", nb::borrow(target)}, {"source", nb::borrow(source)}});
    }
    pose.rotation = geometry::normalized(pose.rotation);
    return pose;
}

PyObject* made(PyObject* target, PyObject* source, const PoseArguments& given, PyObject* stamp) {
    check_name(target, "target");
    check_name(source, "source");
    const Pose pose = checked(pose_of(given), target, source, given);
    const StampNs when = is_given(stamp) ? stamp_of(stamp) : 0;
    return new_transform(pose, when, 0, {}, target, source, nullptr);
}

constexpr std::array<std::string_view, 7> kMakeNames = {
    "target", "source", "translation", "rotation", "stamp", "rpy", "wxyz"};

PyObject* new_from_python(PyTypeObject* /*type*/, PyObject* args, PyObject* keywords) {
    return guarded([&]() -> PyObject* {
        constexpr ParameterList kList{"Transform", kMakeNames, 3, 5};
        std::array<PyObject*, kMakeNames.size()> bound{};
        bind_tuple(kList, args, keywords, bound.data());
        const auto [target, source, translation, rotation, stamp, rpy, wxyz] = bound;
        const PoseArguments given{.translation = translation,
                                  .rotation = rotation,
                                  .rpy = rpy,
                                  .wxyz = wxyz,
                                  .target = target,
                                  .source = source};
        return made(target, source, given, stamp);
    });
}

constexpr std::array<std::string_view, 4> kMatrixNames = {"matrix", "target", "source", "stamp"};

PyObject* from_matrix(PyObject* /*type*/, PyObject* const* args, Py_ssize_t count,
                      PyObject* keywords) {
    return guarded([&]() -> PyObject* {
        constexpr ParameterList kList{"from_matrix", kMatrixNames, 3, 4};
        const auto [matrix, target, source, stamp] = bind<4>(kList, args, count, keywords);
        check_name(target, "target");
        check_name(source, "source");
        const PoseArguments given{.translation = matrix, .rotation = nullptr};
        const Pose pose = checked(pose_of_matrix(matrix), target, source, given);
        return new_transform(pose, is_given(stamp) ? stamp_of(stamp) : 0, 0, {}, target, source,
                             nullptr);
    });
}

PyObject* get_rpy(PyObject* self, void* /*closure*/) {
    const geometry::Vec3 rpy = geometry::rpy_of_quaternion(as_transform(self).pose.rotation);
    return doubles(&rpy.x, 3);
}

/// Translation, rotation, roll pitch yaw and the rows of the matrix, without numpy, whose import
/// takes longer than the rest of a command.
PyObject* numbers(PyObject* self, PyObject* /*unused*/) {
    return guarded([&]() -> PyObject* {
        const auto& [t, q] = as_transform(self).pose;
        const auto& [r] = geometry::matrix(q);
        const geometry::Vec3 rpy = geometry::rpy_of_quaternion(q);
        const nb::object rows = nb::make_tuple(
            nb::make_tuple(r[0], r[1], r[2], t.x), nb::make_tuple(r[3], r[4], r[5], t.y),
            nb::make_tuple(r[6], r[7], r[8], t.z), nb::make_tuple(0.0, 0.0, 0.0, 1.0));
        return nb::make_tuple(nb::make_tuple(t.x, t.y, t.z), nb::make_tuple(q.x, q.y, q.z, q.w),
                              nb::make_tuple(rpy.x, rpy.y, rpy.z), rows)
            .release()
            .ptr();
    });
}

PyObject* inverse(PyObject* self, PyObject* const* args, Py_ssize_t count, PyObject* keywords) {
    return guarded([&]() -> PyObject* {
        constexpr ParameterList kList{"inverse", {}, 0, 0};
        bind<0>(kList, args, count, keywords);
        return transform_inverse(self);
    });
}

constexpr std::array<std::string_view, 1> kApplyNames = {"points"};

PyObject* apply(PyObject* self, PyObject* const* args, Py_ssize_t count, PyObject* keywords) {
    return guarded([&]() -> PyObject* {
        constexpr ParameterList kList{"apply", kApplyNames, 1, 1};
        return transform_apply(self, bind<1>(kList, args, count, keywords)[0]);
    });
}

PyObject* to_msg(PyObject* self, PyObject* const* args, Py_ssize_t count, PyObject* keywords) {
    return guarded([&]() -> PyObject* {
        constexpr ParameterList kList{"to_msg", {}, 0, 0};
        bind<0>(kList, args, count, keywords);
        const nb::object make = nb::module_::import_("tfdb.store.report").attr("transform_message");
        return make(nb::handle(self)).release().ptr();
    });
}

PyObject* represent_html(PyObject* self, PyObject* /*unused*/) {
    return guarded([&]() -> PyObject* {
        const nb::object make = nb::module_::import_("tfdb.data.notebooks").attr("of_transform");
        return make(nb::handle(self)).release().ptr();
    });
}

#ifdef Py_GIL_DISABLED

TransformObject* allocate(Py_ssize_t edges) {
    return PyObject_NewVar(TransformObject, g_type, edges);
}
void release(PyObject* freed) {
    PyObject_Free(freed);
}

#else

// Memory of the last freed object: a loop mostly drops a transform before its next lookup.
PyObject* g_spare = nullptr;

TransformObject* allocate(Py_ssize_t edges) {
    if (g_spare == nullptr || Py_SIZE(g_spare) != edges) {
        return PyObject_NewVar(TransformObject, g_type, edges);
    }
    auto* const spare = reinterpret_cast<PyVarObject*>(std::exchange(g_spare, nullptr));
    return reinterpret_cast<TransformObject*>(PyObject_InitVar(spare, g_type, edges));
}
void release(PyObject* freed) {
    PyObject_Free(std::exchange(g_spare, freed));
}

#endif

void deallocate(PyObject* self) {
    TransformObject& transform = as_transform(self);
    PyTypeObject* type = Py_TYPE(self);
    Py_XDECREF(transform.target);
    Py_XDECREF(transform.source);
    Py_XDECREF(transform.names);
    release(self);
    Py_DECREF(type);
}

PyObject* represent(PyObject* self) {
    return guarded([&]() -> PyObject* {
        const nb::object print = nb::module_::import_("tfdb.store.report").attr("transform_repr");
        return print(nb::handle(self)).release().ptr();
    });
}

PyObject* compare(PyObject* left, PyObject* right, int operation) {
    if ((operation != Py_EQ && operation != Py_NE) || !is_transform(left) || !is_transform(right)) {
        Py_RETURN_NOTIMPLEMENTED;
    }
    const TransformObject& a = as_transform(left);
    const TransformObject& b = as_transform(right);
    const int same_target = PyObject_RichCompareBool(a.target, b.target, Py_EQ);
    const int same_source = PyObject_RichCompareBool(a.source, b.source, Py_EQ);
    if (same_target < 0 || same_source < 0) {
        return nullptr;
    }
    bool equal = same_target == 1 && same_source == 1 && a.stamp == b.stamp;
    const double* p = &a.pose.translation.x;
    const double* q = &b.pose.translation.x;
    for (int i = 0; i < 7; ++i) {
        equal = equal && p[i] == q[i];
    }
    return PyBool_FromLong(equal == (operation == Py_EQ) ? 1 : 0);
}

PyObject* reduce(PyObject* self, PyObject* /*unused*/) {
    return guarded([&]() -> PyObject* {
        TransformObject& transform = as_transform(self);
        const nb::object restore =
            nb::module_::import_("tfdb.store.report").attr("restore_transform");
        const auto& [t, q] = transform.pose;
        const nb::tuple pose =
            nb::make_tuple(nb::make_tuple(t.x, t.y, t.z), nb::make_tuple(q.x, q.y, q.z, q.w));
        return nb::make_tuple(
                   restore,
                   nb::make_tuple(nb::handle(transform.target), nb::handle(transform.source), pose,
                                  transform.stamp, transform.commit, edge_rows(transform)))
            .release()
            .ptr();
    });
}

Py_hash_t hash(PyObject* self) {
    const TransformObject& transform = as_transform(self);
    const auto& [t, q] = transform.pose;
    const nb::tuple compared =
        nb::make_tuple(nb::handle(transform.target), nb::handle(transform.source), transform.stamp,
                       nb::make_tuple(t.x, t.y, t.z), nb::make_tuple(q.x, q.y, q.z, q.w));
    return PyObject_Hash(compared.ptr());
}

/// The pose, as numpy requests it: the array is always a new one.
PyObject* as_array(PyObject* self, PyObject* args, PyObject* keywords) {
    return guarded([&]() -> PyObject* {
        static const char* names[] = {"dtype", "copy", nullptr};
        PyObject* dtype = Py_None;
        PyObject* copy = Py_None;
        if (PyArg_ParseTupleAndKeywords(args, keywords, "|OO:__array__", const_cast<char**>(names),
                                        &dtype, &copy) == 0) {
            return nullptr;
        }
        if (copy == Py_False) {
            PyErr_SetString(PyExc_ValueError,
                            "copy=False is not possible: the array of a Transform is a copy");
            return nullptr;
        }
        nb::object pose = nb::steal(get_pose(self, nullptr));
        if (pose.is_valid() && (copy == Py_True || dtype != Py_None)) {
            pose = dtype == Py_None ? pose.attr("copy")() : pose.attr("astype")(nb::handle(dtype));
        }
        return pose.release().ptr();
    });
}

PyObject* return_self(PyObject* self, PyObject* /*unused*/) {
    return Py_NewRef(self);
}

lookup::Used used_of(nb::handle name) {
    for (std::size_t i = 0; i < kUsedNames.size(); ++i) {
        if (nb::str(kUsedNames[i]).equal(name)) {
            return static_cast<lookup::Used>(i);
        }
    }
    throw nb::value_error("no way in which an edge is used");
}

/// Restores an object from the result of `reduce`. Throws TypeError, ValueError.
nb::object restore(const nb::str& target, const nb::str& source,
                   const std::pair<nb::object, nb::object>& pose, StampNs stamp,
                   CommitNumber commit, const nb::tuple& rows) {
    const auto& [translation, rotation] = pose;
    const Pose read{vector_of(translation.ptr(), "translation"),
                    quaternion_of(rotation.ptr(), "rotation")};
    std::vector<EdgeUse> edges;
    nb::list names;
    for (const nb::handle row : rows) {
        const auto [child, parent, used, before, after, inverted] =
            nb::cast<std::tuple<nb::str, nb::str, nb::str, StampNs, StampNs, bool>>(row);
        EdgeUse& edge = edges.emplace_back();
        edge.before = before;
        edge.after = after;
        edge.used = used_of(used);
        edge.inverted = inverted;
        names.append(exact_text(child.ptr()));
        names.append(exact_text(parent.ptr()));
    }
    PyObject* made = new_transform(read, stamp, commit, edges, target.ptr(), source.ptr(),
                                   nb::tuple(names).ptr());
    if (made == nullptr) {
        throw nb::python_error();
    }
    return nb::steal(made);
}

PyGetSetDef g_attributes[] = {
    {"translation", get_translation, nullptr, "Metres, x y z: float64 array (3,), read-only.",
     nullptr},
    {"rotation", get_rotation, nullptr, "Unit quaternion, x y z w: float64 array (4,), read-only.",
     nullptr},
    {"pose", get_pose, nullptr, "x y z qx qy qz qw: float64 array (7,), read-only.", nullptr},
    {"matrix", get_matrix, nullptr, "Homogeneous matrix: float64 array (4, 4), read-only.",
     nullptr},
    {"rpy", get_rpy, nullptr,
     "Roll, pitch, yaw in radians about fixed axes x, y, z, as in URDF: float64 array (3,),\n"
     "read-only. At a pitch of 90 degrees only their sum is defined, and roll is 0.",
     nullptr},
    {"stamp", get_stamp, nullptr, "Its stamp, in nanoseconds.", nullptr},
    {"commit", get_commit, nullptr,
     "Number of the snapshot it was read from; 0 if it was not looked up.", nullptr},
    {"target", get_target, nullptr, "The frame into which it maps.", nullptr},
    {"source", get_source, nullptr, "The frame from which it maps.", nullptr},
    {"report", get_report, nullptr,
     "How it was computed, edge by edge. Only the direct result of a lookup has edges in it.",
     nullptr},
    {nullptr, nullptr, nullptr, nullptr, nullptr},
};

PyMethodDef g_methods[] = {
    {"from_matrix", as_function(from_matrix), METH_FASTCALL | METH_KEYWORDS | METH_CLASS,
     "from_matrix($type, matrix, target, source, stamp=0)\n--\n\n"
     "T[target<-source] from a homogeneous matrix (4, 4): p_target = matrix p_source.\n\n"
     "Raises InvalidArray for a wrong shape. Raises InvalidTransform, with the deviation, for a\n"
     "matrix that is not rigid: another last row than 0 0 0 1, a reflection, scale or shear, or\n"
     "numbers that are not finite."},
    {"to_msg", as_function(to_msg), METH_FASTCALL | METH_KEYWORDS,
     "to_msg($self, /)\n--\n\n"
     "Return a geometry_msgs/TransformStamped of the installed ROS, without ROS one of\n"
     "`tfdb.tf2.msgs`. Its header.frame_id is the target, its child_frame_id the source."},
    {"_numbers", numbers, METH_NOARGS,
     "_numbers($self, /)\n--\n\n"
     "Translation, rotation, roll pitch yaw and the rows of the matrix, as floats."},
    {"_repr_html_", represent_html, METH_NOARGS,
     "_repr_html_($self, /)\n--\n\nA table for notebooks."},
    {"inverse", as_function(inverse), METH_FASTCALL | METH_KEYWORDS,
     "inverse($self, /)\n--\n\nReturn T[source<-target].\n\n"
     "Raises InvalidTransform if the result is not finite, as of a huge translation."},
    {"apply", as_function(apply), METH_FASTCALL | METH_KEYWORDS,
     "apply($self, points)\n--\n\n"
     "Map points of the source frame into the target frame.\n\n"
     "`points` is (3,) or (N, 3), float32 or float64; other types are converted to float64. NaN\n"
     "and infinite coordinates are allowed. Returns a new array of the same shape and dtype.\n"
     "Raises InvalidArray. Raises InvalidTransform, with `index`, if the result of a finite\n"
     "point is not finite in that dtype."},
    {"__array__", reinterpret_cast<PyCFunction>(reinterpret_cast<void (*)()>(as_array)),
     METH_VARARGS | METH_KEYWORDS,
     "__array__($self, dtype=None, copy=None)\n--\n\n"
     "The pose: `np.asarray(T)` is x y z qx qy qz qw, float64 (7,)."},
    {"__reduce__", reduce, METH_NOARGS, nullptr},
    {"__copy__", return_self, METH_NOARGS, nullptr},
    {"__deepcopy__", return_self, METH_O, nullptr},
    {nullptr, nullptr, 0, nullptr},
};

constexpr const char* kDoc =
    "Transform(target, source, translation, rotation=None, stamp=0, *, rpy=None, wxyz=None)\n--\n\n"
    "A rigid transform T[target<-source] at a stamp: p_target = T p_source. Immutable.\n\n"
    "Lookups return it. The constructor takes a pose in each form of `Buffer.set_transform`: a\n"
    "translation in metres and a unit quaternion x y z w, `rpy` or `wxyz`, or a whole pose. `A\n"
    "@ B` chains T[a<-b] and T[b<-c] to T[a<-c], with the older of the two stamps (0: at all\n"
    "times). It raises InvalidArgument if A.source is not B.target, and InvalidTransform if the\n"
    "result is not finite. Transforms with equal frames, stamp and pose are equal and have the\n"
    "same hash. The arrays are read-only.";

PyType_Slot g_slots[] = {
    {Py_tp_new, reinterpret_cast<void*>(new_from_python)},
    {Py_tp_dealloc, reinterpret_cast<void*>(deallocate)},
    {Py_tp_repr, reinterpret_cast<void*>(represent)},
    {Py_tp_richcompare, reinterpret_cast<void*>(compare)},
    {Py_tp_hash, reinterpret_cast<void*>(hash)},
    {Py_tp_getset, g_attributes},
    {Py_tp_methods, g_methods},
    {Py_tp_doc, const_cast<char*>(kDoc)},
    {Py_nb_matrix_multiply, reinterpret_cast<void*>(transform_multiply)},
    {0, nullptr},
};

PyType_Spec g_spec = {
    "tfdb.Transform", sizeof(TransformObject), sizeof(EdgeUse), Py_TPFLAGS_DEFAULT, g_slots,
};

}  // namespace

PyObject* new_transform(const Pose& pose, StampNs stamp, CommitNumber commit,
                        std::span<const EdgeUse> edges, PyObject* target, PyObject* source,
                        PyObject* names) {
    TransformObject* const made = allocate(static_cast<Py_ssize_t>(edges.size()));
    if (made == nullptr) {
        return nullptr;
    }
    made->pose = pose;
    made->stamp = stamp;
    made->commit = commit;
    made->target = new_exact(target);
    made->source = new_exact(source);
    made->names = edges.empty() ? nullptr : Py_NewRef(names);
    if (!edges.empty()) {
        std::memcpy(made->edges().data(), edges.data(), edges.size_bytes());
    }
    if (made->target == nullptr || made->source == nullptr) {
        Py_DECREF(made);
        return nullptr;
    }
    return reinterpret_cast<PyObject*>(made);
}

bool is_transform(PyObject* object) {
    return Py_IS_TYPE(object, g_type) != 0;
}

void bind_transform(nb::module_& module) {
    PyObject* type = PyType_FromSpec(&g_spec);
    if (type == nullptr) {
        throw nb::python_error();
    }
    g_type = reinterpret_cast<PyTypeObject*>(type);
    const nb::handle made(type);
    made.attr("__array_ufunc__") = nb::none();  // so that numpy leaves `array @ T` to Transform
    module.attr("Transform") = made;
    module.def("_restore_transform", &restore,
               nb::sig("def _restore_transform(*state: object) -> Transform"));
}

}  // namespace tfdb::python
