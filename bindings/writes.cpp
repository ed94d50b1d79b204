#include "writes.hpp"

#include <array>

#include "arguments.hpp"
#include "errors.hpp"
#include "pose.hpp"
#include "stamp.hpp"

namespace tfdb::python {
namespace {

/// Above this a commit takes longer than handing the GIL over and back.
constexpr std::size_t kReleaseFrom = 1024;

constexpr std::array<std::string_view, 10> kSetNames = {
    "parent", "child", "stamp",     "translation", "rotation",
    "rpy",    "wxyz",  "authority", "change_kind", "only_new"};

std::string_view authority_of(PyObject* authority) {
    return authority == nullptr ? std::string_view() : name_of(authority, "authority");
}

BufferObject& buffer_of(PyObject* self) {
    return static_cast<BufferObject&>(made_reads(self));
}

PyObject* set_transform(PyObject* self, PyObject* const* args, Py_ssize_t count,
                        PyObject* keywords) {
    return guarded([&]() -> PyObject* {
        constexpr ParameterList kList{"set_transform", kSetNames, 4, 5};
        const auto [parent, child, stamp, translation, rotation, rpy, wxyz, authority, change_kind,
                    only_new] = bind<10>(kList, args, count, keywords);
        const WriteRules rules{flag_of(change_kind, "change_kind"), flag_of(only_new, "only_new")};
        const TransformView view =
            view_of(parent, child, stamp, {translation, rotation, rpy, wxyz, parent, child});
        return PyLong_FromUnsignedLongLong(
            commit_transforms(buffer_of(self), {&view, 1}, false, authority_of(authority), rules));
    });
}

/// With the GIL if nobody is in the way of so few samples, else without it.
template <class Try, class Commit>
CommitNumber commit_soon(BufferObject& buffer, std::size_t samples, Try&& try_commit,
                         Commit&& commit) {
    CommitNumber number = 0;
    if (samples < kReleaseFrom && !buffer.reasons.to_wait() && try_commit(number)) {
        return number;
    }
    const LongWork work(true);
    return commit();
}

PyMethodDef g_set_transform = {
    "set_transform", as_function(set_transform), METH_FASTCALL | METH_KEYWORDS,
    "set_transform($self, parent, child, stamp, translation, rotation=None, *, rpy=None, "
    "wxyz=None, authority='', change_kind=False, only_new=False)\n--\n\n"
    "Store T[parent<-child], the pose of `child` in `parent` at a stamp.\n\n"
    "Parameters\n----------\n"
    "parent, child\n    Frame names; new ones become frames.\n"
    "stamp\n    Nanoseconds (or an object that holds a stamp).\n"
    "translation\n    Metres, x y z: a sequence, an array, or an object with x, y, z. Or the whole\n"
    "    pose: a 4x4 matrix, 7 numbers x y z qx qy qz qw, a `Transform` T[parent<-child], or an\n"
    "    object with translation and rotation.\n"
    "rotation\n    Unit quaternion, x y z w, likewise, or a Rotation of scipy. Normalised if\n"
    "    slightly off. None, without the next two: not rotated.\n"
    "rpy\n    Instead: roll, pitch, yaw in radians about fixed axes x, y, z, as in URDF.\n"
    "wxyz\n    Instead: unit quaternion w x y z.\n"
    "authority\n    Name of the writer.\n"
    "change_kind\n    A static edge becomes moving: its pose is dropped in the same commit, the\n"
    "    frames below it stay.\n"
    "only_new\n    Refuse a stamp that the edge has already; else the later value replaces it.\n\n"
    "Returns\n-------\nint\n    Number of the commit.\n\n"
    "Raises\n------\nInvalidName, InvalidStamp, InvalidArray, InvalidTransform, TooOld,\n"
    "StaticConflict, RepeatedStamp, CycleError, CapacityExceeded. Then nothing was stored."};

}  // namespace

CommitNumber commit_transforms(BufferObject& buffer, std::span<const TransformView> batch,
                               bool is_static, std::string_view authority, WriteRules rules) {
    return commit_soon(
        buffer, batch.size(),
        [&](CommitNumber& commit) {
            return buffer.open_store().try_set_transforms(batch, is_static, authority, commit,
                                                          rules);
        },
        [&] { return buffer.open_store().set_transforms(batch, is_static, authority, rules); });
}

CommitNumber commit_transforms(BufferObject& buffer, const EdgeColumns& columns,
                               std::string_view authority, WriteRules rules) {
    return commit_soon(
        buffer, columns.stamps.size(),
        [&](CommitNumber& commit) {
            return buffer.open_store().try_set_transforms(columns, authority, commit, rules);
        },
        [&] { return buffer.open_store().set_transforms(columns, authority, rules); });
}

TransformView view_of(PyObject* parent, PyObject* child, PyObject* stamp,
                      const PoseArguments& pose) {
    TransformView view;
    view.parent = name_of(parent, "parent");
    view.child = name_of(child, "child");
    view.stamp = stamp == nullptr ? 0 : stamp_of(stamp);
    view.pose = pose_of(pose);
    return view;
}

void add_raw_writes(nb::handle type) {
    add_raw_method(type, g_set_transform);
}

}  // namespace tfdb::python
