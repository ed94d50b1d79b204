#include "writes.hpp"

#include "arguments.hpp"
#include "errors.hpp"
#include "fields.hpp"
#include "pose.hpp"
#include "stamp.hpp"
#include "transform.hpp"

namespace tfdb::python {
namespace {

/// A larger commit takes longer than releasing and reacquiring the GIL.
constexpr std::size_t kReleaseFrom = 1024;

BufferObject& buffer_of(PyObject* self) {
    return static_cast<BufferObject&>(made_reads(self));
}

PyObject* set_transform(PyObject* self, PyObject* const* args, Py_ssize_t count,
                        PyObject* keywords) {
    return guarded([&]() -> PyObject* {
        const auto store = [self](const TransformView& view, std::string_view authority,
                                  WriteRules rules) {
            return commit_write(buffer_of(self),
                                {.transforms = {&view, 1}, .authority = authority, .rules = rules});
        };
        return PyLong_FromUnsignedLongLong(read_set_transform<true>(args, count, keywords, store));
    });
}

PyMethodDef g_set_transform = {
    "set_transform", as_function(set_transform), METH_FASTCALL | METH_KEYWORDS,
    "set_transform($self, parent, child, stamp, translation, rotation=None, *, rpy=None, "
    "wxyz=None, authority='', change_kind=False, only_new=False)\n--\n\n"
    R"(Store T[parent<-child], the pose of `child` in `parent` at a stamp.

`set_transform(T)` stores a `Transform` that a lookup returned: T.target is the parent, T.source
the child, T.stamp the stamp. A `TransformStamped` and a ROS message of that name work as well.
`authority`, `change_kind` and `only_new` may follow by keyword. A Transform with stamp 0 holds at
all times and raises InvalidStamp: `set_transforms([T], static=True)` stores it.

Parameters
----------
parent, child
    Frame names. New names create frames.
stamp
    Nanoseconds (or an object that holds a stamp).
translation
    Metres, x y z: a sequence, an array, or an object with x, y, z. Or the whole pose: a 4x4
    matrix, 7 numbers x y z qx qy qz qw, a `Transform` T[parent<-child], or an object with
    translation and rotation.
rotation
    Unit quaternion x y z w, or a Rotation of scipy. A quaternion that is slightly off is
    normalised. Without `rotation`, `rpy` and `wxyz`: not rotated.
rpy
    In place of `rotation`: roll, pitch, yaw in radians about fixed axes x, y, z, as in URDF.
wxyz
    In place of `rotation`: unit quaternion w x y z.
authority
    Name of the writer.
change_kind
    Let a static edge become moving. Its static pose is dropped in the same commit; the frames
    below it stay.
only_new
    Refuse a stamp that the edge has already. Without it, the later value replaces the stored one.

Returns
-------
int
    Number of the commit.

Raises
------
InvalidName, InvalidStamp, InvalidArray, InvalidTransform, TooOld, StaticConflict, RepeatedStamp,
CycleError, CapacityExceeded
    Nothing was stored.)"};

}  // namespace

CommitNumber commit_write(BufferObject& buffer, WriteRequest request) {
    if (request.size() < kReleaseFrom && !buffer.reasons.to_wait()) {
        request.wait = false;
        const WriteResult result = buffer.open_store().write(request);
        if (!result.busy) {
            return result.commit;
        }
        request.wait = true;
    }
    const LongWork work(true);
    return buffer.open_store().write(request).commit;
}

FrameNames::FrameNames(nb::handle names) {
    if (PyUnicode_Check(names.ptr())) {
        kept_ = nb::borrow(names);
        views_.push_back(name_of(names, "names"));
        return;
    }
    check_many(names, "names", "a frame's name or a sequence of them");
    kept_ = read_items(names, views_, [](PyObject* item) { return name_of(item, "names"); });
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

bool names_its_frames(PyObject* object) {
    return is_transform(object) ||
           (!PyUnicode_Check(object) && (find(object, g_fields.child).is_valid() ||
                                         find(object, g_fields.child_frame_id).is_valid()));
}

void add_raw_writes(nb::handle type) {
    add_raw_method(type, g_set_transform);
}

}  // namespace tfdb::python
