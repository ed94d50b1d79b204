// Waits for commits and transforms, and the calls that end them.
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "arguments.hpp"
#include "errors.hpp"
#include "reads.hpp"
#include "stamp.hpp"

namespace tfdb::python {
namespace {

CommitNumber wait_for_commit(nb::handle self, nb::handle after, nb::handle timeout) {
    BufferObject& buffer = object_of<BufferObject>(self);
    const CommitNumber seen = count_of(after, "after", 0, kMaxCommit);
    const std::optional<StampNs> longest = optional_duration_of(timeout, "timeout");
    using Clock = std::chrono::steady_clock;
    const Clock::time_point began = Clock::now();
    const bool came = [&] {
        const Waiting work;
        return buffer.open_store().wait_for_commit(seen, longest);
    }();
    if (!came) {
        const StampNs waited = std::chrono::nanoseconds(Clock::now() - began).count();
        const nb::object limit = longest ? nb::object(nb::int_(*longest)) : nb::none();
        throw_object(nb::module_::import_("tfdb.store.waiting")
                         .attr("no_commit")(seen, limit, waited, !longest || waited < *longest));
    }
    return buffer.store.commit();
}

std::uint64_t begin_wait(nb::handle self, nb::handle target, nb::handle source, nb::handle when,
                         nb::handle policy) {
    BufferObject& buffer = object_of<BufferObject>(self);
    const Question question =
        store::at_stamp(name_of(target, "target"), name_of(source, "source"),
                        optional_stamp_of(when.ptr()), policy_of(policy.ptr()));
    const Waiting work;
    return buffer.open_store().begin_wait(question);
}

std::uint64_t begin_wait_full(nb::handle self, nb::handle target, nb::handle target_stamp,
                              nb::handle source, nb::handle source_stamp, nb::handle fixed) {
    BufferObject& buffer = object_of<BufferObject>(self);
    const Question question =
        question_through(fixed, target, target_stamp, source, source_stamp, nb::none());
    const Waiting work;
    return buffer.open_store().begin_wait(question);
}

std::uint64_t begin_wait_as_new(nb::handle self, nb::handle target, nb::handle source,
                                nb::handle stamp) {
    BufferObject& buffer = object_of<BufferObject>(self);
    const Question question = store::as_new_as(name_of(target, "target"), name_of(source, "source"),
                                               stamp_of(stamp.ptr()));
    const Waiting work;
    return buffer.open_store().begin_wait(question);
}

std::uint64_t begin_wait_for_commit(nb::handle self, nb::handle after) {
    BufferObject& buffer = object_of<BufferObject>(self);
    const CommitNumber seen = count_of(after, "after", 0, kMaxCommit);
    const Waiting work;
    return buffer.open_store().begin_wait_for_commit(seen);
}

bool cancel_wait(nb::handle self, std::uint64_t number) {
    const BufferObject& buffer = object_of<BufferObject>(self);
    const Waiting work;
    return buffer.store.cancel_wait(number);
}

nb::dict ended_waits(nb::handle self, nb::handle timeout) {
    const BufferObject& buffer = object_of<BufferObject>(self);
    const std::optional<StampNs> longest = optional_duration_of(timeout, "timeout");
    const std::vector<EndedWait> ended = [&] {
        const Waiting work;
        return buffer.store.ended_waits(longest);
    }();
    nb::dict all;
    for (const EndedWait& wait : ended)
        all[nb::int_(wait.number)] = nb::int_(static_cast<unsigned>(wait.how));
    return all;
}

void await_ended_waits(nb::handle self, nb::handle timeout) {
    const BufferObject& buffer = object_of<BufferObject>(self);
    const std::optional<StampNs> longest = optional_duration_of(timeout, "timeout");
    const Waiting work;
    buffer.store.await_ended_waits(longest);
}

void set_waits_begun(nb::handle self, bool begun) {
    object_of<BufferObject>(self).waits_begun.store(begun, std::memory_order_relaxed);
}

CommitNumber check_wait(nb::handle self, unsigned how) {
    const BufferObject& buffer = object_of<BufferObject>(self);
    const auto end = static_cast<WaitEnd>(how);
    if (end == WaitEnd::kClosed || end == WaitEnd::kRemoved) {
        buffer.store.raise_ended_wait(end);
    }
    return buffer.store.commit();
}

void close(nb::handle self) {
    BufferObject& buffer = object_of<BufferObject>(self);
    {
        const nb::ft_object_guard guard(self);
        if (buffer.closed.exchange(true)) {
            return;
        }
        buffer.closed_commit = buffer.store.commit();
        buffer.reads = nullptr;
    }
    const Waiting work;
    buffer.store.end_waits();
}

void stop_waits(nb::handle self, bool stop) {
    const BufferObject& buffer = object_of<BufferObject>(self);
    const Waiting work;
    buffer.store.stop_waits(stop);
}

using BufferClass = nb::class_<BufferObject, StoreReaderObject>;

/// Functions for waiting.py.
void bind_begun_waits(BufferClass& type) {
    type.def("_begin_wait", &begin_wait, nb::arg("target"), nb::arg("source"),
             nb::arg("stamp").none(), nb::arg("policy").none(),
             nb::sig("def _begin_wait(self, target: str, source: str, stamp: "
                     "tfdb.types.StampLike | None, policy: Policy | None) -> int"),
             "Begin a wait, and return its number for `_ended_waits`; 0: the result is present.");
    type.def("_begin_wait_full", &begin_wait_full, nb::arg("target"),
             nb::arg("target_stamp").none(), nb::arg("source"), nb::arg("source_stamp").none(),
             nb::arg("fixed_frame"),
             nb::sig("def _begin_wait_full(self, target: str, target_stamp: "
                     "tfdb.types.StampLike | None, source: str, source_stamp: "
                     "tfdb.types.StampLike | None, fixed_frame: str) -> int"),
             "Begin a wait for `lookup_transform_full`, as `_begin_wait`.");
    type.def("_begin_wait_as_new", &begin_wait_as_new, nb::arg("target"), nb::arg("source"),
             nb::arg("stamp"),
             nb::sig("def _begin_wait_as_new(self, target: str, source: str, stamp: "
                     "tfdb.types.StampLike) -> int"),
             "Begin a wait for a latest common time of `stamp` or newer.");
    type.def("_begin_wait_for_commit", &begin_wait_for_commit, nb::arg("after").none(),
             nb::sig("def _begin_wait_for_commit(self, after: int) -> int"),
             "Begin a wait for a commit with a greater number.");
    type.def_prop_ro(
        "_last_to_follow", [](BufferObject& self) { return self.open_store().last_to_follow(); },
        nb::sig("def _last_to_follow(self) -> int"),
        "The newest commit for a follower: none after the removal of the store was noticed.");
    type.def("_cancel_wait", &cancel_wait, nb::arg("number"),
             nb::sig("def _cancel_wait(self, number: int) -> bool"),
             "Cancel a wait. Returns False if it has ended before.");
    type.def("_ended_waits", &ended_waits, nb::arg("timeout").none(),
             nb::sig("def _ended_waits(self, timeout: float | None) -> dict[int, int]"),
             "Wait until begun waits end. Returns how each ended, by its number, in order.");
    type.def("_await_ended_waits", &await_ended_waits, nb::arg("timeout").none(),
             nb::sig("def _await_ended_waits(self, timeout: float | None) -> None"),
             "Wait until begun waits end; `_ended_waits(0)` of any thread then returns them.");
    type.def("_set_waits_begun", &set_waits_begun, nb::arg("begun"),
             nb::sig("def _set_waits_begun(self, begun: bool) -> None"),
             "Set whether writes of tfdb.tf2 go through `waiting.write`, as they must while waits "
             "are begun.");
    type.def("_check_wait", &check_wait, nb::arg("how"),
             nb::sig("def _check_wait(self, how: int) -> int"),
             "Raise the error that ended a wait. After a timeout, return the newest commit.");
    type.def_static(
        "_may_be_frame",
        [](nb::handle name) { return store::name_fault(name_of(name, "name")) == nullptr; },
        nb::arg("name"), nb::sig("def _may_be_frame(name: str) -> bool"),
        "Whether a frame can have the name.");
    type.def("_stop_waits", &stop_waits, nb::arg("stop"),
             nb::sig("def _stop_waits(self, stop: bool) -> None"),
             "With True, end all present and future waits as by their timeout, until called with "
             "False.");
}

void bind_closing(BufferClass& type) {
    type.def("close", &close, nb::sig("def close(self) -> None"),
             R"(End all waits with BufferClosed; later reads, writes and waits raise it.

`commit`, `memory` and `counters` raise it as well. `history`, `concurrency`, `shared`, `frozen`
and the repr can still be read.
Open snapshots and transactions stay open. The memory is freed with the last reference to them and
to the buffer. A second call does nothing.)");
    type.def_prop_ro(
        "closed", [](const BufferObject& self) { return self.closed.load(); },
        nb::sig("def closed(self) -> bool"), "True after close().");
    type.def(
        "__enter__",
        [](nb::handle self) {
            static_cast<void>(object_of<BufferObject>(self).open_store());
            return nb::borrow(self);
        },
        nb::sig("def __enter__(self) -> typing.Self"));
    type.def(
        "__exit__", [](nb::handle self, nb::handle, nb::handle, nb::handle) { close(self); },
        nb::arg("kind").none(), nb::arg("error").none(), nb::arg("traceback").none(),
        nb::sig("def __exit__(self, kind: object, error: object, traceback: object) -> None"));
}

}  // namespace

void bind_waits(BufferClass& type) {
    add_raw_waits(type);
    type.def("wait_for_commit", &wait_for_commit, nb::arg("after").none(),
             nb::arg("timeout").none() = nb::none(),
             nb::sig("def wait_for_commit(self, after: int, timeout: float | None = None) -> int"),
             R"(Wait until there is a commit with a number greater than `after`.

Commits of any thread or process wake it, at most once per millisecond.

Parameters
----------
after
    The last commit that the caller knows: `commit`, or what this returned.
timeout
    Longest wait in seconds; None: no limit.

Returns
-------
int
    Number of the newest commit.

Raises
------
WaitTimeout, BufferClosed (`close` was called meanwhile), NoSuchStore (the shared store was
removed), TransactionActive, NotSupported (a research engine; or the store
is frozen; or this process may not write to its control file), InvalidArgument)");
    bind_begun_waits(type);
    bind_closing(type);
}

}  // namespace tfdb::python
