// The Python class Buffer.
#include <nanobind/nanobind.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/string_view.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <unistd.h>

#include <array>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <tuple>
#include <utility>
#include <vector>

#include "arguments.hpp"
#include "errors.hpp"
#include "pose.hpp"
#include "records.hpp"
#include "signatures.hpp"
#include "stamp.hpp"
#include "writes.hpp"

namespace tfdb::python {
namespace {

Concurrency concurrency_from(nb::handle name) {
    try {
        return concurrency_of(PyUnicode_Check(name.ptr()) ? option_of(name, "concurrency") : "");
    } catch (const InvalidArgument&) {
        throw_not_one_of(
            "concurrency",
            {"snapshot", "giant", "fine", "2pl-no-wait", "2pl-wait-die", "2pl-wound-wait", "silo"},
            name);
    }
}

BufferObject* make_object(void* place, const BufferOptions& options) {
    try {
        return new (place) BufferObject(options);
    } catch (const CapacityExceeded&) {
        // Unreachable stores in reference cycles still hold their address space.
        nb::module_::import_("gc").attr("collect")();
        return new (place) BufferObject(options);
    }
}

constexpr std::array<std::string_view, 6> kInitNames = {
    "history", "max_frames", "memory_limit", "snapshot_memory", "clock", "concurrency"};

void init(nb::pointer_and_handle<BufferObject> self, const nb::args& args,
          const nb::kwargs& keywords) {
    constexpr std::uint64_t kMostBytes = std::numeric_limits<std::size_t>::max();
    constexpr ParameterList kList{"Buffer", kInitNames, 0, 1};
    std::array<PyObject*, kInitNames.size()> given{};
    bind_tuple(kList, args, keywords.ptr(), given.data());
    const auto [history, max_frames, memory_limit, snapshot_memory, clock, concurrency] = given;
    BufferOptions options;
    if (history != nullptr) {
        options.history_ns = optional_duration_of(history, "history");
    }
    if (max_frames != nullptr) {
        options.max_frames =
            static_cast<std::uint32_t>(count_of(max_frames, "max_frames", 1, kMaxFrames));
    }
    if (is_given(memory_limit)) {
        options.memory_limit = count_of(memory_limit, "memory_limit", 0, kMostBytes);
    }
    if (snapshot_memory != nullptr) {
        options.snapshot_memory = count_of(snapshot_memory, "snapshot_memory", 0, kMostBytes);
    }
    if (concurrency != nullptr) {
        options.concurrency = concurrency_from(concurrency);
    }
    BufferObject* const object = make_object(self.p, options);
    object->buffer = self.h.ptr();
    if (is_given(clock)) {
        object->clock = nb::borrow(clock);
    }
}

/// A file system path, which need not be UTF-8.
std::string path_of(nb::handle path) {
    PyObject* bytes = nullptr;
    if (PyUnicode_FSConverter(path.ptr(), &bytes) == 0) {
        throw nb::python_error();
    }
    const nb::object held = nb::steal(bytes);
    return {PyBytes_AsString(bytes), static_cast<std::size_t>(PyBytes_Size(bytes))};
}

void create_shared(nb::handle path, nb::handle history, nb::handle max_frames,
                   nb::handle snapshot_memory, nb::handle size, nb::handle permissions,
                   nb::handle group) {
    constexpr std::uint64_t kMostBytes = std::numeric_limits<std::size_t>::max();
    constexpr std::uint64_t kAllBits = 0777;
    BufferOptions options;
    options.history_ns = optional_duration_of(history, "history");
    options.max_frames =
        static_cast<std::uint32_t>(count_of(max_frames, "max_frames", 1, kMaxFrames));
    options.snapshot_memory = count_of(snapshot_memory, "snapshot_memory", 0, kMostBytes);
    ShareOptions share;
    share.size = count_of(size, "size", 0, kMostBytes);
    share.mode = static_cast<unsigned>(count_of(permissions, "permissions", 0, kAllBits));
    if (!group.is_none()) {
        share.group = static_cast<std::int64_t>(
            count_of(group, "group", 0, std::numeric_limits<std::int32_t>::max()));
    }
    Buffer::create(path_of(path), share, options);
}

constexpr StampNs kNoTimeout = std::numeric_limits<StampNs>::max();

nb::object made_of(Buffer opened, nb::handle clock) {
    nb::object made = make_offered<BufferObject>(std::move(opened));
    auto* const object = nb::inst_ptr<BufferObject>(made);
    object->buffer = made.ptr();
    if (!clock.is_none()) {
        object->clock = nb::borrow(clock);
    }
    return made;
}

nb::object open_shared(nb::handle path, bool writable, nb::handle lock_timeout, nb::handle clock) {
    const std::string file = path_of(path);
    const StampNs longest = optional_duration_of(lock_timeout, "lock_timeout").value_or(kNoTimeout);
    return made_of(Buffer::open(file, writable, longest), clock);
}

nb::str decoded(const std::string& path) {
    return nb::steal<nb::str>(
        PyUnicode_DecodeFSDefaultAndSize(path.data(), static_cast<Py_ssize_t>(path.size())));
}

/// An absolute path of the file: stores are pickled by it.
std::string absolute_path_of(nb::handle path) {
    std::string file = path_of(path);
    std::unique_ptr<char, decltype(&std::free)> here(nullptr, &std::free);
    if (!file.empty() && file.front() != '/') {
        here.reset(::getcwd(nullptr, 0));
        if (here != nullptr) {
            file.insert(0, std::string(here.get()) + "/");
        }
    }
    return file;
}

constexpr std::array<std::string_view, 3> kOpenNames = {"path", "verify", "clock"};

PyObject* open_frozen(PyObject* /*self*/, PyObject* const* args, Py_ssize_t count,
                      PyObject* keywords) {
    return guarded([&]() -> PyObject* {
        constexpr ParameterList kList{"open", kOpenNames, 1, 1};
        const auto [path, verify, clock] = bind<3>(kList, args, count, keywords);
        const bool whole = flag_of(verify, "verify");
        const nb::object given = nb::module_::import_("tfdb.data.path_checks").attr("check_path");
        const std::string file = absolute_path_of(given(nb::handle(path)));
        const auto open = [&] {
            const LongWork work(whole);
            return Buffer::open_frozen(file, whole);
        };
        return made_of(open(), clock == nullptr ? Py_None : clock).release().ptr();
    });
}

nb::object frozen(const BufferObject& self) {
    const std::optional<FrozenUse> use = self.store.frozen();
    if (!use) {
        return nb::none();
    }
    const nb::object origin = nb::steal(PyUnicode_DecodeUTF8(
        use->origin.data(), static_cast<Py_ssize_t>(use->origin.size()), "replace"));
    return record_type("Frozen")(decoded(use->path), use->size, origin);
}

void freeze_store(nb::handle self, nb::handle path, std::string_view origin) {
    const Pinned pinned = pin(self, object_of<StoreReaderObject>(self));
    const std::string file = path_of(path);
    const LongWork work(true);
    if (pinned.keep != nullptr) {
        pinned.keep->freeze(file, origin, true);
    } else {
        nb::inst_ptr<BufferObject>(self)->store.freeze(file, origin, true);
    }
}

nb::object shared(const BufferObject& self) {
    const std::optional<SharedUse> use = self.store.shared();
    if (!use) {
        return nb::none();
    }
    const nb::object lock_timeout =
        use->lock_timeout_ns == kNoTimeout
            ? nb::none()
            : nb::object(nb::float_(static_cast<double>(use->lock_timeout_ns) / 1e9));
    return record_type("Shared")(decoded(use->path), use->writable ? "rw" : "r", lock_timeout,
                                 use->size, use->repairs, use->processes);
}

CommitNumber set_static_transform(BufferObject& self, nb::handle parent, nb::handle child,
                                  nb::handle translation, nb::handle rotation, nb::handle rpy,
                                  nb::handle wxyz, nb::handle authority, bool change_kind) {
    const TransformView view = view_of(
        parent.ptr(), child.ptr(), nullptr,
        {translation.ptr(), rotation.ptr(), rpy.ptr(), wxyz.ptr(), parent.ptr(), child.ptr()});
    return commit_write(self, {.transforms = {&view, 1},
                               .is_static = true,
                               .authority = name_of(authority, "authority"),
                               .rules = {change_kind, false}});
}

nb::object set_transforms(BufferObject& self, nb::handle batch, bool is_static,
                          nb::handle authority, bool partial, bool change_kind, bool only_new) {
    WriteRequest request{.is_static = is_static,
                         .authority = name_of(authority, "authority"),
                         .rules = {change_kind, only_new},
                         .partial = partial};
    const auto store_partial = [&](const Transforms& transforms) {
        WriteResult result;
        {
            const LongWork work(true);
            result = self.open_store().write(request);
        }
        return transforms.refused(result.refused);
    };
    if (const auto edge = is_static ? std::nullopt : OneEdge::of(batch)) {
        const EdgeColumns columns = edge->columns();
        request.columns = &columns;
        if (partial)
            return store_partial(Transforms());
        return nb::int_(commit_write(self, request));
    }
    const Transforms transforms = Transforms::from_batch(batch, is_static);
    request.transforms = transforms.views;
    if (partial)
        return store_partial(transforms);
    return nb::int_(transforms.give_to([&](std::span<const TransformView> views) {
        request.transforms = views;
        return commit_write(self, request);
    }));
}

CommitNumber remove_frames(BufferObject& self, nb::handle names, bool recursive) {
    const FrameNames all(names);
    const LongWork work(true);
    return self.open_store().remove_frames(all.views(), recursive);
}

CommitNumber clear(BufferObject& self) {
    const LongWork work(true);
    return self.open_store().clear();
}

bool compact(BufferObject& self) {
    const LongWork work(true);
    return self.open_store().compact();
}

nb::object memory(BufferObject& self) {
    const MemoryUse use = [&] {
        const LongWork work(true);
        return self.open_store().memory();
    }();
    return memory_record(use);
}

nb::object snapshot(nb::handle self) {
    BufferObject& buffer = object_of<BufferObject>(self);
    check_not_in_transaction(buffer);
    return snapshot_object(self, [&] {
        const LongWork work(buffer.reasons.to_wait());
        return buffer.open_store().snapshot();
    }());
}

std::optional<double> history(const BufferObject& self) {
    const std::optional<StampNs> kept = self.store.history();
    return kept ? std::optional(clock::to_seconds(*kept)) : std::nullopt;
}

void enforce(BufferObject& self,
             const std::vector<std::tuple<std::string, std::string, StampNs, std::string>>& given) {
    std::vector<Lifespan> lifespans;
    for (const auto& [parent, child, limit, expectation] : given)
        lifespans.push_back({parent, child, limit, expectation});
    self.store.enforce(lifespans);
}

std::string_view concurrency(const BufferObject& self) {
    return concurrency_name(self.store.concurrency());
}

nb::str represent(nb::handle object) {
    const BufferObject& self = object_of<BufferObject>(object);
    const bool closed = self.closed.load();
    return nb::str(
        nb::module_::import_("tfdb.store.report")
            .attr("buffer_repr")(object, closed ? self.closed_commit : self.store.commit(),
                                 history(self), concurrency(self), frozen(self), closed));
}

// A clock may refer to the buffer: this shows the garbage collector the reference.
int traverse(PyObject* self, visitproc visit, void* arg) {
    Py_VISIT(Py_TYPE(self));
    if (nb::inst_ready(self)) {
        Py_VISIT(nb::inst_ptr<BufferObject>(self)->clock.ptr());
    }
    return 0;
}

int clear_references(PyObject* self) {
    if (nb::inst_ready(self)) {
        nb::inst_ptr<BufferObject>(self)->clock.reset();
    }
    return 0;
}

PyType_Slot g_slots[] = {
    {Py_tp_traverse, reinterpret_cast<void*>(traverse)},
    {Py_tp_clear, reinterpret_cast<void*>(clear_references)},
    {0, nullptr},
};

constexpr const char* kSetTransformsDoc =
    R"(Store a batch of transforms T[parent<-child] in one commit: all or nothing.

Parameters
----------
batch
    A sequence of `TransformStamped` or of ROS messages of that name, or one `Columns`. Of two
    members with the same child and stamp, the later one is stored.
static
    Whether they hold at every stamp until replaced.
authority
    Name of the writer.
partial
    Store the valid members in one commit, and return the others.
change_kind
    Let members change the kind of their edge, static or moving. The edge's stored samples are
    dropped in the same commit; the frames below it stay.
only_new
    Refuse members with a stamp that their edge, or an earlier member, has already. Not with
    `static`.

Returns
-------
int
    Number of the commit; of the current one if the batch is empty.
list[Refused]
    With `partial`: the refused members with their errors, in order.

Raises the error of the first refused member, with its `index`; `refused` has the errors of all.
They are InvalidName, InvalidStamp, InvalidArray, InvalidTransform, TooOld, StaticConflict,
RepeatedStamp and CycleError. Raises CapacityExceeded. Nothing is stored if it raises. With
`partial` it raises only CapacityExceeded, and TypeError for a member that is not a transform.)";

using BufferClass = nb::class_<BufferObject, StoreReaderObject>;

constexpr const char* kCompactDoc =
    R"(Return unused memory to the operating system.

A store keeps freed memory for later samples. This call drops samples beyond `history`, and returns
free memory to the system, that of a shared store to its file system. It moves no samples. So it
returns only pieces that are wholly free: of 256 KiB in a shared store (1/4096 of its size above 1
GiB), of 2 MiB in others.

Writers wait during the call: 5 ms for 10 million samples, 15 ms for 60,000 frames, and 10 ms for
each 100 MiB that a shared store returns. Reads go on.

Returns False, and returns no memory, while a snapshot, a transaction or a repeated read uses an
older state than the newest: call it again later. It may do so as well while a transaction or more
than three snapshots are open. Raises ReadOnly, TransactionActive and Forked;
LockTimeout if another process holds the lock; CorruptStore if the file is damaged.)";

void bind_writes(BufferClass& type) {
    add_raw_writes(type);
    type.def("set_static_transform", &set_static_transform, nb::arg("parent").none(),
             nb::arg("child").none(), nb::arg("translation").none(),
             nb::arg("rotation") = nb::none(), nb::kw_only(), nb::arg("rpy") = nb::none(),
             nb::arg("wxyz") = nb::none(), nb::arg("authority").none() = "",
             nb::arg("change_kind") = false,
             nb::sig("def set_static_transform(self, parent: str, child: str, translation: "
                     "tfdb.types.VectorLike | tfdb.types.PoseLike, rotation: "
                     "tfdb.types.QuaternionLike | None = None, *, rpy: tfdb.types.VectorLike | "
                     "None = None, wxyz: tfdb.types.WxyzLike | None = None, "
                     "authority: str = '', change_kind: bool = False) -> int"),
             R"(Store T[parent<-child] for every stamp, until a later commit replaces it.

Arguments, result and errors as in `set_transform`; with `change_kind` a moving edge becomes static
and its samples are dropped.)");
    type.def("set_transforms", &set_transforms, nb::arg("batch").none(), nb::kw_only(),
             nb::arg("static") = false, nb::arg("authority").none() = "",
             nb::arg("partial") = false, nb::arg("change_kind") = false,
             nb::arg("only_new") = false,
             // Its overloads are in stubs.pattern.
             nb::sig("def set_transforms(self, batch: collections.abc.Iterable["
                     "tfdb.types.TransformStampedLike] | tfdb.Columns, *, static: bool = "
                     "False, authority: str = '', partial: bool = False, change_kind: bool = "
                     "False, only_new: bool = False) -> int | "
                     "list[tfdb.types.Refused]"),
             kSetTransformsDoc);
    type.def("remove_frames", &remove_frames, nb::arg("names").none(), nb::kw_only(),
             nb::arg("recursive") = false,
             nb::sig("def remove_frames(self, names: str | collections.abc.Iterable[str], *, "
                     "recursive: bool = False) -> int"),
             R"(Remove a frame, or several, with their edges in one commit, all or none.

The order of the names does not matter: a frame may be removed together with all its children. With
`recursive` all frames below are removed as well. Returns the number of the commit; without names,
of the newest one.

A frame of a mirrored store (`apply`) is not removed, nor are the frames below it. Only the parent
edge that a local writer gave it is removed; without such an edge, ReadOnly is raised.

Raises UnknownFrame, FrameInUse (with the names of the children) and ReadOnly. The first two have
`index`, and `refused` with the errors of all names.)");
    type.def("clear", &clear, nb::sig("def clear(self) -> int"),
             R"(Drop all moving samples in one commit; frames and static edges stay.

Samples of another store (`apply`) stay: only that store clears them.

The commit needs a little memory for each moving edge. Raises CapacityExceeded if `memory_limit`
leaves none; then nothing is dropped.)");
    type.def("compact", &compact, nb::sig("def compact(self) -> bool"), kCompactDoc);
}

constexpr const char* kOpenDoc =
    R"(open(path, *, verify=False, clock=None)
--

Open a frozen store, a file of `freeze` or `tfdb freeze`.

Reads of the returned `Buffer` equal those of the frozen state, bit for bit. The file is mapped:
opening takes constant time, and all processes share its pages. Writes raise ReadOnly. The Buffer is
pickled by its path.

Parameters
----------
path
    The file. Do not truncate or overwrite it while it is open, as `cp` does: SIGBUS would kill its
    readers, or they would read wrong values. `freeze(overwrite=True)` is safe: it replaces the
    file, and processes that have the old one open keep it.
verify
    Read the whole file, and compare it with its checksum. Without it only the front of the file is
    checked: damage elsewhere causes wrong results or errors, never a crash.
clock
    As in `Buffer`.

Returns
-------
Buffer

Raises
------
NoSuchStore
    The file is missing.
CorruptStore
    The file is damaged, cut, or not a frozen store, or it is of another version of tfdb or kind of
    machine. Freeze its recording again.
InvalidArgument
    The path is empty or invalid.
ReadOnly, CapacityExceeded)";

PyMethodDef g_open = {"open", as_function(open_frozen), METH_FASTCALL | METH_KEYWORDS, kOpenDoc};

/// What `freeze` is made of: see frozen.py.
void bind_frozen(nb::module_& module, BufferClass& type) {
    type.def_prop_ro("frozen", &frozen, nb::sig("def frozen(self) -> tfdb.types.Frozen | None"),
                     "Facts about a frozen store; None if the store is not frozen.");
    add_raw_function(module, g_open);
    module.def(
        "freeze_store", &freeze_store, nb::arg("reads"), nb::arg("path"), nb::arg("origin"),
        nb::sig("def freeze_store(reads: StoreReader, path: os.PathLike[str], origin: str) -> "
                "None"),
        "Write a state into that file. Raises as `StoreReader.freeze`.");
}

/// What `Buffer.open` and `Buffer.unlink` are made of: see shared.py.
void bind_shared(nb::module_& module) {
    module.def("create_store", &create_shared, nb::arg("path"), nb::arg("history").none(),
               nb::arg("max_frames").none(), nb::arg("snapshot_memory").none(),
               nb::arg("size").none(), nb::arg("permissions").none(), nb::arg("group").none(),
               nb::sig("def create_store(path: os.PathLike[str], history: float | None, "
                       "max_frames: int, snapshot_memory: int, size: int, permissions: int, "
                       "group: int | None) -> None"),
               "Make the files of a store that processes share. Raises as `Buffer.open`.");
    module.def("open_store", &open_shared, nb::arg("path"), nb::arg("writable"),
               nb::arg("lock_timeout").none(), nb::arg("clock").none(),
               nb::sig("def open_store(path: os.PathLike[str], writable: bool, lock_timeout: float "
                       "| None, clock: collections.abc.Callable[[], int] | None) -> Buffer"),
               "Open the store in that file. Raises as `Buffer.open`.");
    module.def(
        "unlink_store", [](nb::handle path) { Buffer::unlink(path_of(path)); }, nb::arg("path"),
        nb::sig("def unlink_store(path: os.PathLike[str]) -> None"),
        "Remove the files of a store. Raises as `Buffer.unlink`.");
}

}  // namespace

void bind_buffer(nb::module_& module) {
    auto type = native_class<BufferClass>(module, "Buffer", nb::type_slots(g_slots));
    type.def("__init__", &init,
             nb::sig("def __init__(self, history: float | None = 10.0, *, max_frames: int = "
                     "1048575, memory_limit: int | None = None, snapshot_memory: int = "
                     "1073741824, clock: collections.abc.Callable[[], int] | None = None, "
                     "concurrency: tfdb.types.Concurrency = 'snapshot') -> None"));
    type.def_prop_ro("shared", &shared, nb::sig("def shared(self) -> tfdb.types.Shared | None"),
                     "Facts about a shared store; None if the store is private to this process.");
    bind_writes(type);
    bind_changes(type);
    bind_commits(type);
    bind_applier(module, type);
    bind_waits(type);
    bind_wire(module, type);
    bind_transaction(module, type);
    bind_watch(module, type);
    bind_clock(module, type);
    type.def(
        "snapshot", &snapshot, nb::sig("def snapshot(self) -> Snapshot"),
        "Return a snapshot of the newest commit: many reads of one state, in a `with` statement.");
    type.def("memory", &memory, nb::sig("def memory(self) -> tfdb.types.MemoryUse"),
             "Memory use of the store, in bytes.");
    type.def(
        "counters",
        [](BufferObject& self) { return counters_record(self.open_store().counters()); },
        nb::sig("def counters(self) -> tfdb.types.Counters"),
        "Counts of commits, conflicts, waits, normalised quaternions and repeated reads.");
    type.def_prop_ro("history", &history, nb::sig("def history(self) -> float | None"),
                     "Seconds of history that are kept; None: all.");
    type.def_prop_ro("concurrency", &concurrency,
                     nb::sig("def concurrency(self) -> tfdb.types.Concurrency"),
                     "Name of the concurrency-control engine.");
    type.def_prop_ro(
        "_clock",
        [](const BufferObject& self) {
            return self.clock.is_valid() ? nb::object(self.clock) : nb::none();
        },
        nb::sig("def _clock(self) -> collections.abc.Callable[[], int] | None"),
        "The function of the time, nanoseconds; None: the system's clock.");
    type.def("_enforce", &enforce, nb::arg("lifespans"),
             nb::sig("def _enforce(self, lifespans: list[tuple[str, str, int, str]]) -> None"),
             "Set the ages above which lookups raise Stale: parent, child, nanoseconds, name in "
             "errors.");
    type.def("__repr__", &represent);
    bind_shared(module);
    bind_frozen(module, type);
}

}  // namespace tfdb::python
