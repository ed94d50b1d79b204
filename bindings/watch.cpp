// Watches: the commits that touched some frames or paths.
#include "tfdb/store/watch.hpp"

#include <nanobind/stl/string.h>

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "arguments.hpp"
#include "errors.hpp"
#include "names.hpp"
#include "reads.hpp"
#include "records.hpp"
#include "signatures.hpp"
#include "stamp.hpp"

namespace tfdb::python {
namespace {

/// The object behind the Python class Watch.
/// Threads: the holder of the GIL; `watch` any. Guarantee: immutable.
struct WatchObject {
    std::shared_ptr<Watch> watch;
    nb::tuple what;  // names of frames, then pairs of names
    std::size_t frames = 0;
    nb::object owner;  // the Buffer object
    // The class Touched: a waiting thread would import it, and could not end with the program.
    nb::object record;
};

/// Removes duplicates, keeping the order.
nb::list each_once(const nb::list& subjects) {
    const nb::object dict = nb::module_::import_("builtins").attr("dict");
    return nb::list(dict.attr("fromkeys")(subjects));
}

nb::list frames_of(nb::handle frames) {
    nb::list names;
    if (PyUnicode_Check(frames.ptr())) {
        names.append(frames);
        return names;
    }
    check_many(frames, "frames", "names of frames");
    for (const nb::handle name : nb::iter(frames)) {
        static_cast<void>(name_of(name, "a frame"));
        names.append(name);
    }
    return each_once(names);
}

nb::list pairs_of(nb::handle pairs) {
    nb::list made;
    check_many(pairs, "pairs", "pairs (target, source) of frame names");
    for (const nb::handle pair : nb::iter(pairs)) {
        const bool is_list = PyTuple_Check(pair.ptr()) || PyList_Check(pair.ptr());
        if (!is_list || nb::len(pair) != 2) {
            const std::string got =
                is_list ? std::to_string(nb::len(pair)) + " items" : type_name_of(pair);
            throw nb::type_error(
                ("each of pairs must be a tuple (target, source), got " + got).c_str());
        }
        const nb::object target = pair[0];
        const nb::object source = pair[1];
        static_cast<void>(name_of(target, "target"));
        static_cast<void>(name_of(source, "source"));
        made.append(nb::make_tuple(target, source));
    }
    return each_once(made);
}

nb::object watch(nb::handle self, nb::handle frames, nb::handle pairs, bool every) {
    BufferObject& buffer = object_of<BufferObject>(self);
    const nb::list names = frames_of(frames);
    const nb::list paths = pairs_of(pairs);
    Watched watched;
    watched.every_commit = every;
    for (const nb::handle name : names) {
        watched.frames.emplace_back(name_of(name, "a frame"));
    }
    for (const nb::handle pair : paths) {
        watched.pairs.emplace_back(name_of(pair[0], "target"), name_of(pair[1], "source"));
    }
    std::shared_ptr<Watch> made = [&] {
        const Waiting work;
        return buffer.open_store().watch(watched);
    }();
    nb::object object = nb::inst_alloc(nb::type<WatchObject>());
    new (nb::inst_ptr<WatchObject>(object))
        WatchObject{std::move(made), nb::tuple(names + paths), watched.frames.size(),
                    nb::borrow(self), record_type("Touched")};
    nb::inst_mark_ready(object);
    return object;
}

nb::list next(nb::handle self, nb::handle after, nb::handle timeout, nb::handle limit) {
    const WatchObject& object = object_of<WatchObject>(self);
    const CommitNumber seen = count_of(after, "after", 0, kMaxCommit);
    const std::size_t most =
        limit.is_none() ? Buffer::kNoLimit : count_of(limit, "limit", 1, Buffer::kNoLimit);
    const std::optional<StampNs> longest = optional_duration_of(timeout, "timeout");
    const std::shared_ptr<Watch> watch = object.watch;
    const std::vector<Touch> touches = [&] {
        BufferObject& buffer = object_of<BufferObject>(object.owner);
        const Waiting work;
        static_cast<void>(buffer.open_store());
        return watch->next(seen, longest, most);
    }();
    nb::list made;
    if (touches.empty()) {
        return made;
    }
    for (const Touch& touch : touches) {
        nb::list what;
        for (const std::uint32_t place : touch.what) {
            if (place < nb::len(object.what))
                what.append(object.what[place]);
        }
        made.append(object.record(touch.commit, nb::tuple(what)));
    }
    return made;
}

void close(nb::handle self) {
    const std::shared_ptr<Watch> watch = object_of<WatchObject>(self).watch;
    const Waiting work;
    watch->close();
}

nb::tuple part_of(nb::handle self, bool frames) {
    const WatchObject& object = object_of<WatchObject>(self);
    const auto middle = static_cast<Py_ssize_t>(object.frames);
    PyObject* const part = frames ? PyTuple_GetSlice(object.what.ptr(), 0, middle)
                                  : PyTuple_GetSlice(object.what.ptr(), middle, PY_SSIZE_T_MAX);
    if (part == nullptr) {
        throw nb::python_error();
    }
    return nb::steal<nb::tuple>(part);
}

// A buffer's clock may refer to objects that hold its watches: as for snapshots.
int traverse_watch(PyObject* self, visitproc visit, void* arg) {
    Py_VISIT(Py_TYPE(self));
    if (nb::inst_ready(self)) {
        Py_VISIT(nb::inst_ptr<WatchObject>(self)->owner.ptr());
    }
    return 0;
}

PyType_Slot g_watch_slots[] = {
    {Py_tp_traverse, reinterpret_cast<void*>(traverse_watch)},
    {0, nullptr},
};

constexpr const char* kClassDoc = R"(Watch()
--

Waits for commits that touch some frames or paths.

`Buffer.watch()` returns it. Use it as a context manager, or close() it.)";

constexpr const char* kWatchDoc =
    R"(Return a watch of frames and paths: `next` waits for the commits that touch them.

A commit touches a frame if it stores samples of the frame, or moves, clears, creates or removes it.
A commit touches a pair if it touches a frame of the path between the two, before or after the
commit. If a commit changes the path, the watch follows the new one.

Parameters
----------
frames
    Names of frames, one or several. They may be created later.
pairs
    Pairs (target, source) of frame names, as for `lookup_transform`. If no path joins the two, the
    paths from both to their roots are watched.
every
    Return a record for every commit, also if it touches nothing watched.

Returns
-------
Watch

Raises
------
InvalidArgument
    Neither frames nor pairs are given.
InvalidName
    No frame can have the name.
NotSupported
    The store has no waits: a research engine, a frozen store, or a shared one whose control file
    this process may not write to.
BufferClosed, TransactionActive)";

constexpr const char* kNextDoc =
    R"(Wait for commits after `after` that touch the watched frames or pairs, and return them all.

It waits and reads the feed without the GIL. Other commits run no Python code, wake no thread, and
do not lap a waiting `next`. A caller that passes the last record's commit as the next `after`
misses no commit, and gets none twice.

While a frame of a pair's path, or above it, has samples with several parents, every commit touches
the pair, because its path depends on the stamp. The same holds while a late follower cannot read
the state of a commit. A held snapshot of `after` prevents the latter.

Parameters
----------
after
    A commit: that of a snapshot, or of the last record.
timeout
    Longest wait in seconds; None: no limit. 0: return what is present.
limit
    Largest number of records; None: all.

Returns
-------
list[Touched]
    In commit order, each with the touched frames and pairs. Empty at the end of the timeout, and
    when the process ends.

Raises
------
FeedLapped
    The feed no longer has the commit after `after`, as in `Buffer.changes`.
InvalidArgument
    The commit does not exist yet.
WatchClosed, BufferClosed (also if `close` was called meanwhile), NoSuchStore (the shared store was
removed), Forked (in a child of the process that made the watch), TransactionActive)";

}  // namespace

void bind_watch(nb::module_& module, nb::class_<BufferObject, StoreReaderObject>& type) {
    type.def("watch", &watch, nb::arg("frames").none() = nb::tuple(),
             nb::arg("pairs").none() = nb::tuple(), nb::kw_only(), nb::arg("every") = false,
             nb::sig("def watch(self, frames: str | collections.abc.Iterable[str] = (), pairs: "
                     "collections.abc.Iterable[tuple[str, str]] = (), *, every: bool = False) -> "
                     "Watch"),
             kWatchDoc);
    auto made = offered_class<nb::class_<WatchObject>>(module, "Watch", kClassDoc,
                                                       nb::type_slots(g_watch_slots));
    refuse_construction<WatchObject>(made, "Buffer.watch() makes watches");
    made.def("next", &next, nb::arg("after").none(), nb::arg("timeout").none() = nb::none(),
             nb::arg("limit").none() = nb::none(),
             nb::sig("def next(self, after: int, timeout: float | None = None, limit: int | None = "
                     "None) -> list[tfdb.types.Touched]"),
             kNextDoc);
    made.def("close", &close, nb::sig("def close(self) -> None"),
             "End `next` in all threads with WatchClosed. A second call does nothing.");
    made.def_prop_ro(
        "closed", [](nb::handle self) { return object_of<WatchObject>(self).watch->is_closed(); },
        nb::sig("def closed(self) -> bool"), "True after close().");
    made.def_prop_ro(
        "frames", [](nb::handle self) { return part_of(self, true); },
        nb::sig("def frames(self) -> tuple[str, ...]"), "The watched frames, each once.");
    made.def_prop_ro(
        "pairs", [](nb::handle self) { return part_of(self, false); },
        nb::sig("def pairs(self) -> tuple[tuple[str, str], ...]"),
        "The watched pairs (target, source), each once.");
    made.def(
        "__enter__",
        [](nb::handle self) {
            object_of<WatchObject>(self).watch->check_open();
            return nb::borrow(self);
        },
        nb::sig("def __enter__(self) -> typing.Self"));
    made.def(
        "__exit__", [](nb::handle self, nb::handle, nb::handle, nb::handle) { close(self); },
        nb::arg("kind").none(), nb::arg("error").none(), nb::arg("traceback").none(),
        nb::sig("def __exit__(self, kind: object, error: object, traceback: object) -> None"));
    made.def("__repr__", [](nb::handle self) {
        const WatchObject& object = object_of<WatchObject>(self);
        return "<tfdb.Watch of " + std::to_string(object.frames) + " frames and " +
               std::to_string(nb::len(object.what) - object.frames) + " pairs" +
               (object.watch->is_closed() ? ", closed>" : ">");
    });
}

}  // namespace tfdb::python
