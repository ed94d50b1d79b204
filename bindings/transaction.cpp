// The Python class Transaction, and Buffer.transaction.
#include "transaction.hpp"

#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include <string>
#include <utility>
#include <vector>

#include "arguments.hpp"
#include "batch.hpp"
#include "errors.hpp"
#include "pose.hpp"
#include "records.hpp"
#include "signatures.hpp"
#include "stamp.hpp"
#include "transform.hpp"
#include "writes.hpp"

namespace tfdb::python {
namespace {

using Stage = Transaction::Stage;

/// An answer with the names of its edges: frames created by the transaction have no name after its
/// end.
struct Named {
    Answer answer;
    std::vector<std::pair<std::string, std::string>> edges;
};

Named named(const Transaction& transaction, Answer answer) {
    Named result{std::move(answer), {}};
    for (const EdgeUse& edge : result.answer.edges) {
        result.edges.emplace_back(transaction.frame_name(edge.child, edge.generation),
                                  transaction.frame_name(edge.parent, edge.parent_generation));
    }
    return result;
}

nb::object transform_of(const Named& found, nb::handle target, nb::handle source) {
    nb::list names;
    for (const auto& [child, parent] : found.edges) {
        names.append(str_of_name(child));
        names.append(str_of_name(parent));
    }
    PyObject* made =
        new_transform(found.answer, target.ptr(), source.ptr(), nb::tuple(names).ptr());
    if (made == nullptr) {
        throw nb::python_error();
    }
    return nb::steal(made);
}

nb::object lookup_transform(TransactionObject& self, nb::handle target, nb::handle source,
                            nb::handle when, nb::handle policy) {
    const std::string_view to = name_of(target, "target");
    const std::string_view from = name_of(source, "source");
    const std::optional<StampNs> stamp = optional_stamp_of(when.ptr());
    const Policy how = policy_of(policy.ptr());
    const Named found = self.run([&](Transaction& transaction) {
        return named(transaction, transaction.lookup_transform(to, from, stamp, how));
    });
    return transform_of(found, target, source);
}

nb::object lookup_latest_transform(TransactionObject& self, nb::handle target, nb::handle source,
                                   nb::handle age, nb::handle when) {
    const std::string_view to = name_of(target, "target");
    const std::string_view from = name_of(source, "source");
    const std::optional<StampNs> max_age = optional_duration_of(age, "max_age");
    StampNs now = 0;
    if (max_age) {
        now = is_given(when.ptr()) ? stamp_of(when.ptr()) : now_of(self.owner.ptr());
    }
    const Named found = self.run([&](Transaction& transaction) {
        return named(transaction, transaction.lookup_latest_transform(to, from, max_age, now));
    });
    return transform_of(found, target, source);
}

bool can_transform(TransactionObject& self, nb::handle target, nb::handle source, nb::handle when,
                   nb::handle policy) {
    const Question question =
        store::at_stamp(name_of(target, "target"), name_of(source, "source"),
                        optional_stamp_of(when.ptr()), policy_of(policy.ptr()));
    return self.run(
        [&](Transaction& transaction) { return store::can_answer(transaction, question); });
}

nb::object lookup_transform_full(TransactionObject& self, nb::handle target,
                                 nb::handle target_stamp, nb::handle source,
                                 nb::handle source_stamp, nb::handle fixed, nb::handle policy) {
    const Question question =
        question_through(fixed, target, target_stamp, source, source_stamp, policy);
    const Named found = self.run([&](Transaction& transaction) {
        return named(transaction, store::answer_or_raise(transaction, question));
    });
    return transform_of(found, target, source);
}

bool can_transform_full(TransactionObject& self, nb::handle target, nb::handle target_stamp,
                        nb::handle source, nb::handle source_stamp, nb::handle fixed,
                        nb::handle policy) {
    const Question question =
        question_through(fixed, target, target_stamp, source, source_stamp, policy);
    return self.run(
        [&](Transaction& transaction) { return store::can_answer(transaction, question); });
}

nb::object lookup_transforms(TransactionObject& self, nb::handle target, nb::handle source,
                             nb::handle stamps, nb::handle policy, nb::handle layout,
                             nb::handle out, nb::handle missing) {
    const RowsWanted wanted(target, source, stamps, policy, layout, out, missing);
    self.run([&](Transaction& transaction) {
        transaction.lookup_many(wanted.target, wanted.source, wanted.stamps.values(), wanted.policy,
                                wanted.layout, wanted.missing, wanted.rows());
    });
    return wanted.result.array;
}

StampNs latest_common_time(TransactionObject& self, nb::handle target, nb::handle source) {
    const std::string_view to = name_of(target, "target");
    const std::string_view from = name_of(source, "source");
    return self.run(
        [&](Transaction& transaction) { return transaction.latest_common_time(to, from); });
}

nb::tuple common_times(TransactionObject& self, nb::handle target, nb::handle source) {
    const std::string_view to = name_of(target, "target");
    const std::string_view from = name_of(source, "source");
    const CommonTimes times =
        self.run([&](Transaction& transaction) { return transaction.common_times(to, from); });
    return nb::make_tuple(times.oldest, times.newest);
}

nb::object parent_of(TransactionObject& self, nb::handle name, nb::handle when) {
    const std::string_view bytes = name_of(name, "name");
    const std::optional<StampNs> stamp = optional_stamp_of(when.ptr());
    return name_or_none(
        self.run([&](Transaction& transaction) { return transaction.parent_of(bytes, stamp); }));
}

bool frame_exists(TransactionObject& self, nb::handle name) {
    const std::string_view bytes = name_of(name, "name");
    return self.run([&](Transaction& transaction) { return transaction.has_frame(bytes); });
}

nb::object lookup_edge(TransactionObject& self, nb::handle target, nb::handle source,
                       nb::handle when, nb::handle policy) {
    Question question = store::at_stamp(name_of(target, "target"), name_of(source, "source"),
                                        optional_stamp_of(when.ptr()), policy_of(policy.ptr()));
    question.kind = Question::kEdge;
    const Named found = self.run([&](Transaction& transaction) {
        return named(transaction, store::answer_or_raise(transaction, question));
    });
    return transform_of(found, target, source);
}

nb::object lookup_velocity(TransactionObject& self, nb::handle target, nb::handle source,
                           nb::handle when, nb::handle interval, nb::handle reference,
                           nb::handle point, nb::handle point_frame) {
    const VelocityWanted wanted(target, source, when, interval, reference, point, point_frame);
    return twist_record(self.run([&](Transaction& transaction) { return wanted.of(transaction); }));
}

nb::object transform_points(TransactionObject& self, nb::handle target, nb::handle source,
                            nb::handle points, nb::handle stamps, nb::handle policy, nb::handle out,
                            nb::handle missing) {
    const PointsWanted wanted(target, source, points, stamps, policy, out, missing);
    self.run([&](Transaction& transaction) { wanted.move_with(transaction); });
    return wanted.to.array;
}

nb::object lookup_edges(TransactionObject& self, nb::handle frames, nb::handle stamp,
                        nb::handle policy, nb::handle out, nb::handle dtype, nb::handle missing) {
    EdgesWanted wanted(frames, stamp, policy, out, dtype, missing);
    self.run([&](Transaction& transaction) { wanted.fill_from(transaction); });
    return wanted.array();
}

nb::object path_stamps(TransactionObject& self, nb::handle target, nb::handle source,
                       nb::handle start, nb::handle end) {
    const std::string_view to = name_of(target, "target");
    const std::string_view from = name_of(source, "source");
    const std::optional<StampNs> first = optional_stamp_of(start.ptr());
    const std::optional<StampNs> last = optional_stamp_of(end.ptr());
    return stamp_array(self.run(
        [&](Transaction& transaction) { return transaction.path_stamps(to, from, first, last); }));
}

nb::list frames(TransactionObject& self) {
    return name_list(self.run([](Transaction& transaction) { return transaction.frames(); }));
}

nb::object frame_info(TransactionObject& self, nb::handle name) {
    const std::string_view bytes = name_of(name, "name");
    return frame_info_record(
        self.run([&](Transaction& transaction) { return transaction.frame_info(bytes); }));
}

nb::list tree(TransactionObject& self, nb::handle when) {
    const std::optional<StampNs> stamp = optional_stamp_of(when.ptr());
    return frame_info_records(
        self.run([&](Transaction& transaction) { return transaction.tree(stamp); }));
}

nb::object tree_columns(TransactionObject& self, nb::handle when) {
    const std::optional<StampNs> stamp = optional_stamp_of(when.ptr());
    return tree_columns_record(
        self.run([&](Transaction& transaction) { return transaction.tree_columns(stamp); }));
}

nb::tuple samples(TransactionObject& self, nb::handle name) {
    const std::string_view bytes = name_of(name, "name");
    return samples_record(
        self.run([&](Transaction& transaction) { return transaction.samples(bytes); }));
}

void store(TransactionObject& self, const TransformView& view, bool is_static,
           std::string_view authority) {
    self.run([&](Transaction& transaction) {
        transaction.set_transforms({&view, 1}, is_static, authority);
    });
}

PyObject* set_transform(PyObject* self, PyObject* const* args, Py_ssize_t count,
                        PyObject* keywords) {
    return guarded([&]() -> PyObject* {
        const auto put = [self](const TransformView& view, std::string_view authority, WriteRules) {
            store(object_of<TransactionObject>(self), view, false, authority);
        };
        read_set_transform<false>(args, count, keywords, put);
        return Py_NewRef(Py_None);
    });
}

PyMethodDef g_set_transform = {
    "set_transform", as_function(set_transform), METH_FASTCALL | METH_KEYWORDS,
    "set_transform($self, parent, child, stamp, translation, rotation=None, *, rpy=None, "
    "wxyz=None, authority='')\n--\n\n"
    "Store T[parent<-child] at a stamp, at the commit; this transaction sees it at once.\n\n"
    "Arguments and errors as in `Buffer.set_transform`, but CycleError comes at the commit.\n"
    "`change_kind` and `only_new` are missing: a transaction can `clear`, and can read the "
    "stored stamps first."};

void set_static_transform(TransactionObject& self, nb::handle parent, nb::handle child,
                          nb::handle translation, nb::handle rotation, nb::handle rpy,
                          nb::handle wxyz, nb::handle authority) {
    store(self,
          view_of(parent.ptr(), child.ptr(), nullptr,
                  {translation.ptr(), rotation.ptr(), rpy.ptr(), wxyz.ptr(), parent.ptr(),
                   child.ptr()}),
          true, name_of(authority, "authority"));
}

void set_transforms(TransactionObject& self, nb::handle batch, bool is_static,
                    nb::handle authority) {
    const Transforms transforms = Transforms::from_batch(batch, is_static);
    const std::string_view who = name_of(authority, "authority");
    transforms.give_to([&](std::span<const TransformView> views) {
        self.run(
            [&](Transaction& transaction) { transaction.set_transforms(views, is_static, who); });
    });
}

void remove_frames(TransactionObject& self, nb::handle names, bool recursive) {
    const FrameNames all(names);
    self.run([&](Transaction& transaction) { transaction.remove_frames(all.views(), recursive); });
}

void clear(TransactionObject& self) {
    self.run([](Transaction& transaction) { transaction.clear(); });
}

std::optional<Pose> optional_pose_of(const PoseArguments& given) {
    if (given.translation == Py_None) {
        PyObject* const turned = is_given(given.rotation) ? given.rotation
                                 : is_given(given.rpy)    ? given.rpy
                                                          : given.wxyz;
        if (is_given(turned)) {
            throw_error("InvalidArgument",
                        "a rotation without a translation: give both, or neither, which leaves "
                        "the frame where it is",
                        {{"value", nb::borrow(turned)}});
        }
        return std::nullopt;
    }
    return pose_of(given);
}

void reparent(TransactionObject& self, nb::handle child, nb::handle parent, nb::handle stamp,
              nb::handle translation, nb::handle rotation, nb::handle rpy, nb::handle wxyz,
              nb::handle authority) {
    const std::string_view of = name_of(child, "child");
    const std::string_view to = name_of(parent, "parent");
    const std::optional<StampNs> from = optional_stamp_of(stamp.ptr());
    const std::optional<Pose> pose = optional_pose_of(
        {translation.ptr(), rotation.ptr(), rpy.ptr(), wxyz.ptr(), parent.ptr(), child.ptr()});
    const std::string_view who = name_of(authority, "authority");
    self.run([&](Transaction& transaction) { transaction.reparent(of, to, from, pose, who); });
}

nb::handle enter(nb::handle self) {
    object_of<TransactionObject>(self).begin();
    return self;
}

void exit(TransactionObject& self, nb::handle kind, nb::handle, nb::handle) {
    const Transaction& held = self.transaction;
    held.check_thread();
    if (!kind.is_none()) {
        self.abort();
    } else if (held.stage() == Stage::kLost) {
        throw Conflict(*held.lost_to());  // the program continued after the conflict
    } else if (held.stage() != Stage::kAborted) {
        self.commit();
    }
}

void abort(TransactionObject& self) {
    const Transaction& held = self.transaction;
    held.check_thread();
    const bool has_failed = held.stage() == Stage::kLost || held.stage() == Stage::kRefused;
    if (held.stage() != Stage::kAborted && !has_failed) {
        try {
            held.check();
        } catch (const Forked&) {
            // A transaction that was open at a fork ends in the child as well.
            if (!held.is_open())
                throw;
        }
    }
    self.abort();
}

std::optional<CommitNumber> commit_number(const TransactionObject& self) {
    const Transaction& held = self.transaction;
    return held.stage() == Stage::kCommitted ? std::optional(held.committed()) : std::nullopt;
}

std::string represent(const TransactionObject& self) {
    switch (self.transaction.stage()) {
        case Stage::kNotBegun:
            return "<tfdb.Transaction, not begun>";
        case Stage::kOpen:
            return "<tfdb.Transaction, open>";
        case Stage::kCommitted:
            return "<tfdb.Transaction, committed at " +
                   std::to_string(self.transaction.committed()) + ">";
        case Stage::kAborted:
            return "<tfdb.Transaction, aborted>";
        case Stage::kLost:
            return "<tfdb.Transaction, lost>";
        default:
            return "<tfdb.Transaction, refused>";
    }
}

// A buffer's clock may refer to objects that hold its transactions: this shows the garbage
// collector the reference.
int traverse(PyObject* self, visitproc visit, void* arg) {
    Py_VISIT(Py_TYPE(self));
    if (nb::inst_ready(self)) {
        Py_VISIT(nb::inst_ptr<TransactionObject>(self)->owner.ptr());
    }
    return 0;
}

PyType_Slot g_slots[] = {
    {Py_tp_traverse, reinterpret_cast<void*>(traverse)},
    {0, nullptr},
};

unsigned priority_of(nb::handle priority) {
    constexpr long kMost = 7;
    long value = -1;
    if (!PyBool_Check(priority.ptr()) && PyIndex_Check(priority.ptr())) {
        const nb::object integer = nb::steal(PyNumber_Index(priority.ptr()));
        int overflow = 0;
        value = integer.is_valid() ? PyLong_AsLongAndOverflow(integer.ptr(), &overflow) : -1;
        forget_error();
    }
    if (value < 0 || value > kMost) {
        throw_error("InvalidArgument",
                    "priority must be an integer from 0 (ordinary) to 7 (most urgent), got " +
                        short_repr(priority),
                    {{"value", nb::borrow(priority)}});
    }
    return static_cast<unsigned>(value);
}

nb::object attempt(nb::handle self, nb::handle priority, bool alone, std::uint64_t age) {
    static_cast<void>(object_of<BufferObject>(self));
    TransactionOptions options;
    options.priority = priority_of(priority);
    options.alone = alone;
    options.age = age;
    return make_offered<TransactionObject>(self, options);
}

constexpr const char* kReparentDoc =
    R"(Give `child` another parent, from a stamp on.

Parameters
----------
child, parent
    Frame names.
stamp
    Nanoseconds: before it the child keeps its parent. None: a static edge, at every stamp.
translation, rotation, rpy, wxyz
    T[parent<-child], as in `Buffer.set_transform`. Without any of them the child stays in place:
    T[parent<-child] is looked up at `stamp`, which needs data there. With a translation alone: not
    rotated.
authority
    Name of the writer.

Raises what `lookup_transform` and `set_transform` raise; InvalidArgument for a rotation without a
translation.)";

using TransactionClass = nb::class_<TransactionObject>;

void bind_full_lookups(TransactionClass& type) {
    type.def(
        "lookup_transform_full", &lookup_transform_full, nb::arg("target").none(),
        nb::arg("target_stamp").none(), nb::arg("source").none(), nb::arg("source_stamp").none(),
        nb::arg("fixed_frame").none(), nb::arg("policy") = nb::none(),
        nb::sig("def lookup_transform_full(self, target: str, target_stamp: "
                "tfdb.types.StampLike | None, source: str, source_stamp: "
                "tfdb.types.StampLike | None, fixed_frame: str, policy: Policy | None = "
                "None) -> Transform"),
        R"(T[target at target_stamp <- source at source_stamp], as `Buffer.lookup_transform_full`.

Raises the errors of that method, and Conflict, TransactionClosed, WrongThread.)");
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

void bind_lookups(TransactionClass& type) {
    bind_full_lookups(type);
    type.def("lookup_transform", &lookup_transform, nb::arg("target").none(),
             nb::arg("source").none(), nb::arg("stamp") = nb::none(),
             nb::arg("policy") = nb::none(),
             nb::sig("def lookup_transform(self, target: str, source: str, stamp: "
                     "tfdb.types.StampLike | None = None, policy: Policy | None = None) -> "
                     "Transform"),
             R"(T[target<-source] at a stamp, as `Buffer.lookup_transform`.

Its report stays valid after the end of the transaction. Raises the errors of that method, and
Conflict, TransactionClosed, WrongThread.)");
    type.def(
        "lookup_latest_transform", &lookup_latest_transform, nb::arg("target").none(),
        nb::arg("source").none(), nb::arg("max_age") = nb::none(), nb::arg("now") = nb::none(),
        nb::sig("def lookup_latest_transform(self, target: str, source: str, max_age: float | "
                "None = None, now: tfdb.types.StampLike | None = None) -> Transform"),
        R"(T[target<-source] from each edge's newest sample, as `Buffer.lookup_latest_transform`.

Raises the errors of that method, and Conflict, TransactionClosed, WrongThread.)");
    type.def("lookup_transforms", &lookup_transforms, nb::arg("target").none(),
             nb::arg("source").none(), nb::arg("stamps").none(), nb::arg("policy") = nb::none(),
             nb::kw_only(), nb::arg("layout").none() = "pose", nb::arg("out") = nb::none(),
             nb::arg("missing").none() = "raise",
             nb::sig("def lookup_transforms(self, target: str, source: str, stamps: "
                     "tfdb.types.StampsLike, policy: Policy | None = None, *, layout: "
                     "typing.Literal['pose', 'matrix'] = 'pose', out: "
                     "numpy.typing.NDArray[numpy.float64] | None = None, missing: "
                     "typing.Literal['raise', 'nan'] = 'raise') -> "
                     "numpy.typing.NDArray[numpy.float64]"),
             R"(T[target<-source] at each of N stamps: float64 (N, 7) or (N, 4, 4).

Arguments, result and errors as in `Buffer.lookup_transforms`; and Conflict, TransactionClosed,
WrongThread.)");
    type.def("can_transform", &can_transform, nb::arg("target").none(), nb::arg("source").none(),
             nb::arg("stamp") = nb::none(), nb::arg("policy") = nb::none(),
             nb::sig("def can_transform(self, target: str, source: str, stamp: "
                     "tfdb.types.StampLike | None = None, policy: Policy | None = None) -> bool"),
             R"(Return whether `lookup_transform` with these arguments returns a transform.

The result counts as a read: a commit that changes it causes a Conflict.)");
    type.def("latest_common_time", &latest_common_time, nb::arg("target").none(),
             nb::arg("source").none(),
             nb::sig("def latest_common_time(self, target: str, source: str) -> int"),
             "The newest stamp at which every moving edge between two frames has data.");
    type.def("common_times", &common_times, nb::arg("target").none(), nb::arg("source").none(),
             nb::sig("def common_times(self, target: str, source: str) -> tuple[int, int]"),
             "The oldest and the newest stamp at which the path between two frames has data, as "
             "`Buffer.common_times`.");
    type.def("parent_of", &parent_of, nb::arg("name").none(), nb::arg("stamp") = nb::none(),
             nb::sig("def parent_of(self, name: str, stamp: tfdb.types.StampLike | None = None) -> "
                     "str | None"),
             "The parent that a frame has at a stamp (None: in its newest sample), as "
             "`Buffer.parent_of`.");
    type.def("frame_exists", &frame_exists, nb::arg("name").none(),
             nb::sig("def frame_exists(self, name: str) -> bool"),
             "Return whether a frame has that name.");
}

void bind_frames(TransactionClass& type) {
    type.def(
        "frames", &frames, nb::sig("def frames(self) -> list[str]"),
        "Names of all frames, sorted. A commit that creates or removes a frame causes a Conflict.");
    type.def("frame_info", &frame_info, nb::arg("name").none(),
             nb::sig("def frame_info(self, name: str) -> tfdb.types.FrameInfo"),
             "One frame and the edge to its parent, as `Buffer.frame_info`.");
    type.def("tree", &tree, nb::arg("stamp") = nb::none(),
             nb::sig("def tree(self, stamp: tfdb.types.StampLike | None = None) -> "
                     "list[tfdb.types.FrameInfo]"),
             "All frames with their parents, as `Buffer.tree`. It counts as a read of every edge.");
    type.def("tree_columns", &tree_columns, nb::arg("stamp") = nb::none(),
             nb::sig("def tree_columns(self, stamp: tfdb.types.StampLike | None = None) -> "
                     "tfdb.types.TreeColumns"),
             "The facts of `tree` as columns, as `Buffer.tree_columns`.");
    type.def("samples", &samples, nb::arg("name").none(),
             nb::sig("def samples(self, name: str) -> tuple[numpy.typing.NDArray[numpy.int64], "
                     "numpy.typing.NDArray[numpy.float64], list[str]]"),
             "All samples of a frame's edge, as `Buffer.samples`.");
    type.def("_path_stamps", &path_stamps, nb::arg("target").none(), nb::arg("source").none(),
             nb::arg("start").none(), nb::arg("end").none(),
             nb::sig("def _path_stamps(self, target: str, source: str, start: "
                     "tfdb.types.StampLike | None, end: tfdb.types.StampLike | None) -> "
                     "numpy.typing.NDArray[numpy.int64]"),
             "As of `StoreReader`.");
    type.def("_lookup_edge", &lookup_edge, nb::arg("target").none(), nb::arg("source").none(),
             nb::arg("stamp").none(), nb::arg("policy").none(),
             nb::sig("def _lookup_edge(self, target: str, source: str, stamp: "
                     "tfdb.types.StampLike | None, policy: Policy | None) -> Transform"),
             "As of `StoreReader`.");
    bind_velocity(type, &lookup_velocity,
                  "Velocity of `source` as seen from `target`, as `Buffer.lookup_velocity`.");
    bind_lookup_edges(type, &lookup_edges,
                      "T[parent<-frame] of many frames at one stamp, as `Buffer.lookup_edges`.");
    bind_transform_points(type, &transform_points,
                          "Points of `source` mapped into `target`, as `Buffer.transform_points`.");
}

void bind_transaction_writes(TransactionClass& type) {
    add_raw_transaction_writes(type);
    type.def(
        "set_static_transform", &set_static_transform, nb::arg("parent").none(),
        nb::arg("child").none(), nb::arg("translation").none(), nb::arg("rotation") = nb::none(),
        nb::kw_only(), nb::arg("rpy") = nb::none(), nb::arg("wxyz") = nb::none(),
        nb::arg("authority").none() = "",
        nb::sig(
            "def set_static_transform(self, parent: str, child: str, translation: "
            "tfdb.types.VectorLike | tfdb.types.PoseLike, rotation: "
            "tfdb.types.QuaternionLike | None = None, *, rpy: tfdb.types.VectorLike | "
            "None = None, wxyz: tfdb.types.WxyzLike | None = None, authority: str = '') -> None"),
        R"(Store T[parent<-child] for every stamp, at the commit.

Arguments and errors as in `Buffer.set_static_transform`, but CycleError comes at the commit.
`change_kind` is missing, as in `set_transform`.)");
    type.def("set_transforms", &set_transforms, nb::arg("batch").none(), nb::kw_only(),
             nb::arg("static") = false, nb::arg("authority").none() = "",
             nb::sig("def set_transforms(self, batch: collections.abc.Iterable["
                     "tfdb.types.TransformStampedLike] | tfdb.Columns, *, static: bool = "
                     "False, authority: str = '') -> None"),
             R"(Store a batch of transforms T[parent<-child], at the commit.

Arguments and errors as in `Buffer.set_transforms`, but CycleError comes at the commit. A refused
batch leaves the transaction open and unchanged. `change_kind` and `only_new` are missing as in
`set_transform`. `partial` is missing: write one by one, and catch the errors.)");
    type.def("remove_frames", &remove_frames, nb::arg("names").none(), nb::kw_only(),
             nb::arg("recursive") = false,
             nb::sig("def remove_frames(self, names: str | collections.abc.Iterable[str], *, "
                     "recursive: bool = False) -> None"),
             R"(Remove a frame, or several, at the commit.

Arguments and errors as in `Buffer.remove_frames`. The commit raises ReadOnly for frames of a
mirrored store.)");
    type.def("clear", &clear, nb::sig("def clear(self) -> None"),
             R"(Drop all moving samples at the commit; frames and static transforms stay.

Moving samples that the transaction stored before are dropped as well. The same commit stores those
that it stores afterwards, so no reader finds the store empty. An edge may then become static, or
moving, as after `Buffer.clear`.

Samples that other writers store before the commit are dropped without a Conflict. Other
transactions that read dropped samples get a Conflict. The commit raises ReadOnly if the store has
moving samples of another store (`apply`).)");
    type.def(
        "reparent", &reparent, nb::arg("child").none(), nb::arg("parent").none(),
        nb::arg("stamp") = nb::none(), nb::arg("translation") = nb::none(),
        nb::arg("rotation") = nb::none(), nb::kw_only(), nb::arg("rpy") = nb::none(),
        nb::arg("wxyz") = nb::none(), nb::arg("authority").none() = "",
        nb::sig("def reparent(self, child: str, parent: str, stamp: tfdb.types.StampLike | "
                "None = None, translation: tfdb.types.VectorLike | tfdb.types.PoseLike | None "
                "= None, rotation: tfdb.types.QuaternionLike | None = None, *, rpy: "
                "tfdb.types.VectorLike | None = None, wxyz: tfdb.types.WxyzLike | None = None, "
                "authority: str = '') -> None"),
        kReparentDoc);
}

void bind_life(TransactionClass& type) {
    type.def("abort", &abort, nb::sig("def abort(self) -> None"),
             R"(Abort the transaction: nothing of it is stored. The `with` block may end normally.

Does nothing after an abort, a Conflict or another error at the commit. Raises TransactionClosed if
it was committed, or never begun.)");
    type.def_prop_ro(
        "closed", [](const TransactionObject& self) { return !self.transaction.is_open(); },
        nb::sig("def closed(self) -> bool"),
        "True before the transaction begins and after it ends.");
    type.def_prop_ro("commit", &commit_number, nb::sig("def commit(self) -> int | None"),
                     "Number of its commit, or of the state that it read if it wrote nothing; None "
                     "unless it was committed.");
    type.def_prop_ro(
        "_age", [](const TransactionObject& self) { return self.transaction.age(); },
        nb::sig("def _age(self) -> int"), "Its seniority, for the next attempt.");
    type.def_prop_ro(
        "_lost",
        [](const TransactionObject& self) { return self.transaction.stage() == Stage::kLost; },
        nb::sig("def _lost(self) -> bool"), "Whether it ended by a Conflict of its own.");
    type.def_prop_ro(
        "_has_written",
        [](const TransactionObject& self) { return self.transaction.has_written(); },
        nb::sig("def _has_written(self) -> bool"),
        "Whether `commit` is its own, not that of the state that it read.");
    type.def("__enter__", &enter, nb::sig("def __enter__(self) -> typing.Self"));
    type.def("__exit__", &exit, nb::arg("kind").none(), nb::arg("error").none(),
             nb::arg("traceback").none(),
             nb::sig("def __exit__(self, kind: object, error: object, traceback: object) -> None"));
    type.def("__repr__", &represent);
}

}  // namespace

void add_raw_transaction_writes(nb::handle type) {
    add_raw_method(type, g_set_transform);
}

void bind_transaction(nb::module_& module, nb::class_<BufferObject, StoreReaderObject>& type) {
    auto transaction =
        native_class<TransactionClass>(module, "Transaction", nb::type_slots(g_slots));
    refuse_construction<TransactionObject>(
        transaction, "Buffer.transaction() and Buffer.run() make transactions");
    bind_lookups(transaction);
    bind_frames(transaction);
    bind_transaction_writes(transaction);
    bind_life(transaction);
    type.def(
        "transaction",
        [](nb::handle self, nb::handle priority) { return attempt(self, priority, false, 0); },
        nb::arg("priority").none() = 0,
        nb::sig("def transaction(self, priority: int = 0) -> Transaction"),
        R"(Return a transaction: `with buf.transaction() as tx:` reads and writes in isolation.

The `with` statement begins it, and commits at its end. `priority` is an integer from 0 to 7. Above
0 it commits before ordinary writers. If an engine restarts one of two transactions, the higher
priority continues. Raises InvalidArgument. The `with` statement raises Conflict, TransactionActive
and, at the commit, CycleError and CapacityExceeded.)");
    type.def("_attempt", &attempt, nb::arg("priority").none(), nb::arg("alone"), nb::arg("age"),
             nb::sig("def _attempt(self, priority: int, alone: bool, age: int) -> Transaction"),
             "Return a transaction for another attempt: it may run alone, and keeps the age of the "
             "aborted one.");
}

}  // namespace tfdb::python
