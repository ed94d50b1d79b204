#include "reads.hpp"

#include <nanobind/stl/string.h>

#include <algorithm>
#include <string_view>
#include <vector>

#include "arguments.hpp"
#include "arrays.hpp"
#include "batch.hpp"
#include "errors.hpp"
#include "pose.hpp"
#include "records.hpp"
#include "signatures.hpp"
#include "stamp.hpp"
#include "transaction.hpp"
#include "transform.hpp"

namespace tfdb::python {
namespace {

bool is_buffer(const StoreReaderObject& object) {
    return &object == nb::inst_ptr<BufferObject>(object.buffer);
}

nb::object lookup_transform_full(nb::handle self, nb::handle target, nb::handle target_stamp,
                                 nb::handle source, nb::handle source_stamp, nb::handle fixed,
                                 nb::handle policy) {
    const StoreReaderObject& object = object_of<StoreReaderObject>(self);
    const Question question =
        question_through(fixed, target, target_stamp, source, source_stamp, policy);
    const Pinned pinned = pin(self, object);
    Answer answer;
    nb::object names;
    while (!names.is_valid()) {
        answer = pinned.ask(
            [&](const StoreReader& reads) { return store::answer_or_raise(reads, question); });
        names = object.paths->make(pinned.reads, answer.edges);
    }
    PyObject* made = new_transform(answer, target.ptr(), source.ptr(), names.ptr());
    if (made == nullptr) {
        throw nb::python_error();
    }
    return nb::steal(made);
}

bool can_transform_full(nb::handle self, nb::handle target, nb::handle target_stamp,
                        nb::handle source, nb::handle source_stamp, nb::handle fixed,
                        nb::handle policy) {
    const Question question =
        question_through(fixed, target, target_stamp, source, source_stamp, policy);
    const Pinned pinned = pin(self, object_of<StoreReaderObject>(self));
    return pinned.ask([&](const StoreReader& reads) { return store::can_answer(reads, question); });
}

StampNs latest_common_time(nb::handle self, nb::handle target, nb::handle source) {
    const Pinned pinned = pin(self, object_of<StoreReaderObject>(self));
    const std::string_view to = name_of(target, "target");
    const std::string_view from = name_of(source, "source");
    return pinned.ask([&](const StoreReader& reads) { return reads.latest_common_time(to, from); });
}

nb::tuple common_times(nb::handle self, nb::handle target, nb::handle source) {
    const Pinned pinned = pin(self, object_of<StoreReaderObject>(self));
    const std::string_view to = name_of(target, "target");
    const std::string_view from = name_of(source, "source");
    const CommonTimes times =
        pinned.ask([&](const StoreReader& reads) { return reads.common_times(to, from); });
    return nb::make_tuple(times.oldest, times.newest);
}

nb::object lookup_velocity(nb::handle self, nb::handle target, nb::handle source, nb::handle when,
                           nb::handle interval, nb::handle reference, nb::handle point,
                           nb::handle point_frame) {
    const Pinned pinned = pin(self, object_of<StoreReaderObject>(self));
    const VelocityWanted wanted(target, source, when, interval, reference, point, point_frame);
    return twist_record(pinned.ask([&](const StoreReader& reads) { return wanted.of(reads); }));
}

nb::object path_stamps(nb::handle self, nb::handle target, nb::handle source, nb::handle start,
                       nb::handle end) {
    const Pinned pinned = pin(self, object_of<StoreReaderObject>(self));
    const std::string_view to = name_of(target, "target");
    const std::string_view from = name_of(source, "source");
    const std::optional<StampNs> first = optional_stamp_of(start.ptr());
    const std::optional<StampNs> last = optional_stamp_of(end.ptr());
    return stamp_array(pinned.ask_long(
        [&](const StoreReader& reads) { return reads.path_stamps(to, from, first, last); }));
}

CommitNumber commit_of(const StoreReaderObject& object) {
    if (const StoreReader* const reads = object.reads; reads != nullptr) {
        return reads->commit();
    }
    if (is_buffer(object)) {
        throw_closed(object);
    }
    return object.closed_commit;
}

constexpr const char* kCommonTimesDoc =
    R"(The oldest and the newest stamp at which the path between two frames has data.

The path is that of the newest tree. From the oldest to the newest stamp, each moving edge of it has
data, and the same parent as in the newest tree. The newest stamp is `latest_common_time`; both are
of one state. If the oldest is greater than the newest, no stamp is covered by the whole path.

Returns
-------
(int, int)
    Nanoseconds; both 0 if no edge of the path moves. If both frames are the same, they are those of
    the frame's own samples, as in tf2.

Raises UnknownFrame, Disconnected.)";

constexpr const char* kFullDoc =
    R"(T[target at target_stamp <- source at source_stamp], through a fixed frame.

The product of T[target<-fixed_frame] at `target_stamp` and T[fixed_frame<-source] at
`source_stamp`. It maps a point that `source` saw at its stamp into `target` at the other stamp, if
`fixed_frame` did not move.

Parameters
----------
target, source, fixed_frame
    Frame names.
target_stamp, source_stamp
    Stamps in nanoseconds. None: the latest common time of that frame and `fixed_frame`, each from
    the same state. 0 is a stamp like any other.
policy
    As in `lookup_transform`.

Returns
-------
Transform
    Its stamp is the target's.

Raises what `lookup_transform` raises.)";

void bind_full_lookups(nb::class_<StoreReaderObject>& type) {
    type.def("lookup_transform_full", &lookup_transform_full, nb::arg("target").none(),
             nb::arg("target_stamp").none(), nb::arg("source").none(),
             nb::arg("source_stamp").none(), nb::arg("fixed_frame").none(),
             nb::arg("policy") = nb::none(),
             nb::sig("def lookup_transform_full(self, target: str, target_stamp: "
                     "tfdb.types.StampLike | None, source: str, source_stamp: "
                     "tfdb.types.StampLike | None, fixed_frame: str, policy: Policy | None = "
                     "None) -> Transform"),
             kFullDoc);
    type.def("can_transform_full", &can_transform_full, nb::arg("target").none(),
             nb::arg("target_stamp").none(), nb::arg("source").none(),
             nb::arg("source_stamp").none(), nb::arg("fixed_frame").none(),
             nb::arg("policy") = nb::none(),
             nb::sig("def can_transform_full(self, target: str, target_stamp: "
                     "tfdb.types.StampLike | None, source: str, source_stamp: "
                     "tfdb.types.StampLike | None, fixed_frame: str, policy: Policy | None = "
                     "None) -> bool"),
             "Return whether `lookup_transform_full` with these arguments returns a transform.");
}

void bind_other_reads(nb::class_<StoreReaderObject>& type) {
    type.def("latest_common_time", &latest_common_time, nb::arg("target").none(),
             nb::arg("source").none(),
             nb::sig("def latest_common_time(self, target: str, source: str) -> int"),
             R"(The newest stamp at which every moving edge between two frames has data.

In nanoseconds; 0 if no edge of the path moves. If both frames are the same, it is the stamp of the
frame's newest sample, as in tf2. Raises UnknownFrame, Disconnected.)");
    type.def("common_times", &common_times, nb::arg("target").none(), nb::arg("source").none(),
             nb::sig("def common_times(self, target: str, source: str) -> tuple[int, int]"),
             kCommonTimesDoc);
    bind_velocity(type, &lookup_velocity,
                  R"(Velocity of `source` as seen from `target`, by finite difference.

Parameters
----------
target, source
    Frame names, in the order of `lookup_transform`.
stamp
    Middle of the interval, nanoseconds; None: the latest common time.
interval
    Seconds over which the difference is taken. Where the data or a parent begins or ends, the
    interval moves inside. If there is less data than the interval, all of it is used.
reference
    The frame in whose axes the result is given; None: `target`.
point, point_frame
    The point whose velocity `linear` is, in coordinates of `point_frame` (None: `source`).

Returns
-------
Twist
    `linear` in m/s, `angular` in rad/s, both float64 (3,).

Raises what `lookup_transform` raises; Extrapolation (`no data`) if there is only one stamp.)");
    type.def("_path_stamps", &path_stamps, nb::arg("target").none(), nb::arg("source").none(),
             nb::arg("start").none(), nb::arg("end").none(),
             nb::sig("def _path_stamps(self, target: str, source: str, start: "
                     "tfdb.types.StampLike | None, end: tfdb.types.StampLike | None) -> "
                     "numpy.typing.NDArray[numpy.int64]"),
             "Stored stamps of the moving edges between two frames, where every edge has data.");
    type.def_prop_ro("commit", &commit_of, nb::sig("def commit(self) -> int"),
                     "Number of the newest commit; of a snapshot, its commit. 0 in an empty store. "
                     "Raises BufferClosed.");
}

void enter_closed_state(SnapshotObject& object) {
    if (object.reads != nullptr) {
        object.closed_commit = object.reads->commit();
        object.reads = nullptr;
        object.held.reset();
    }
}

nb::object at(nb::handle self, nb::handle commit) {
    const SnapshotObject& object = object_of<SnapshotObject>(self);
    const CommitNumber wanted = count_of(commit, "commit", 0, kMaxCommit);
    const Pinned pinned = pin(self, object);
    return snapshot_object(object.owner,
                           pinned.ask([&](const StoreReader&) { return pinned.keep->at(wanted); }));
}

void close(nb::handle self) {
    nb::ft_object_guard guard(self);
    enter_closed_state(object_of<SnapshotObject>(self));
}

// A buffer's clock may refer to objects that hold its snapshots: this shows the garbage collector
// the reference. The buffer clears its clock, so a snapshot has nothing to clear.
int traverse_snapshot(PyObject* self, visitproc visit, void* arg) {
    Py_VISIT(Py_TYPE(self));
    if (nb::inst_ready(self)) {
        Py_VISIT(nb::inst_ptr<SnapshotObject>(self)->owner.ptr());
    }
    return 0;
}

PyType_Slot g_snapshot_slots[] = {
    {Py_tp_traverse, reinterpret_cast<void*>(traverse_snapshot)},
    {0, nullptr},
};

void bind_snapshot(nb::module_& module) {
    auto type = native_class<nb::class_<SnapshotObject, StoreReaderObject>>(
        module, "Snapshot", nb::type_slots(g_snapshot_slots));
    refuse_construction<SnapshotObject>(type, "Buffer.snapshot() makes snapshots");
    bind_state_bytes(type);
    type.def("at", &at, nb::arg("commit").none(), nb::sig("def at(self, commit: int) -> Snapshot"),
             R"(Return a snapshot of a later commit.

A held snapshot protects its own state and all later ones, so a follower of `changes` can open the
state of each commit. Either snapshot may be closed first. The returned one keeps as much memory as
this one, so a follower should take a new snapshot from time to time.

Parameters
----------
commit
    Number of the commit: this snapshot's own or a greater one.

Returns
-------
Snapshot
    Its reads raise SnapshotTooOld if `snapshot_memory` did not suffice.

Raises
------
InvalidArgument
    The commit is older than this snapshot's, or does not exist yet.
SnapshotClosed)");
    type.def("close", &close, nb::sig("def close(self) -> None"),
             "Release the samples that only this snapshot needs. A second call does nothing.");
    type.def_prop_ro(
        "closed", [](const SnapshotObject& object) { return object.reads == nullptr; },
        nb::sig("def closed(self) -> bool"), "True after close().");
    type.def(
        "__enter__",
        [](nb::handle self) {
            static_cast<void>(pin(self, object_of<SnapshotObject>(self)));
            return nb::borrow(self);
        },
        nb::sig("def __enter__(self) -> typing.Self"));
    type.def(
        "__exit__", [](nb::handle self, nb::handle, nb::handle, nb::handle) { close(self); },
        nb::arg("kind").none(), nb::arg("error").none(), nb::arg("traceback").none(),
        nb::sig("def __exit__(self, kind: object, error: object, traceback: object) -> None"));
    type.def("__repr__", [](const SnapshotObject& object) {
        return "<tfdb.Snapshot of commit " + std::to_string(commit_of(object)) +
               (object.reads == nullptr ? ", closed>" : ">");
    });
}

void adopt_classes(nb::handle buffer, nb::handle snapshot, nb::handle transaction) {
    g_offered<BufferObject> = buffer;
    g_offered<SnapshotObject> = snapshot;
    g_offered<TransactionObject> = transaction;
    const nb::module_ module = nb::module_::import_("tfdb._core");
    for (const nb::handle type : {buffer, snapshot, transaction}) {
        module.attr(type.attr("__name__")) = type;
    }
    add_raw_reads(buffer);
    add_raw_waits(buffer);
    add_raw_writes(buffer);
    add_raw_reads(snapshot);
    add_raw_transaction_writes(transaction);
}

}  // namespace

nb::object snapshot_object(nb::handle buffer, Snapshot&& taken) {
    auto* const of = nb::inst_ptr<BufferObject>(buffer);
    nb::object made = make_offered<SnapshotObject>();
    auto* const object = nb::inst_ptr<SnapshotObject>(made);
    object->held = std::make_shared<Snapshot>(std::move(taken));
    object->reads = object->held.get();
    object->waits = &of->reasons;
    object->names = &of->own_names;
    object->paths = &of->own_paths;
    object->buffer = buffer.ptr();
    object->owner = nb::borrow(buffer);
    return made;
}

Question question_through(nb::handle fixed, nb::handle target, nb::handle target_stamp,
                          nb::handle source, nb::handle source_stamp, nb::handle policy) {
    return store::by_way_of(name_of(fixed, "fixed_frame"), name_of(target, "target"),
                            optional_stamp_of(target_stamp.ptr()), name_of(source, "source"),
                            optional_stamp_of(source_stamp.ptr()), policy_of(policy.ptr()));
}

void throw_closed(const StoreReaderObject& object) {
    ErrorDetail detail;
    detail.commit = object.closed_commit;
    if (is_buffer(object)) {
        throw BufferClosed("the buffer is closed: open its store again, or create another Buffer",
                           detail);
    }
    throw SnapshotClosed("the snapshot of commit " + std::to_string(object.closed_commit) +
                             " is closed: take a new one with Buffer.snapshot()",
                         detail);
}

Pinned pin(nb::handle self, const StoreReaderObject& object) {
    nb::ft_object_guard guard(self);
    if (object.reads == nullptr) {
        throw_closed(object);
    }
    check_not_in_transaction(object);
    return {object.held, *object.reads, *object.waits};
}

void check_not_in_transaction(const StoreReaderObject& object) {
    // Reads of a snapshot have a defined state, even inside a transaction.
    if (object.waits->transactions() && object.held == nullptr) {
        nb::inst_ptr<BufferObject>(object.buffer)->store.check_not_in_transaction();
    }
}

void throw_not_made(nb::handle self, const char* expected) {
    const std::string type = type_name_of(self);
    if (expected == nullptr) {
        PyErr_Format(PyExc_TypeError, "%s.__init__() was never called", type.c_str());
    } else {
        PyErr_Format(PyExc_TypeError, "self must be a %s, got %s", expected, type.c_str());
    }
    throw nb::python_error();
}

void bind_reads(nb::module_& module) {
    auto type = offered_class<nb::class_<StoreReaderObject>>(module, "StoreReader", R"(StoreReader()
--

The reads of Buffer and Snapshot.

Each call on a Buffer reads one new snapshot; each call on a Snapshot reads that snapshot.)");
    refuse_construction<StoreReaderObject>(type, "this class is abstract: create a Buffer");
    bind_full_lookups(type);
    bind_other_reads(type);
    bind_batch(type);
    bind_records(type);
    add_raw_reads(type);
    bind_snapshot(module);
}

void keep_thread_state() {
    thread_local bool is_kept = false;
    if (!is_kept)
        (void)PyGILState_Ensure();
    is_kept = true;
}

void bind_helpers(nb::module_& module) {
    module.def(
        "to_nanoseconds", [](nb::handle stamp) { return stamp_of(stamp.ptr()); },
        nb::arg("stamp").none(), nb::sig("def to_nanoseconds(stamp: tfdb.types.StampLike) -> int"),
        "Nanoseconds of a stamp in any accepted form. Raises InvalidStamp.");
    module.def(
        "duration_to_nanoseconds",
        [](nb::handle seconds, const std::string& name) {
            return duration_of(seconds, name.c_str());
        },
        nb::arg("seconds").none(), nb::arg("name"),
        nb::sig("def duration_to_nanoseconds(seconds: float, name: str) -> int"),
        "Nanoseconds of a duration in seconds. Raises InvalidArgument with its name.");
    module.def("pose_parts", &pose_parts, nb::arg("parent").none(), nb::arg("child").none(),
               nb::arg("translation").none(), nb::arg("rpy").none(), nb::arg("wxyz").none(),
               nb::sig("def pose_parts(parent: str, child: str, translation: Any, rpy: Any, "
                       "wxyz: Any) -> tuple[tuple[float, ...], tuple[float, ...]] | None"),
               "Translation and rotation of a pose T[parent<-child]; None: it has no rotation.");
    module.def(
        "poses_of_matrices", &poses_of_matrices, nb::arg("matrices").none(),
        nb::arg("missing") = false,
        nb::sig("def poses_of_matrices(matrices: numpy.typing.ArrayLike, "
                "missing: bool = False) -> numpy.typing.NDArray[numpy.float64]"),
        "Poses (N, 7) of matrices (N, 4, 4), w not below 0; NaN of those that are NaN as a "
        "whole, if they may be missing. Raises InvalidArray, InvalidTransform with `index`.");
    module.def("adopt_classes", &adopt_classes, nb::arg("buffer"), nb::arg("snapshot"),
               nb::arg("transaction"),
               nb::sig("def adopt_classes(buffer: type[Buffer], snapshot: type[Snapshot], "
                       "transaction: type[Transaction]) -> None"),
               "Make objects of these subclasses of the native classes from now on.");
}

}  // namespace tfdb::python
